"""The published scheme: bits in the distribution of geodesic distances within SDF parts.

References
----------
The paper this package is named after restates as: segment one frame, sort each part's vertices
by their mean geodesic distance to the part's cut, push each set's mean past a threshold, and
follow the vertex trajectories through the other frames.
"""
