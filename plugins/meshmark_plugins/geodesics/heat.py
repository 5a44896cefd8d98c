"""Distances by the heat method."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.parameters import require_number
from meshmark_plugins.geodesics.components import ComponentwiseSolver, OneSource

NAME = "geodesic heat"


class HeatSolver(ComponentwiseSolver):
    """Geodesic distances by short-time heat flow [1]_.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles. Any mesh will do: components, open or non-manifold edges, slivers, unused
        vertices.
    t_coef : float
        Time of flow in units of the squared mean edge length. Larger is smoother and,
        far above 1, further from the exact distance; you will hardly need to change it.
    use_robust : bool
        Use the intrinsic Delaunay Laplacian of Sharp and Crane, which slivers and non-manifold
        edges do not break. Without it set-up is a little quicker.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    InputError
        If the arrays are not those of a mesh.

    Notes
    -----
    The heavy work, factorising two Laplacians, is done once for each connected component, when
    a source first lies in it. Errors are about 1 % of the distance, most of it near the source
    and at medial lines, where the exact distance has a kink and this one is smooth.

    References
    ----------
    .. [1] K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", ACM Transactions on
       Graphics 32 (2013). doi:10.1145/2516971.2516977

    Examples
    --------
    >>> from meshmark.testing.meshes import plane
    >>> V, F = plane(20)
    >>> D = HeatSolver(V, F).distances([0])
    >>> D.shape, float(D[0, 0])
    ((1, 400), 0.0)
    """

    def __init__(
        self, V: ArrayLike, F: ArrayLike, *, t_coef: float = 1.0, use_robust: bool = True
    ) -> None:
        require_number(NAME, "t_coef", t_coef, 0.0, 1e6)
        if not isinstance(use_robust, (bool, np.bool_)):
            raise UsageError(f"{NAME}: use_robust must be true or false, not {use_robust!r}")
        self.t_coef, self.use_robust = float(t_coef), bool(use_robust)
        super().__init__(V, F)

    def _build(self, V: FloatArray, F: IntArray) -> OneSource:
        import potpourri3d as pp3d

        try:
            solver = pp3d.MeshHeatMethodDistanceSolver(V, F, self.t_coef, self.use_robust)
        except (RuntimeError, ValueError) as error:
            raise _failure(error) from error

        # Nothing here knows `self`: a cycle would keep the factors alive long after it.
        def solve(source: int) -> FloatArray:
            try:
                d = np.asarray(solver.compute_distance(source), dtype=np.float64)
            except RuntimeError as error:
                raise _failure(error) from error
            # Rounding may put some vertex a hair nearer to the source than the source is.
            return np.maximum(d - d[source], 0.0)

        return solve


def _failure(error: Exception) -> CapacityError:
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return CapacityError(f"the heat method cannot solve on this mesh: {reason}")
