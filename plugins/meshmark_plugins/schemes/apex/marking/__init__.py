"""From the words of a key to marked positions of vertices."""
