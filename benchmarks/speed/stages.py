"""Where the time of `apex` goes: seconds by stage, in one process."""

from __future__ import annotations

import importlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from meshmark.detection.extraction import Extraction
from meshmark.detection.significance import judge
from meshmark.embedding.mesh import embed_animation
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation

APEX = "meshmark_plugins.schemes.apex"
# Where a function is looked up, and the stage its own time counts for: what it calls counts for
# the stages of what is called.
DISTANCES = (
    (f"{APEX}.anchors.proxies", "build_proxy", "proxies"),
    (f"{APEX}.anchors.proxies", "distance_topology", "distances: topologies"),
    (f"{APEX}.anchors.proxy_distances", "ProxyDistances.__init__", "distances: factors"),
    (f"{APEX}.anchors.proxy_distances", "EvenMeshDistances.from_points", "distances: solves"),
    (f"{APEX}.anchors.proxy_distances", "ProxyDistances.to_proxy", "distances: near anchors"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.__init__", "distances: factors"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.from_vertices", "distances: solves"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.from_vertex", "distances: solves"),
)
EMBED_STAGES = (
    (f"{APEX}.marking.plan", "require_capacity", "finding lasting anchors"),
    (f"{APEX}.marking.plan", "anchors_in_poses", "finding anchors in poses"),
    *DISTANCES,
    (
        f"{APEX}.marking.pose_constraints",
        "PoseConstraints.__call__",
        "chips and gradients of poses",
    ),
    ("meshmark.mesh.closest_points", "ClosestPoints.points", "closest points"),
    (f"{APEX}.marking.keyframe_solver", "solve_displacement", "solving for displacements"),
    (f"{APEX}.marking.fold_smoother", "FoldSmoother.smooth_folds", "smoothing folds"),
    (f"{APEX}.marking.keyframe_solver", "energy_over_poses", "energies"),
    ("meshmark.mesh.deformation", "Deformation.gradients", "deformation gradients"),
    (f"{APEX}.marking.displacement_transfer", "allowed_shares", "holding faces back"),
    (f"{APEX}.marking.pose_constraints", "allowed_shares", "holding faces back"),
    (f"{APEX}.marking.plan", "restrain", "holding faces back"),
    (f"{APEX}.marking.plan", "fit_to_surface", "fitting to surfaces"),
    (f"{APEX}.marking.plan", "surface_distance", "keeping to the limit"),
)
LOOK_STAGES = (
    *DISTANCES,
    ("meshmark.detection.observer", "unsmoothed", "undoing smoothing"),
    (f"{APEX}.anchors.detect", "large_components", "components"),
    (f"{APEX}.anchors.detect", "surface_anchors", "anchors"),
    (f"{APEX}.scheme", "whitening_weights", "whitening"),
    (f"{APEX}.scheme", "radial_histograms", "histograms"),
    (f"{APEX}.scheme", "measure_chips", "chips"),
)


class Stages:
    """Adds up the time spent in each stage itself, without what it calls."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._inner: list[float] = []

    @contextmanager
    def within(self, stage: str) -> Iterator[None]:
        """Count the time of a block for a stage, less that of the stages inside."""
        self._inner.append(0.0)
        start = time.process_time()
        try:
            yield
        finally:
            elapsed = time.process_time() - start
            self.seconds[stage] += elapsed - self._inner.pop()
            if self._inner:
                self._inner[-1] += elapsed

    def watch(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """Wrap a function so that its time is counted."""

        def watched(*args: Any, **kwargs: Any) -> Any:
            with self.within(stage):
                return function(*args, **kwargs)

        return watched


@contextmanager
def watched(stages: Stages, places: tuple[tuple[str, str, str], ...]) -> Iterator[None]:
    """Watch functions and methods where they are looked up."""
    undo = []
    for module, name, stage in places:
        owner: Any = importlib.import_module(module)
        *path, last = name.split(".")
        for part in path:
            owner = getattr(owner, part)
        original = getattr(owner, last)
        undo.append((owner, last, original))
        setattr(owner, last, stages.watch(original, stage))
    try:
        yield
    finally:
        for owner, last, original in undo:
            setattr(owner, last, original)


def stages_of(animation: MeshAnimation, key: Key) -> tuple[Stages, Stages]:
    """Time the stages of marking an animation, and of looking at its first frame."""
    scheme = Recipe("apex").build()
    marking, looking = Stages(), Stages()
    with watched(marking, EMBED_STAGES), marking.within("everything else"):
        marked = embed_animation(animation, scheme, "apex", key, jobs=1).animation
    with watched(looking, LOOK_STAGES), looking.within("everything else"):
        evidence = Extraction(marked, scheme, "apex").look([0])
        with looking.within("judging"):
            judge(evidence, key)
    return marking, looking
