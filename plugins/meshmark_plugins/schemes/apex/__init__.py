"""The scheme beyond the paper: bits in the density of vertices about the tips of a shape.

Anchors, the tips of protrusions, are detected from one frame alone. About each, vertices are
counted by their distance along the surface, in bins of a fixed share of its size. Sliding vertices
along the surface, which hardly changes it, makes the density in each bin lean to one side.
docs/apex.md explains the method.
"""
