"""Tries what a plugin offers on a small mesh: a quick look, where the suites are the full one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from meshmark.extension.registry import RegisteredPlugin
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import dumbbell

if TYPE_CHECKING:
    from meshmark.extension.informed import InformedScheme


def check_plugin(offer: RegisteredPlugin) -> list[str]:
    """Make what is offered and try it.

    Returns
    -------
    list of str
        What is wrong; empty if nothing is.
    """
    try:
        return _CHECKS[offer.kind](offer)
    # A stranger's code may raise anything; the reason is what the user asked for.
    except Exception as error:
        return [f"{type(error).__name__}: {error}"]


def _reader(offer: RegisteredPlugin) -> list[str]:
    reader = offer.record.factory()
    accepted = reader.accepts("no-such-file.unknown-suffix")
    return ["accepts a file of a kind nobody knows"] if accepted else []


def _segmenter(offer: RegisteredPlugin) -> list[str]:
    V, F = dumbbell()
    labels = np.asarray(offer.record.factory().segment(V, F))
    again = np.asarray(offer.record.factory().segment(V, F))
    problems = []
    if labels.shape != (len(F),) or labels.dtype.kind not in "iu":
        problems.append(f"labels are {labels.dtype} {labels.shape}, not int ({len(F)},)")
    if not np.array_equal(labels, again):
        problems.append("two runs differ")
    return problems


def _geodesic(offer: RegisteredPlugin) -> list[str]:
    V, F = dumbbell()
    sources = np.array([0, len(V) - 1])
    D = np.asarray(offer.record.factory(V, F).distances(sources))
    if D.shape != (2, len(V)):
        return [f"distances are {D.shape}, not (2, {len(V)})"]
    problems = []
    if np.abs(D[[0, 1], sources]).max() > 1e-6 * D.max():
        problems.append("the distance of a source to itself is not 0")
    if np.any(D < 0):
        problems.append("some distances are negative")
    return problems


def _scheme(offer: RegisteredPlugin) -> list[str]:
    from meshmark.detection.extraction import extract
    from meshmark.extension.recipe import Recipe

    recipe = Recipe(offer.name)
    scheme = recipe.build()
    if recipe.informed:
        return _informed_scheme(scheme, offer.name)
    evidence = extract(_animation(), scheme, offer.name)
    if evidence.n_chips != scheme.n_chips:
        return [f"a carrier has {evidence.n_chips} chips, not {scheme.n_chips}"]
    return []


def _informed_scheme(scheme: InformedScheme, name: str) -> list[str]:
    from meshmark.detection.informed import extract_informed
    from meshmark.mesh.welding import Welding

    original = _animation(points=3000)
    layout = scheme.layout(Welding.of(original[0]).frame(original[0]))
    if layout.owner.shape != (layout.n_chips,):
        return [f"the owner's chips are {layout.owner.shape}, not ({layout.n_chips},)"]
    # A copy that was noised: there is something to be seen.
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 1e-4 * np.ptp(original[0].points), original[0].points.shape)
    copy = original.map(lambda frame: frame.moved(frame.points + noise))
    evidence = extract_informed(copy, original, scheme, name)
    if evidence.n_chips != layout.n_chips:
        return [f"a copy shows {evidence.n_chips} chips, not {layout.n_chips}"]
    return []


def _attack(offer: RegisteredPlugin) -> list[str]:
    animation = _animation()
    before = animation[0].points.copy()
    attacked = offer.record.factory().apply(animation, np.random.default_rng(0))
    problems = []
    if not np.all(np.isfinite(attacked[0].points)):
        problems.append("leaves points that are not finite")
    if not np.array_equal(before, animation[0].points):
        problems.append("changes the animation it is given")
    return problems


def _animation(points: int = 7000) -> MeshAnimation:
    from meshmark.demo import creature

    return creature(points=points, frames=2)


_CHECKS: dict[str, Callable[[RegisteredPlugin], list[str]]] = {
    "reader": _reader,
    "segmenter": _segmenter,
    "geodesic": _geodesic,
    "scheme": _scheme,
    "attack": _attack,
}
