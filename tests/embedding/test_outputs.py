"""No output may be a file of the source, by whatever name, and no name may be too long."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from meshmark.commands.attack import write_attacked
from meshmark.embedding.outputs import check_output
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from usd_stages import cube, moved, write_text

HIDDEN = {
    "lod1.usda": "a variant that is not selected",
    "inside.usda": "a layer of that variant",
    "payload.usda": "a payload",
    "clip.1.usda": "a clip",
    "clips.usda": "the clips' manifest",
    "texture.usdc": "a texture, by its name a layer",
    "tile.1001.usda": "a tile",
    "listed.usda": "in a dictionary of metadata",
    "sampled.usda": "a time sample",
    "missing.usda": "not there yet",
}


def digests(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture
def source(tmp_path: Path) -> str:
    for name in HIDDEN.keys() - {"missing.usda"}:
        write_text(tmp_path / name, cube(), 'defaultPrim = "cube"')
    inner = 'def "in" (references = @./inside.usda@)\n{\n}'
    write_text(tmp_path / "lod1.usda", f'def "cube"\n{{\n{inner}\n}}', 'defaultPrim = "cube"')
    body = f"""
    def "A" (
        variants = {{
            string lod = "lod0"
        }}
        prepend variantSets = "lod"
        clips = {{
            dictionary default = {{
                string templateAssetPath = "./clip.#.usda"
                double templateStartTime = 1
                double templateEndTime = 1
                double templateStride = 1
                asset manifestAssetPath = @./clips.usda@
                string primPath = "/cube"
            }}
        }}
    )
    {{
        asset one = @./texture.usdc@
        asset tiles = @./tile.<UDIM>.usda@
        asset sampled.timeSamples = {{ 1: @./sampled.usda@, 2: @./missing.usda@ }}
        variantSet "lod" = {{
            "lod0" {{
                {cube()}
            }}
            "lod1" (
                references = @./lod1.usda@
            ) {{
                def "more" (
                    payload = @./payload.usda@
                )
                {{
                }}
            }}
        }}
    }}
    """
    listed = "customLayerData = {\nasset[] more = [@./listed.usda@]\n}"
    return write_text(tmp_path / "src.usda", body, listed)


@pytest.mark.parametrize("name", HIDDEN)
def test_whatever_the_source_could_use_stays(tmp_path: Path, source: str, name: str) -> None:
    original = read_stage(source)
    before = digests(tmp_path)
    for write in (write_override, write_flattened):
        with pytest.raises(OutputError, match="part of the source"):
            write(original, moved(original), tmp_path / name)
    with pytest.raises(OutputError, match="part of the source"):
        write_attacked(moved(original), tmp_path / name)
    with pytest.raises(OutputError, match="part of the source"):
        check_output(tmp_path / name, source, deliver=False)
    assert digests(tmp_path) == before


def test_other_names_of_a_file_are_it(tmp_path: Path, source: str) -> None:
    (tmp_path / "soft.usda").symlink_to("lod1.usda")
    (tmp_path / "hard.usda").hardlink_to(tmp_path / "lod1.usda")
    (tmp_path / "loop").symlink_to(tmp_path)
    for name in ("soft.usda", "hard.usda", "LOD1.usda", "loop/lod1.usda", "loop/../src.USDA"):
        with pytest.raises((OutputError, UsageError), match="source"):
            check_output(tmp_path / name, source, deliver=True)
    check_output(tmp_path / "lod2.usda", source, deliver=True)


def test_a_link_in_the_source_is_followed(tmp_path: Path) -> None:
    write_text(tmp_path / "real.usda", cube())
    (tmp_path / "alias.usda").symlink_to("real.usda")
    source = write_text(tmp_path / "src.usda", "", "subLayers = [@./alias.usda@]")
    for name in ("real.usda", "alias.usda"):
        with pytest.raises(OutputError, match="part of the source"):
            check_output(tmp_path / name, source, deliver=False)


def test_what_is_written_beside_the_output_counts(tmp_path: Path) -> None:
    for name in ("o.usda.meshmark.json", "o.usda.assets/a.png", "O.usdc.Assets/a.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
        source = write_text(
            tmp_path / "src.usda", f'{cube()}\ndef X "x"\n{{\nasset t = @./{name}@\n}}'
        )
        output = tmp_path / f"{name.split('.')[0].lower()}.{'usdc' if 'usdc' in name else 'usda'}"
        with pytest.raises(OutputError, match="part of the source"):
            check_output(output, source, deliver=True)


def test_what_is_in_the_way(tmp_path: Path) -> None:
    source = write_text(tmp_path / "src.usda", cube())
    (tmp_path / "a.usda.assets").symlink_to(tmp_path)
    (tmp_path / "b.usda.assets").write_bytes(b"")
    (tmp_path / "c.usda.meshmark.json").mkdir()
    for name in ("a.usda", "b.usda", "c.usda"):
        with pytest.raises(OutputError):
            check_output(tmp_path / name, source, deliver=True)
    check_output(tmp_path / "a.usda", source, deliver=False)


@pytest.mark.parametrize("name", ["o" * 245, "o" * 252, "ö" * 120])
def test_names_without_room_for_the_manifest_are_refused(tmp_path: Path, name: str) -> None:
    source = write_text(tmp_path / "src.usda", cube())
    with pytest.raises(OutputError, match="bytes"):
        check_output(tmp_path / f"{name}.usda", source, deliver=False)
    check_output(tmp_path / f"{name[:100]}.usda", source, deliver=False)


def test_frames_of_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in (1, 2):
        (folder / f"{number}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    pattern = str(folder / "*.obj")
    for output, source in [
        (folder / "1.obj", folder),
        (folder / "1.OBJ", folder),
        (folder / "3.obj", folder),
        (folder / "1.obj", pattern),
        (folder / "3.obj", pattern),
        (tmp_path, folder),
        (tmp_path, pattern),
    ]:
        with pytest.raises(OutputError, match="the source"):
            check_output(output, source, deliver=False)
    check_output(folder / "3.obj", str(folder / "1.obj"), deliver=False)
    check_output(tmp_path / "marked", folder, deliver=False)


def test_capital_suffixes_are_suffixes(tmp_path: Path) -> None:
    V = np.eye(4, 3)
    F = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    mesh = MeshAnimation.from_arrays(V, F, prim="/M")
    write_attacked(Asset("memory", (mesh,), "memory"), tmp_path / "A.USDA")
    original = read_stage(str(tmp_path / "A.USDA"))
    write_flattened(original, moved(original), tmp_path / "B.USDC")
    write_override(original, moved(original), tmp_path / "C.Usd")
    for name in ("B.USDC", "C.Usd"):
        assert (tmp_path / name).read_bytes().startswith(b"PXR-USDC")
        assert Sdf.Layer.FindOrOpen(str(tmp_path / name))
        assert read_stage(str(tmp_path / name)).meshes[0].prim == "/M"


@pytest.mark.parametrize(
    "path",
    ["./loop1", f"./{'x' * 5000}.png", f"/{'x/' * 3000}a.png", "[x]", "~someone/a.png", "<UDIM>"],
    ids=["circle of links", "long name", "long path", "brackets", "home", "tiles only"],
)
def test_strange_names_in_the_source_are_no_bugs(tmp_path: Path, path: str) -> None:
    (tmp_path / "loop1").symlink_to("loop2")
    (tmp_path / "loop2").symlink_to("loop1")
    source = write_text(tmp_path / "src.usda", f'{cube()}def "x"\n{{\nasset t = @{path}@\n}}')
    check_output(tmp_path / "o.usda", source, deliver=True)
    original = read_stage(source)
    try:
        write_flattened(original, moved(original), tmp_path / "o.usda")
    except OutputError:
        assert path == "[x]"
    else:
        assert "someone" not in (tmp_path / "o.usda").read_text()
