from __future__ import annotations

import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from folders import REPOSITORY
from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks import RECORDS, meshmark_attacks
from meshmark_plugins.readers.obj import ObjFrames

NAMES = [record.name for record in RECORDS]
PAGE = REPOSITORY / "docs" / "attacks.md"

QUAD_AND_TRIANGLE = Topology(np.array([4, 3]), np.array([0, 1, 2, 3, 1, 4, 2]), 5)
KEEPS_POLYGONS = {
    "noise",
    "quantization",
    "gltf-quantization",
    "float16",
    "obj-digits",
    "similarity",
    "scale",
    "smoothing",
    "relaxation",
    "jitter",
    "wobble",
    "bending",
    "embossing",
    "cutting",
    "reorder",
    "resample",
    "drop",
    "window",
    "speed",
    "reverse",
    "junk",
}


def test_names_are_unique_and_offered_through_the_hook():
    assert len(set(NAMES)) == len(NAMES) == 30
    assert meshmark_attacks() == RECORDS


@pytest.mark.parametrize("record", RECORDS, ids=NAMES)
def test_every_parameter_is_recorded_with_its_default(record):
    attack = record.factory()
    found = {field.name: getattr(attack, field.name) for field in fields(attack)}
    assert found == dict(record.parameters)


@pytest.mark.parametrize("record", RECORDS, ids=NAMES)
def test_every_attack_is_documented_with_its_parameters(record):
    page = PAGE.read_text(encoding="utf-8")
    _, found, section = page.partition(f"### {record.name}\n")
    assert found, f"docs/attacks.md has no section on {record.name}"
    section = section.partition("\n##")[0]
    assert not [name for name in record.parameters if f"`{name}`" not in section]
    defaults = {name: value for name, value in record.parameters.items() if value is not None}
    assert not [name for name, value in defaults.items() if f"`{value}`" not in section]


@pytest.mark.parametrize("name", sorted(KEEPS_POLYGONS))
def test_polygons_stay_polygons_where_the_attack_permits_it(name):
    V = np.random.default_rng(0).normal(size=(4, 5, 3))
    frames = [Frame(float(i + 1), P, QUAD_AND_TRIANGLE) for i, P in enumerate(V)]
    record = RECORDS[NAMES.index(name)]
    attacked = record.factory().apply(MeshAnimation.from_frames(frames), np.random.default_rng(1))
    assert sorted(attacked[0].topology.counts.tolist()) == [3, 4]


def test_listing_the_attacks_imports_none_of_them():
    program = (
        "import sys, meshmark_plugins.attacks as a; assert len(a.RECORDS) == 30\n"
        "print([m for m in sys.modules if m.startswith('meshmark_plugins.attacks.')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("noise", {"size": 1}, "has no parameter 'size'; it takes: amplitude, kind, per"),
        ("float16", {"bits": 1}, "has no parameter 'bits'; it takes: none"),
        ("speed", {"bake": "maybe"}, "bake is 'maybe', but must be true or false"),
        ("speed", {"factor": 0}, r"factor is 0, but must be a number in \[0.1, 10\]"),
        ("quantization", {"bits": 25}, r"bits is 25, but must be a whole number in \[1, 24\]"),
        ("quantization", {"bits": 9.5}, "bits is 9.5, but must be a whole number"),
        ("quantization", {"bits": True}, "bits is True, but must be a whole number"),
        ("gltf-quantization", {"bits": 17}, r"bits is 17, .* \[1, 16\]"),
        ("obj-digits", {"kind": "hex"}, "kind is 'hex', but must be one of fixed, significant"),
        (
            "similarity",
            {"scale_low": 20},
            r"scale_low is 20, .* \[0.001, 10\]",
        ),
        ("scale", {"factors": "1,2"}, "factors is '1,2', but must be three numbers"),
        ("scale", {"factors": (1, 0, 1)}, r"size of the smallest of factors is 0.0, .* \(0, "),
        ("smoothing", {"strength": 0}, r"strength is 0, but must be a number in \(0, 1\]"),
        ("simplification", {"ratio": 1}, r"ratio is 1, but must be a number in \[0, 1\)"),
        ("simplification", {"method": "x"}, "method is 'x', but must be one of quadric, fast"),
        ("subdivision", {"scheme": "x"}, "one of midpoint, loop, sqrt3"),
        ("remeshing-sdf", {"resolution": 4}, r"resolution is 4, .* \[8, 256\]"),
        ("remeshing-isotropic", {"edge": 0.1}, r"edge is 0.1, .* \[0.25, 8\]"),
        ("resample", {"factor": 0}, "factor is 0"),
        ("drop", {"share": 1}, "share is 1"),
        ("window", {"share": 0}, "share is 0"),
        ("window", {"start": 2}, "start is 2"),
        ("joining", {"thing": "hat"}, "one of ground, box, body, sheet, wall"),
        ("joining", {"size": 0}, r"size is 0, but must be a number in \(0, 1000\]"),
        ("joining", {"area": 101}, "area is 101"),
        ("cutting", {"patches": 0}, r"patches is 0, .* \[1, 10000\]"),
        ("cutting", {"gap": 2}, r"gap is 2, .* \[0, 1\]"),
        ("relaxation", {"steps": -1}, "steps is -1"),
        ("relaxation", {"strength": 0}, "strength is 0"),
        ("jitter", {"size": 11}, r"size is 11, .* \[0, 10\]"),
        ("jitter", {"per": "vertex"}, "per is 'vertex'"),
        ("wobble", {"amplitude": -1}, "amplitude is -1"),
        ("wobble", {"waves": 0}, "waves is 0"),
        ("wobble", {"wavelength": 0}, "wavelength is 0"),
        ("bending", {"amount": -1}, r"amount is -1, .* \[0, 1\]"),
        ("bending", {"degree": 4}, r"degree is 4, .* \[2, 3\]"),
        ("bending", {"per": "vertex"}, "per is 'vertex'"),
        ("embossing", {"height": "tall"}, r"height is 'tall', .* \[0, 0.1\]"),
        ("embossing", {"height": 1}, "height is 1"),
        ("embossing", {"patches": 0}, r"patches is 0, .* \[1, 100000\]"),
        ("junk", {"share": 0}, r"share is 0, .* \(0, 1\)"),
        ("junk", {"where": "end"}, "one of start, random"),
        ("marking-again", {"copies": 0}, "copies is 0"),
        (
            "collusion",
            {"kind": "sum"},
            "one of mean, median, min, max, extremes, choice, alter",
        ),
        ("combination", {"attacks": "noise:loud"}, "'loud' in 'noise:loud' is not PARAMETER=VALUE"),
        ("combination", {"attacks": ":a=1"}, "name is missing"),
        ("combination", {"attacks": ()}, "at least one"),
    ],
)
def test_impossible_parameters_are_named_with_what_is_allowed(name, parameters, words):
    with pytest.raises(UsageError, match=words):
        RECORDS[NAMES.index(name)].factory(**parameters)


@pytest.mark.parametrize(
    "name",
    [
        "cropping",
        "reorder",
        "simplification",
        "remeshing-sdf",
        "resample",
        "speed",
        "joining",
        "cutting",
        "jitter",
    ],
)
def test_a_varying_connectivity_is_refused_where_trajectories_are_needed(name):
    rng = np.random.default_rng(0)
    shapes = [QUAD_AND_TRIANGLE, Topology(np.array([3]), np.array([0, 1, 2]), 5)]
    frames = [Frame(float(i), rng.normal(size=(5, 3)), shape) for i, shape in enumerate(shapes)]
    varying = MeshAnimation.from_frames(frames, prim="/Sea", origin="sea.usda")
    with pytest.raises(UsageError, match=r"sea\.usda: /Sea: attack .* needs one connectivity"):
        RECORDS[NAMES.index(name)].factory().apply(varying, rng)


@pytest.mark.slow
@pytest.mark.parametrize("record", RECORDS, ids=NAMES)
def test_a_real_animation_comes_out_sound(record, data_folder):
    # Slivers, borders, parts that touch: what generated meshes do not have.
    if record.name == "remeshing-isotropic":
        pytest.importorskip("gpytoolbox", reason="gpytoolbox, an optional library, is absent")
    horse = ObjFrames().read(str(data_folder / "horse-gallop-obj")).meshes[0].select([0, 3, 6])
    choices = {"per": ["frame", "animation"]} if "per" in record.parameters else {}
    if record.name == "subdivision":
        choices = {"scheme": ["midpoint", "loop", "sqrt3"]}
    extra = {"other": horse} if record.name == "collusion" else {}
    variants = [{name: value} for name, values in choices.items() for value in values]
    for parameters in variants or [{}]:
        attack = record.factory(**parameters, **extra)
        for frame in attack.apply(horse, np.random.default_rng(0)):
            assert np.isfinite(frame.points).all()
            assert len(frame.points) == frame.topology.n_points > 1000
