"""Textures of a deliverable: still found from its new place, also those of a package."""

from __future__ import annotations

import shutil
from pathlib import Path

from pxr import Sdf, Usd, UsdUtils

from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from usd_stages import (
    cube,
    moved,
    write_text,
)


def test_textures_keep_resolving(tmp_path: Path) -> None:
    source_folder = tmp_path / "in"
    shader = """
    def Shader "tex"
    {
        asset inputs:file = @./tex/a.png@
        asset inputs:tiles = @./tex/b.<UDIM>.png@
        asset inputs:lost = @gone.png@
    }
    """
    info = """assetInfo = {
        asset identifier = @model.usda@
        string name = "model"
    }"""
    model = f'def Xform "M" (\n{info}\n)\n{{{cube()}{shader}}}'
    write_text(source_folder / "model.usda", model, 'defaultPrim = "M"')
    for name in ("a.png", "b.1001.png"):
        (source_folder / "tex").mkdir(exist_ok=True)
        (source_folder / "tex" / name).write_bytes(b"pixels")
    body = 'def "m" (references = @model.usda@)\n{\n}'
    source = write_text(source_folder / "scene.usda", body)
    output = tmp_path / "out" / "o.usda"
    output.parent.mkdir()
    original = read_stage(source)
    write_flattened(original, moved(original), output)
    layer = Sdf.Layer.FindOrOpen(str(output))
    paths = {
        name: layer.GetAttributeAtPath(f"/m/tex.inputs:{name}").default.path
        for name in ("file", "tiles", "lost")
    }
    assert paths == {
        "file": "../in/tex/a.png",
        "tiles": "../in/tex/b.<UDIM>.png",
        "lost": "gone.png",
    }
    stage = Usd.Stage.Open(layer)
    resolved = stage.GetAttributeAtPath("/m/tex.inputs:file").Get().resolvedPath
    assert Path(resolved).resolve() == (source_folder / "tex" / "a.png").resolve()
    # A path to the unmarked model would give it away.
    assert not layer.GetPrimAtPath("/m").HasInfo("assetInfo")


def test_textures_of_a_package_are_unpacked(tmp_path: Path) -> None:
    shader = 'def Shader "tex"\n{\nasset inputs:file = @./tex/a.png@\n}'
    write_text(tmp_path / "a.usda", cube() + shader, 'defaultPrim = "cube"')
    (tmp_path / "tex").mkdir()
    (tmp_path / "tex" / "a.png").write_bytes(b"pixels")
    package = tmp_path / "a.usdz"
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "a.usda")), str(package))
    shutil.rmtree(tmp_path / "tex")
    (tmp_path / "a.usda").unlink()
    original = read_stage(str(package))
    output = tmp_path / "o.usdc"
    write_flattened(original, moved(original), output)
    package.unlink()
    stage = Usd.Stage.Open(str(output))
    resolved = stage.GetAttributeAtPath("/tex.inputs:file").Get().resolvedPath
    assert Path(resolved).read_bytes() == b"pixels"
    assert (tmp_path / "o.usdc.assets").is_dir()
