"""From a copy to evidence, and from evidence and a key to a verdict."""
