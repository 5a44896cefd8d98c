"""From an asset to a marked asset, and to a file with its manifest."""
