"""A variant that is asked for is read and marked; the others stay as they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdUtils

from composed_stages import ARCS, CUBE, sets, variant, write
from meshmark.embedding.file import mark_file
from meshmark.errors import OutputError, UsageError
from meshmark.keys import Key
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.variants import Choice, chosen, select
from meshmark.usd.writing import write_override
from stage_comparison import MOVED, differences
from usd_stages import moved

# What is asked for, and what that selects and marks.
CASES: Sequence[tuple[str, tuple[str, ...], tuple[str, ...], dict[str, tuple[str, ...]]]] = (
    ("variants_of_shape", ("lod=high",), ("/M{lod=high}",), {"/M/m": ("/M{lod=high}",)}),
    ("variants_of_shape", ("colour=blue",), ("/M{colour=blue}",), {"/M/m": ("/M{lod=low}",)}),
    (
        "variants_behind_references",
        ("lod=low", "/a{lod=high}"),
        ("/a{lod=high}", "/b{lod=low}"),
        {"/a/m": ("/a{lod=high}",), "/b/m": ("/b{lod=low}",)},
    ),
    ("variants_with_arcs", ("model=two",), ("/a{model=two}",), {"/a/m": ("/a{model=two}",)}),
    ("variants_with_arcs", ("model=own",), ("/a{model=own}",), {"/a/m": ("/a{model=own}",)}),
    ("variants_in_variants", (), (), {"/a/b/m": ("/a{first=x}", "/a{second=p}")}),
    (
        "variants_in_variants",
        ("size=l", "first=z"),
        ("/a{first=z}", "/a{size=l}"),
        {"/a/b/m": ("/a{first=z}", "/a{second=p}", "/a{size=l}")},
    ),
    (
        "variants_that_select_others",
        ("look=old",),
        ("/a{look=old}",),
        {"/a/b/m": ("/a{look=old}", "/a/b{size=l}")},
    ),
    ("variants_of_clips", ("walk=slow",), ("/M{walk=slow}",), {"/M/m": ("/M{walk=slow}",)}),
)


def shown(source: object, *selected: str) -> Usd.Stage:
    stage = Usd.Stage.Open(str(source))
    select(stage, map(Choice.parse, selected))
    return stage


def is_defined(stage: Usd.Stage, path: str) -> bool:
    prim = stage.GetPrimAtPath(path)
    return bool(prim and prim.IsDefined())


@pytest.mark.parametrize(("arc", "asked", "selected", "marked_in"), CASES)
def test_the_variants_asked_for_are_marked_and_no_others(
    tmp_path: Path,
    arc: str,
    asked: tuple[str, ...],
    selected: tuple[str, ...],
    marked_in: dict[str, tuple[str, ...]],
) -> None:
    source = ARCS[arc](tmp_path, CUBE)
    original = read_stage(source, variants=asked)
    assert sorted(original.variants) == sorted(selected)
    marked = moved(original)
    output = tmp_path / "marked.usda"
    done = write_override(original, marked, output)
    told = {each["prim"]: each for each in done.as_json()["variants"]}
    assert {prim: tuple(each["marked_in"]) for prim, each in told.items()} == marked_in
    allowed = dict.fromkeys(marked_in, MOVED)
    assert differences(shown(source, *selected), shown(output), allowed) == []
    for before, after in zip(marked.meshes, read_stage(str(output)).meshes, strict=True):
        np.testing.assert_array_equal(before.times, after.times)
        for expected, frame in zip(before, after, strict=True):
            np.testing.assert_allclose(frame.points, expected.points, rtol=0, atol=1e-5)
    for prim, each in told.items():
        for other in each["as_they_are"]:
            before, after = (shown(name, *selected, other) for name in (source, output))
            # Where no mesh is defined, points show nothing.
            own = {
                mesh: names
                for mesh, names in allowed.items()
                if mesh != prim or not is_defined(before, mesh)
            }
            assert differences(before, after, own) == []


def test_variants_that_do_not_shape_a_mesh_share_its_mark(tmp_path: Path) -> None:
    source = ARCS["variants_of_shape"](tmp_path, CUBE)
    marked = moved(read_stage(source))
    write_override(read_stage(source), marked, tmp_path / "o.usda")
    blue = read_stage(str(tmp_path / "o.usda"), variants=["colour=blue"]).meshes[0]
    for expected, frame in zip(marked.meshes[0], blue, strict=True):
        np.testing.assert_allclose(frame.points, expected.points, rtol=0, atol=1e-5)


def test_a_deliverable_holds_the_variant_asked_for(tmp_path: Path) -> None:
    source = ARCS["variants_of_shape"](tmp_path, CUBE)
    original = read_stage(source, variants=["lod=high"])
    marked = moved(original)
    write_flattened(original, marked, tmp_path / "o.usda")
    assert "variant" not in (tmp_path / "o.usda").read_text()
    again = read_stage(str(tmp_path / "o.usda")).meshes[0]
    np.testing.assert_allclose(again[1].points, marked.meshes[0][1].points, rtol=0, atol=1e-5)


def variants_of_a_class(path: Path) -> str:
    """Write a stage in which they are stronger than those of the heir."""
    levels = variant("low", CUBE.mesh(CUBE.walk(scale=2.0))) + variant("high", CUBE.mesh())
    body = f"""
    class "_c" {sets("lod")} {{ variantSet "lod" = {{ {levels} }} }}
    def "a" ( inherits = </_c>
        variants = {{ string lod = "low" }} ) {{}}
    """
    return write(path, body)


BEATEN = r"/a/m: its shape depends on /a\{lod=low\}"


def test_what_wins_over_every_variant_is_refused(tmp_path: Path) -> None:
    original = read_stage(variants_of_a_class(tmp_path / "a.usda"))
    with pytest.raises(OutputError, match=BEATEN):
        write_override(original, moved(original), tmp_path / "o.usda")
    assert not (tmp_path / "o.usda").exists()


def test_it_is_refused_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meshmark.embedding.file.embed", lambda *_, **__: pytest.fail("work"))
    source = variants_of_a_class(tmp_path / "a.usda")
    with pytest.raises(OutputError, match=BEATEN) as error:
        mark_file(source, tmp_path / "o.usda", Key(bytes(32)))
    assert error.value.exit_code == 3
    assert [path.name for path in tmp_path.iterdir()] == ["a.usda"]


def test_a_package_has_variants_too(tmp_path: Path) -> None:
    layer = ARCS["variants_of_shape"](tmp_path, CUBE)
    package = tmp_path / "scene.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(layer), str(package))
    Path(layer).unlink()
    original = read_stage(str(package), variants=["lod=high"])
    done = write_override(original, moved(original), tmp_path / "o.usda")
    assert done.in_variants["/M/m"].variants == (Choice("/M", "lod", "high"),)
    for before, after in zip(
        moved(original).meshes[0], read_stage(str(tmp_path / "o.usda")).meshes[0], strict=True
    ):
        np.testing.assert_allclose(after.points, before.points, rtol=0, atol=1e-5)


def test_a_set_that_each_variant_shows_one_deeper(tmp_path: Path) -> None:
    """Prims that are there only because a variant above is selected are asked as well."""
    body = CUBE.mesh()
    for name in "cba":
        levels = variant("high", body) + variant("low", "")
        body = f"""
        def Xform "{name}" {sets("lod", lod="low")} {{ variantSet "lod" = {{ {levels} }} }}
        """
    asset = read_stage(write(tmp_path / "a.usda", body), variants=["lod=high"])
    assert asset.variants == ("/a{lod=high}", "/a/b{lod=high}", "/a/b/c{lod=high}")
    assert [mesh.prim for mesh in asset.meshes] == ["/a/b/c/m"]


@pytest.mark.parametrize(
    "text", ["", "lod", "lod=", "=high", "/a", "/a{lod}", "{lod=high}", "a{lod=high}", "/a{l=h}b"]
)
def test_what_is_no_variant(text: str) -> None:
    with pytest.raises(UsageError, match=r"a variant is SET=NAME or PRIM\{SET=NAME\}"):
        Choice.parse(text)


def test_a_variant_that_is_not_there(tmp_path: Path) -> None:
    source = ARCS["variants_of_shape"](tmp_path, CUBE)
    told = r"scene.usda: no variant lod=hi; there is /M\{lod=high\}, .* /M\{colour=red\}"
    with pytest.raises(UsageError, match=told):
        read_stage(source, variants=["lod=hi"])
    with pytest.raises(UsageError, match=r"no variant /M/m\{lod=high\}"):
        read_stage(source, variants=["/M/m{lod=high}"])
    assert read_stage(source, variants=["lod=hi"], strict=False).variants == ()


def test_a_variant_inside_an_instance(tmp_path: Path) -> None:
    write(tmp_path / "set.usda", 'def "S" { def "M" (references = @scene.usda@) {} }')
    ARCS["variants_of_shape"](tmp_path, CUBE)
    body = 'def "a" (references = @set.usda@</S>\ninstanceable = true) {}'
    stage = Usd.Stage.Open(write(tmp_path / "a.usda", body))
    with pytest.raises(UsageError, match="no layer can select a variant inside an instance"):
        chosen(stage, ["/a/M{lod=high}"])
