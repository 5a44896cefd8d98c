"""From the vertices about an anchor to chips of evidence."""
