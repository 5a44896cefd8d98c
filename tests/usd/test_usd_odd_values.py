"""A binary layer may hold values that are not of their field's type: nothing trips over them."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Sdf

from meshmark.usd.checking import Finding, check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from usd_stages import cube, moved

# A field of another type whose name is as long, so that the one can be put for the other.
SWAPS = {
    "documentation of a layer": ("(startTimeCode = 2)", cube("m"), "startTimeCode"),
    "data of a layer": ("(framesPerSecond = 2)", cube("m"), "framesPerSecond"),
    "documentation of a prim": ("", cube("m", more='reorder properties = ["a"]'), "propertyOrder"),
    "data of a prim": ("", cube("m").replace('"m"', '"m" (permission = private)'), "permission"),
}
FIELDS = {
    "startTimeCode": "documentation",
    "framesPerSecond": "customLayerData",
    "propertyOrder": "documentation",
    "permission": "customData",
}


def odd_layer(folder: Path, case: str) -> tuple[Path, str]:
    metadata, body, field = SWAPS[case]
    (folder / "s.usda").write_text(f"#usda 1.0\n{metadata}\n{body}")
    source = folder / "s.usdc"
    Sdf.Layer.OpenAsAnonymous(str(folder / "s.usda")).Export(str(source))
    content = source.read_bytes()
    assert content.count(field.encode()) == 1
    source.write_bytes(content.replace(field.encode(), FIELDS[field].encode()))
    return source, FIELDS[field]


@pytest.mark.parametrize("keep_metadata", [False, True])
@pytest.mark.parametrize("case", SWAPS)
def test_it_is_delivered_without_them(tmp_path: Path, case: str, keep_metadata: bool) -> None:
    source, _ = odd_layer(tmp_path, case)
    original = read_stage(str(source))
    output = tmp_path / "o.usda"
    write_flattened(original, moved(original), output, keep_metadata=keep_metadata)
    assert len(read_stage(str(output)).meshes) == 1


@pytest.mark.parametrize("case", SWAPS)
def test_they_are_found_from_outside(tmp_path: Path, case: str) -> None:
    source, field = odd_layer(tmp_path, case)
    where = "/m" if case.endswith("prim") else "/"
    assert check_stage(str(source)) == [Finding("metadata", where, field)]
