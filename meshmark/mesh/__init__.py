"""Arrays and surfaces: animations, triangles, and what is measured on them."""
