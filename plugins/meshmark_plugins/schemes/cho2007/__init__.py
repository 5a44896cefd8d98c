"""The static peer: one bit in the distribution of vertex norms in each shell about the centroid.

References
----------
J.-W. Cho, R. Prost, H.-Y. Jung, "An Oblivious Watermarking for 3-D Polygonal Meshes Using
Distribution of Vertex Norms", IEEE Transactions on Signal Processing 55(1), 142-155, 2007.
https://doi.org/10.1109/TSP.2006.882111. Its first method, which shifts means, is built here.
"""
