"""From the vertices about an anchor to chips, and the soft evidence made of them."""
