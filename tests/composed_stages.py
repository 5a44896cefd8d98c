"""Small stages, one for each way USD composes a mesh; and some for two ways at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from usd_stages import CUBE_COUNTS, CUBE_INDICES, CUBE_POINTS, array, sampled, write_text

MODEL = 'defaultPrim = "M"'


@dataclass(frozen=True)
class Shape:
    """An animation to put into stages: faces, and three frames of points."""

    counts: list[int]
    corners: list[int]
    poses: tuple[FloatArray, ...]

    @classmethod
    def of(cls, faces: IntArray, poses: tuple[FloatArray, ...]) -> Shape:
        """Make it of triangles (F, 3) and points (N, 3)."""
        return cls([3] * len(faces), faces.ravel().tolist(), poses)

    @cached_property
    def faces(self) -> str:
        """The statements of its faces."""
        return f"int[] faceVertexCounts = {self.counts}\nint[] faceVertexIndices = {self.corners}\n"

    def pose(self, scale: float = 1.0) -> str:
        """Return the statement of points that stand still."""
        return f"point3f[] points = {array(scale * self.poses[0])}"

    def walk(self, *times: float, scale: float = 1.0) -> str:
        """Return the statement of points that move, by default at the times 1, 2 and 4."""
        frames = zip(times or (1.0, 2.0, 4.0), self.poses, strict=False)
        return sampled({time: scale * points for time, points in frames})

    def mesh(self, points: str | None = None, more: str = "", name: str = "m") -> str:
        """Return the text of a mesh: walking, unless told otherwise."""
        points = self.walk() if points is None else points
        return f'def Mesh "{name}"\n{{\n{self.faces}{points}\n{more}\n}}\n'


CUBE = Shape(
    CUBE_COUNTS,
    CUBE_INDICES,
    (CUBE_POINTS, CUBE_POINTS + np.float32(1), CUBE_POINTS * np.float32(2)),
)

Build = Callable[[Path, Shape], str]


def write(path: Path, body: str, metadata: str = "") -> str:
    """Write a text layer: USD wants what is in braces on lines of its own."""
    return write_text(path, body.replace("{ ", "{\n").replace(" }", "\n}"), metadata)


def referenced(folder: Path, shape: Shape) -> str:
    """A model referenced twice, once moved by an animated transform; and once in the same layer."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = """
    def "a" (references = @model.usda@) {}
    def "b" (references = @model.usda@</M>)
    {
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (20, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def "c" (references = </b>) {}
    """
    return write(folder / "scene.usda", body)


def with_payload(folder: Path, shape: Shape) -> str:
    """A payload, of which the scene says more than the payload does."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = """
    def "a" (payload = @model.usda@)
    {
        over "m" { color3f[] primvars:displayColor = [(1, 0, 0)] }
    }
    """
    return write(folder / "scene.usda", body)


def sublayered(folder: Path, shape: Shape) -> str:
    """Three layers: the weakest has a mesh, the next its samples, the strongest its default."""
    mesh = shape.mesh(shape.pose(2.0))
    write(folder / "weak.usda", f'def Xform "M"\n{{{mesh}{shape.mesh(name="n")}}}')
    body = f'over "M" {{ over "m" {{ {shape.walk()} }} }}'
    write(folder / "sub" / "middle.usda", body)
    # A default hides the samples of weaker layers.
    body = f'over "M" {{ over "n" {{ {shape.pose()} }} }}'
    return write(
        folder / "scene.usda", body, "subLayers = [@sub/middle.usda@, @weak.usda@]\n" + MODEL
    )


def inherited(folder: Path, shape: Shape) -> str:
    """A class with a mesh; one heir says something of its own of the points, one does not."""
    body = f"""
    class Xform "_body" {{ {shape.mesh()} }}
    def "a" (inherits = </_body>) {{}}
    def "b" (inherits = </_body>) {{ over "m" {{ {shape.walk(scale=2.0)} }} }}
    """
    return write(folder / "scene.usda", body)


def specialized(folder: Path, shape: Shape) -> str:
    """A prim that specializes another, which is itself referenced."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = """
    def "base" (references = @model.usda@) {}
    def "special" (specializes = </base>)
    {
        over "m" { uniform token subdivisionScheme = "none" }
    }
    """
    return write(folder / "scene.usda", body)


def _clips(folder: Path, shape: Shape, times: str) -> str:
    """Write two clips, and return the metadata of a prim that plays them."""
    for name, points in (("c1", shape.walk(1, 2)), ("c2", shape.walk(1, 2, scale=2.0))):
        write(folder / f"{name}.usda", f'over "m" {{ {points} }}')
    write(folder / "manifest.usda", 'over "m"\n{\npoint3f[] points\n}')
    return f"""clips = {{
        dictionary default = {{
            asset[] assetPaths = [@./c1.usda@, @./c2.usda@]
            asset manifestAssetPath = @./manifest.usda@
            string primPath = "/m"
            double2[] active = [(1, 0), (3, 1)]
            double2[] times = {times}
        }}
    }}"""


def clipped(folder: Path, shape: Shape) -> str:
    """Value clips, one after the other."""
    clips = _clips(folder, shape, "[(1, 1), (2, 2), (3, 1), (4, 2)]")
    mesh = shape.mesh("").replace('Mesh "m"', f'Mesh "m" (\n{clips}\n)')
    return write(folder / "scene.usda", mesh)


def clipped_and_moved_in_time(folder: Path, shape: Shape) -> str:
    """Value clips in a model that is referenced twice as slow, and later."""
    clips = _clips(folder, shape, "[(1, 1), (2, 2), (3, 1), (4, 2)]")
    mesh = shape.mesh("").replace('Mesh "m"', f'Mesh "m" (\n{clips}\n)')
    write(folder / "model.usda", f'def Xform "M"\n{{{mesh}}}', MODEL)
    body = 'def "a" (references = @model.usda@ (offset = 10; scale = 2)) {}'
    return write(folder / "scene.usda", body)


def moved_in_time(folder: Path, shape: Shape) -> str:
    """A reference, and a sublayer that holds a payload, each with an offset and a scale."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = 'def "b" (payload = @model.usda@ (offset = 1; scale = 0.5)) {}'
    write(folder / "late.usda", body)
    body = 'def "a" (references = @model.usda@ (offset = 100; scale = 2)) {}'
    layers = "subLayers = [@late.usda@ (offset = 10; scale = 3)]"
    return write(folder / "scene.usda", body, layers)


def other_clocks(folder: Path, shape: Shape) -> str:
    """Layers with other time codes a second than the scene, sublayered and referenced."""
    clock = MODEL + "\ntimeCodesPerSecond = 48"
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', clock)
    write(folder / "sub.usda", 'def "b" (references = @model.usda@) {}', clock)
    body = 'def "a" (references = @model.usda@) {}'
    return write(folder / "scene.usda", body, "timeCodesPerSecond = 30\nsubLayers = [@sub.usda@]")


def purposes_and_visibility(folder: Path, shape: Shape) -> str:
    """Meshes for rendering and as a proxy, one hidden at times, and one that is switched off."""
    hidden = 'token visibility.timeSamples = { 1: "invisible", 2: "inherited" }'
    body = f"""
    def Xform "M"
    {{
        {shape.mesh(name="render", more='uniform token purpose = "render"')}
        {shape.mesh(shape.pose(), name="proxy", more='uniform token purpose = "proxy"')}
        {shape.mesh(name="guide", more='uniform token purpose = "guide"')}
        {shape.mesh(name="hidden", more=hidden)}
        {shape.mesh(name="off").replace('"off"', '"off" (active = false)')}
    }}
    """
    return write(folder / "scene.usda", body)


def point_instanced(folder: Path, shape: Shape) -> str:
    """A point instancer that shows two prototypes many times: one its own, one referenced."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = f"""
    def PointInstancer "crowd"
    {{
        point3f[] positions = [(0, 0, 0), (9, 0, 0), (18, 0, 0), (27, 0, 0)]
        int[] protoIndices = [0, 1, 0, 1]
        rel prototypes = [</crowd/own>, </crowd/kept/other>]
        {shape.mesh(name="own")}
        def "kept" {{ def "other" (references = @model.usda@) {{}} }}
    }}
    """
    return write(folder / "scene.usda", body)


def beside_instances(folder: Path, shape: Shape) -> str:
    """A plain reference beside two instances of the same model, one of them nested."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    write(
        folder / "set.usda",
        'def "M" { def "in" (references = @model.usda@\ninstanceable = true) {} }',
        MODEL,
    )
    body = """
    def "plain" (references = @model.usda@) {}
    def "one" (references = @model.usda@
        instanceable = true) {}
    def "set" (references = @set.usda@
        instanceable = true) {}
    """
    return write(folder / "scene.usda", body)


def shared_instances(folder: Path, shape: Shape) -> str:
    """Instances of a model with other inherits, in a set of instances, moved, and slower."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    write(
        folder / "set.usda",
        'def "M" { def "x" (references = @model.usda@\ninstanceable = true) {}\n'
        'def "y" (references = @model.usda@\ninstanceable = true) {} }',
        MODEL,
    )
    body = f"""
    class "_red" {{ over "m" {{ color3f[] primvars:displayColor = [(1, 0, 0)] }} }}
    class "_still" {{ over "m" {{ {shape.pose()} }} }}
    def "a" (references = @model.usda@
        inherits = </_red>
        instanceable = true)
    {{
        double3 xformOp:translate = (9, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def "b" (references = @model.usda@
        inherits = </_red>
        instanceable = true)
    {{
        double xformOp:rotateZ = 30
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    }}
    def "late" (references = @model.usda@ (offset = 10)
        instanceable = true) {{}}
    def "still" (references = @model.usda@
        inherits = [</_still>, </_red>]
        instanceable = true) {{}}
    def "one" (payload = @set.usda@
        instanceable = true) {{}}
    def "two" (payload = @set.usda@
        instanceable = true) {{}}
    """
    return write(folder / "scene.usda", body)


def instances_of_variants(folder: Path, shape: Shape) -> str:
    """Instances that select other variants; and some in a variant of what is around them."""
    _detailed(folder / "model.usda", shape)

    def instance(name: str, lod: str, arc: str = "references = @model.usda@") -> str:
        choice = f'variants = {{ string lod = "{lod}" }}'
        return f'def "{name}" ({arc}\n{choice}\ninstanceable = true) {{}}\n'

    body = f"""
    {instance("a", "high")}{instance("b", "low")}{instance("c", "high")}
    def "d" {sets("many", many="yes")}
    {{
        variantSet "many" = {{
            {variant("yes", instance("e", "low") + instance("f", "high"))}
            {variant("no", "")}
        }}
    }}
    """
    return write(folder / "scene.usda", body)


def shown_elsewhere(folder: Path, shape: Shape) -> str:
    """A model of the scene, and an instance of it that shows what it shows."""
    body = f"""
    def Xform "model" {{ {shape.mesh()} }}
    def "copy" (references = </model>
        instanceable = true)
    {{
        double3 xformOp:translate = (9, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    """
    return write(folder / "scene.usda", body)


def moved_in_namespace(folder: Path, shape: Shape) -> str:
    """A model of which a mesh was moved to another place by a relocation."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = 'def "a" (references = @model.usda@) {}\ndef "b" {}'
    return write(folder / "scene.usda", body, "relocates = {</a/m>: </b/n>}")


def named_by_expressions(folder: Path, shape: Shape) -> str:
    """A reference whose path is an expression of a variable of the stage."""
    write(folder / "model.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    body = 'def "a" (references = @`"./${WHICH}.usda"`@) {}'
    return write(folder / "scene.usda", body, 'expressionVariables = { string WHICH = "model" }')


def variant(name: str, body: str, opinion: str = "") -> str:
    """Return the text of one variant."""
    return f'"{name}" {opinion} {{ {body} }}\n'


def sets(*names: str, **selected: str) -> str:
    """Return the metadata of a prim that has sets of variants."""
    chosen = "".join(f'string {name} = "{each}"\n' for name, each in selected.items())
    listed = ", ".join(f'"{name}"' for name in names)
    return f"(\nprepend variantSets = [{listed}]\nvariants = {{ {chosen} }}\n)"


def variants_of_shape(folder: Path, shape: Shape) -> str:
    """A model with two levels of detail, one without the mesh; and colours that do not shape it."""
    return _detailed(folder / "scene.usda", shape)


def _detailed(path: Path, shape: Shape) -> str:
    red = 'over "m" { color3f[] primvars:displayColor = [(1, 0, 0)] }'
    body = f"""
    def Xform "M" {sets("lod", "colour", lod="low", colour="red")}
    {{
        variantSet "lod" = {{
            {variant("low", shape.mesh(shape.walk(scale=2.0)))}
            {variant("high", shape.mesh())}
            {variant("none", "")}
        }}
        variantSet "colour" = {{ {variant("red", red)} {variant("blue", "")} }}
    }}
    """
    return write(path, body, MODEL)


def variants_behind_references(folder: Path, shape: Shape) -> str:
    """Two references to a model with variants, of which each scene selects another."""
    _detailed(folder / "model.usda", shape)
    body = """
    def "a" (references = @model.usda@) {}
    def "b" (references = @model.usda@ (offset = 10)
        variants = { string lod = "high" })
    {
    }
    """
    return write(folder / "scene.usda", body)


def variants_with_arcs(folder: Path, shape: Shape) -> str:
    """Variants that reference, inherit, or load other models; also with an offset in time."""
    write(folder / "one.usda", f'def Xform "M"\n{{{shape.mesh()}}}', MODEL)
    write(folder / "two.usda", f'def Xform "M"\n{{{shape.mesh(shape.walk(scale=2.0))}}}', MODEL)
    body = f"""
    class "_own" {{ {shape.mesh(shape.pose())} }}
    def "a" {sets("model", model="one")}
    {{
        variantSet "model" = {{
            {variant("one", "", "(payload = @one.usda@ (offset = 3))")}
            {variant("two", "", "(references = @two.usda@)")}
            {variant("own", "", "(inherits = </_own>)")}
        }}
    }}
    """
    return write(folder / "scene.usda", body)


def variants_in_variants(folder: Path, shape: Shape) -> str:
    """Two sets on one prim that both shape a mesh, and a set in a variant of one of them."""

    def walking(scale: float) -> str:
        return f'over "b" {{ over "m" {{ {shape.walk(scale=scale)} }} }}'

    sizes = f"""
    variantSet "size" = {{ {variant("s", walking(0.5))} {variant("l", walking(3.0))} }}
    """
    body = f"""
    def "a" {sets("first", "second", first="x", second="p")}
    {{
        variantSet "first" = {{
            {variant("x", walking(1.0))}
            {variant("y", walking(2.0))}
            {variant("z", sizes, sets("size", size="s"))}
        }}
        variantSet "second" = {{ 
            {variant("p", f'over "b" {{ {shape.mesh("")} }}')}
            {variant("q", "")}
        }}
        def "b" {{}}
    }}
    """
    return write(folder / "scene.usda", body)


def variants_that_select_others(folder: Path, shape: Shape) -> str:
    """A set of which each variant selects one of another set, which shapes the mesh."""

    def selecting(size: str) -> str:
        return f'over "b" ( variants = {{ string size = "{size}" }} ) {{}}'

    body = f"""
    def "a" {sets("look", look="young")}
    {{
        variantSet "look" = {{
            {variant("young", selecting("s"))}
            {variant("old", selecting("l"))}
        }}
        def "b" (prepend variantSets = "size")
        {{
            variantSet "size" = {{
                {variant("s", shape.mesh())}
                {variant("l", shape.mesh(shape.walk(scale=2.0)))}
            }}
        }}
    }}
    """
    return write(folder / "scene.usda", body)


def variants_of_clips(folder: Path, shape: Shape) -> str:
    """Variants that play other value clips."""
    one = _clips(folder, shape, "[(1, 1), (2, 2), (3, 1), (4, 2)]")
    two = _clips(folder, shape, "[(1, 1), (3, 2), (4, 1), (7, 2)]")
    body = f"""
    def Xform "M" {sets("walk", walk="fast")}
    {{
        def Mesh "m" {{ {shape.faces} }}
        variantSet "walk" = {{
            {variant("fast", f'over "m" ( {one} ) {{}}')}
            {variant("slow", f'over "m" ( {two} ) {{}}')}
        }}
    }}
    """
    return write(folder / "scene.usda", body)


ARCS: Mapping[str, Build] = {
    build.__name__: build
    for build in (
        referenced,
        with_payload,
        sublayered,
        inherited,
        specialized,
        clipped,
        clipped_and_moved_in_time,
        moved_in_time,
        other_clocks,
        purposes_and_visibility,
        point_instanced,
        beside_instances,
        shared_instances,
        instances_of_variants,
        moved_in_namespace,
        named_by_expressions,
        variants_of_shape,
        variants_behind_references,
        variants_with_arcs,
        variants_in_variants,
        variants_that_select_others,
        variants_of_clips,
    )
}
