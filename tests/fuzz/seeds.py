"""Small inputs of every kind, made by code; what is altered."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import gltf
from .evidence import SECRET

KEY = hashlib.sha256(b"a key that is looked for").digest()
# A scheme that marks the body of 162 points at once.
QUICK = ("--scheme", "cho2007", "--set", "bits=16")
STORE = "store"


@dataclass(frozen=True)
class Seed:
    """A folder of files, the first of which is the source."""

    name: str
    files: dict[str, bytes]

    @property
    def source(self) -> str:
        """The name of the source."""
        return next(iter(self.files))


def build(folder: Path) -> None:
    """Write all seeds into a folder, in a process of its own: it loads what cannot be forked."""
    pid = os.fork()
    if pid == 0:
        try:
            _build(folder)
        except BaseException:
            sys.excepthook(*sys.exc_info())
            os._exit(1)
        os._exit(0)
    if os.waitpid(pid, 0)[1]:
        raise SystemExit("the seeds cannot be made")


def secret_file(folder: Path) -> Path:
    """Return the file of the secret that evidence is sealed with."""
    return folder / "scratch" / "mark" / "secret"


def load(folder: Path) -> dict[str, list[Seed]]:
    """Return the seeds of each kind."""
    order = json.loads((folder / "order.json").read_text())
    return {
        kind: [
            Seed(name, {file: (folder / kind / name / file).read_bytes() for file in files})
            for name, files in seeds.items()
        ]
        for kind, seeds in order.items()
    }


def _build(folder: Path) -> None:
    order: dict[str, dict[str, list[str]]] = {}
    for kind, name, files in _all(folder):
        order.setdefault(kind, {})[name] = list(files)
        for file, content in files.items():
            path = folder / kind / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    (folder / "order.json").write_text(json.dumps(order))


def _all(folder: Path) -> Iterator[tuple[str, str, dict[str, bytes]]]:
    texts = _stages()
    for name, files in texts.items():
        yield "usda", name, {file: text.encode() for file, text in files.items()}
    for name, files in texts.items():
        yield "usdc", name, _as_crates(folder, name, files)
    for name, files in texts.items():
        yield "usdz", name, {f"{name}.usdz": _package(_as_crates(folder, name, files))}
        yield (
            "usdz",
            f"{name}-text",
            {f"{name}.usdz": _package({file: text.encode() for file, text in files.items()})},
        )
    for name, objs in _objs().items():
        yield "obj", name, {file: text.encode() for file, text in objs.items()}
    scratch = folder / "scratch" / "gltf"
    scratch.mkdir(parents=True)
    for name, of_one in gltf.files(scratch).items():
        yield "gltf", name, of_one
    yield from _around_a_mark(folder)


def _as_crates(folder: Path, name: str, files: dict[str, str]) -> dict[str, bytes]:
    """Write text layers as binary ones, which name each other accordingly."""
    from pxr import Sdf

    crates = {}
    scratch = folder / "scratch" / name
    scratch.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        layer = Sdf.Layer.CreateAnonymous(".usda")
        assert layer.ImportFromString(text.replace(".usda@", ".usdc@"))
        path = scratch / file.replace(".usda", ".usdc")
        assert layer.Export(str(path))
        crates[path.name] = path.read_bytes()
    return crates


def _package(files: dict[str, bytes]) -> bytes:
    from .archives import packed

    return packed(list(files.items()))


def _around_a_mark(folder: Path) -> Iterator[tuple[str, str, dict[str, bytes]]]:
    """Yield a marked file with key, names, manifest, evidence and store, each a kind of seed."""
    import meshmark.cli
    from meshmark.detection.sealing import SECRET_VARIABLE
    from meshmark.keys import Key

    scratch = folder / "scratch" / "mark"
    scratch.mkdir(parents=True)
    os.chdir(scratch)
    Key(KEY).save(Path("k"))
    secret_file(folder).write_text(f"meshmark-evidence-secret-1\n{SECRET.hex()}\n")
    os.environ[SECRET_VARIABLE] = str(secret_file(folder))
    Path("body.usda").write_text(_stages()["body"]["body.usda"])
    Path("names").write_text("# who got a copy\nacme\nglobex\n\nInitech GmbH\nMüller & Söhne\n")
    for arguments in (
        ["embed", "body.usda", "-o", "a.usdc", "--deliver", "--recipient", "acme", *QUICK],
        ["verify", "a.usdc", "--evidence", "e1", *QUICK],
        ["verify", "a.usdc", "--evidence", "e3"],
        ["verify", "a.usdc", "--store", STORE, *QUICK],
    ):
        sys.argv = ["meshmark", *arguments, "--key", "k"]
        with suppress(SystemExit):
            meshmark.cli.main()

    def read(*names: str) -> dict[str, bytes]:
        return {name: Path(name).read_bytes() for name in names}

    yield "key", "key", read("a.usdc", "k")
    yield "names", "names", read("a.usdc", "names")
    yield "manifest", "manifest", read("a.usdc", "a.usdc.meshmark.json")
    yield "evidence", "quick", read("a.usdc", "e1")
    yield "evidence", "all", read("a.usdc", "e3")
    yield "store", "store", read("a.usdc", *map(str, Path(STORE).iterdir()))


def _stages() -> dict[str, dict[str, str]]:
    return {
        "body": {"body.usda": HEAD + _ball("A", _PRIMVARS)},
        "parts": {"parts.usda": HEAD + _parts()},
        "composed": {
            "composed.usda": COMPOSED,
            "lod.usda": HEAD + _ball(),
            "sub.usda": HEAD + 'over "World" {\nover "Own" {\ndouble size = 3\n}\n}\n',
        },
        "clips": {
            "clips.usda": _with_faces(CLIPS),
            "clip.101.usda": HEAD + _ball(),
            "clip.102.usda": HEAD + _ball(),
            "manifest.usda": HEAD + 'over "A" {\npoint3f[] points\n}\n',
        },
        "skinned": {"skinned.usda": _skinned()},
    }


HEAD = """#usda 1.0
(
    defaultPrim = "A"
    upAxis = "Y"
    metersPerUnit = 0.01
    timeCodesPerSecond = 24
    startTimeCode = 1
    endTimeCode = 2
    doc = "seed"
    customLayerData = { string author = "somebody" }
)
"""
CUBE = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]


def _array(points: Any) -> str:
    return "[" + ", ".join(f"({x:.6g}, {y:.6g}, {z:.6g})" for x, y, z in points) + "]"


def _ball(name: str = "A", more: str = "") -> str:
    """A ball with horns, 162 points, that moves: any scheme can be tried on it, one marks it."""
    V, F = horned()
    samples = ", ".join(f"{time}: {_array(V * [1, 1, z])}" for time, z in ((1, 1.0), (2, 1.1)))
    return f"""
def Mesh "{name}"
{{
    int[] faceVertexCounts = {[3] * len(F)}
    int[] faceVertexIndices = {F.ravel().tolist()}
    point3f[] points.timeSamples = {{ {samples} }}
    {more}
}}
"""


def horned() -> tuple[Any, Any]:
    import numpy as np

    from meshmark.testing.meshes import bumpy_sphere

    horns = [[1, 0, 0], [-1, 0.2, 0], [0, 1, 0.1], [0, -1, 0.3], [0.1, 0, 1], [0, 0.2, -1]]
    return bumpy_sphere(2, np.array(horns))


def _parts() -> str:
    half = _array(CUBE)
    return f"""
def Xform "A"
{{
    {_ball("Ball")}
    def Mesh "Half"
    {{
        int[] faceVertexCounts = {[4] * 6}
        int[] faceVertexIndices = {FACES}
        point3h[] points = {half}
        int[] holeIndices = [1]
        int[] creaseIndices = [0, 1]
        int[] creaseLengths = [2]
        float[] creaseSharpnesses = [3]
    }}
    def Mesh "Double"
    {{
        int[] faceVertexCounts = [3, 5]
        int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 6, 7]
        point3d[] points = {half}
        uniform token orientation = "leftHanded"
        matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (4, 5, 6, 1) )
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:transform"]
    }}
    def Mesh "Guide"
    {{
        uniform token purpose = "guide"
        token visibility = "invisible"
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        rel material:binding = </A/Ball>
    }}
    def Points "Dots"
    {{
        point3f[] points = {half}
        float[] widths = [1]
    }}
    def BasisCurves "Hair"
    {{
        int[] curveVertexCounts = [4, 4]
        point3f[] points = {half}
        uniform token type = "linear"
    }}
    def PointInstancer "Many"
    {{
        point3f[] positions = [(0, 0, 0), (9, 9, 9)]
        int[] protoIndices = [0, 0]
        rel prototypes = </A/Ball>
    }}
}}
"""


_PRIMVARS = """
    float3[] extent = [(-3, -3, -3), (3, 3, 3)]
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1)] ( interpolation = "faceVarying" )
    int[] primvars:st:indices = [0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2]
    color3f[] primvars:displayColor = [(1, 0, 0)] ( interpolation = "constant" )
    normal3f[] normals = [(0, 0, 1)] ( interpolation = "constant" )
    point3f[] primvars:Pref = [(0, 0, 0), (1, 1, 1)] ( interpolation = "vertex" )
    float[] primvars:weight.timeSamples = { 1: [1, 2, 3, 4, 5, 6, 7, 8], 2: None }
    custom asset texture = @missing.<UDIM>.png@
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def GeomSubset "Side"
    {
        uniform token elementType = "face"
        int[] indices = [0, 1]
        uniform token familyName = "materialBind"
    }
"""

COMPOSED = """#usda 1.0
(
    defaultPrim = "World"
    subLayers = [ @./sub.usda@ (offset = 1; scale = 2) ]
    timeCodesPerSecond = 25
)
class "Base"
{
    token visibility = "inherited"
}
def Xform "World" (
    inherits = </Base>
    variants = { string look = "one" }
    prepend variantSets = "look"
)
{
    def "Ref" ( references = @./lod.usda@</A> (offset = 10) ) {}
    def "Pay" ( payload = @lod.usda@ ) {}
    def "Inst" ( instanceable = true
        references = [@lod.usda@, </World/Own>] ) {}
    def Xform "Own" ( specializes = </World/Ref> ) {}
    variantSet "look" = {
        "one" {
            def "V" ( references = @lod.usda@ ) {}
        }
        "two" {
            def "V" ( references = @gone.usda@ ) {}
        }
    }
}
"""

CLIPS = """#usda 1.0
(
    defaultPrim = "A"
    startTimeCode = 101
    endTimeCode = 102
)
def Mesh "A" (
    clips = {
        dictionary default = {
            string templateAssetPath = "./clip.###.usda"
            double templateStartTime = 101
            double templateEndTime = 102
            double templateStride = 1
            string primPath = "/A"
            asset manifestAssetPath = @./manifest.usda@
        }
        dictionary other = {
            asset[] assetPaths = [@clip.101.usda@]
            double2[] active = [(101, 0)]
            double2[] times = [(101, 1), (102, 2)]
            string primPath = "/A"
        }
    }
)
{
    int[] faceVertexCounts = COUNTS
    int[] faceVertexIndices = INDICES
}
"""

_BINDING = """
    rel skel:skeleton = </A/Bones>
    uniform matrix4d primvars:skel:geomBindTransform = ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))
    int[] primvars:skel:jointIndices = [0] (
        interpolation = "constant"
        elementSize = 1
    )
    float[] primvars:skel:jointWeights = [1] (
        interpolation = "constant"
        elementSize = 1
    )
    uniform token[] skel:blendShapes = ["smile"]
    rel skel:blendShapeTargets = </A/Skin/smile>
    def BlendShape "smile"
    {
        uniform vector3f[] offsets = [(0, 0, 1), (0, 1, 0)]
        uniform int[] pointIndices = [0, 7]
    }
"""


def _skinned() -> str:
    return f"""{HEAD}
def SkelRoot "A" (
    prepend apiSchemas = ["SkelBindingAPI"]
)
{{
    {_ball("Skin", _BINDING)}
    def Skeleton "Bones" ( prepend apiSchemas = ["SkelBindingAPI"] )
    {{
        uniform token[] joints = ["root"]
        uniform matrix4d[] bindTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))]
        uniform matrix4d[] restTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))]
        rel skel:animationSource = </A/Walk>
    }}
    def SkelAnimation "Walk"
    {{
        uniform token[] joints = ["root"]
        float3[] translations.timeSamples = {{ 1: [(0, 0, 0)], 2: [(1, 0, 0)] }}
        quatf[] rotations = [(1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1)]
        uniform token[] blendShapes = ["smile"]
        float[] blendShapeWeights.timeSamples = {{ 1: [0], 2: [1] }}
    }}
}}
"""


def _with_faces(text: str) -> str:
    _, F = horned()
    return text.replace("COUNTS", str([3] * len(F))).replace("INDICES", str(F.ravel().tolist()))


def _objs() -> dict[str, dict[str, str]]:
    V, F = horned()
    body = "".join(f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in V.tolist())
    body += "".join(f"f {a} {b} {c}\n" for a, b, c in (F + 1).tolist())
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE)
    quads = [FACES[i : i + 4] for i in range(0, 24, 4)]
    slashed = "".join("f " + " ".join(f"{i + 1}/1/1" for i in quad) + "\n" for quad in quads)
    mixed = (
        "# made by hand\nmtllib cube.mtl\no cube\n"
        + corners
        + "vt 0 0\nvt 1 0 0\nvn 0 0 1\ng side\nusemtl red\ns off\n"
        + slashed
        + "f 1//1 2//1 3//1\nf -1/-1 -2/-1 \\\n -3/-2\nl 1 2 3\np 1\nvp 0.5\ncurv 0 1 1 2\n"
    )
    frames = {f"ball.{n:04}.obj": body.replace("1.", f"1.{n}") for n in (1, 2, 3)}
    return {
        "single": {"body.obj": body},
        "mixed": {"mixed.obj": mixed},
        "frames": {f"frames/{name}": text for name, text in frames.items()},
    }
