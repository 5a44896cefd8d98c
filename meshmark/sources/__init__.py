"""From a path to an asset and back: which reader opens a source, and in which process."""
