"""From the words of a key to places of vertices."""
