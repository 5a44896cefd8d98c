"""What Blender makes of a marked copy: imported, treated, exported, through other formats too.

    python tests/clients/blender.py MARKED FOLDER

Needs Blender as a Python module (`pip install bpy`, 4.2 or newer). Writes one file for each trip
into FOLDER; `tests/test_clients.py` verifies those that were kept in `tests/clients/blender`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy

USD = {
    "export_uvmaps": False,
    "export_normals": False,
    "export_materials": False,
    "export_mesh_colors": False,
}


def the_mesh() -> bpy.types.Object:
    """Return the only mesh of the scene, and select it."""
    [mesh] = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    bpy.ops.object.select_all(action="DESELECT")
    mesh.select_set(True)
    bpy.context.view_layer.objects.active = mesh
    return mesh


def begin(marked: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(marked))
    the_mesh()


def keep_one_frame() -> None:
    """Turn what the file says of the present frame into the mesh's own shape."""
    mesh = the_mesh()
    for modifier in list(mesh.modifiers):
        bpy.ops.object.modifier_apply(modifier=modifier.name)


def export(path: Path, animated: bool = False) -> None:
    bpy.ops.wm.usd_export(filepath=str(path), export_animation=animated, **USD)


def modified(kind: str, **settings: object) -> Callable[[Path], None]:
    """Apply a modifier to one frame."""

    def trip(path: Path) -> None:
        keep_one_frame()
        modifier = the_mesh().modifiers.new("trip", kind)
        for name, value in settings.items():
            setattr(modifier, name, value)
        bpy.ops.object.modifier_apply(modifier="trip")
        export(path)

    return trip


def through(suffix: str, write: Callable[..., object], read: Callable[..., object], **how: object):
    """Export one frame to another format, import that, and export it as USD."""

    def trip(path: Path) -> None:
        keep_one_frame()
        with TemporaryDirectory() as folder:
            there = str(Path(folder) / f"copy.{suffix}")
            write(filepath=there, **how)
            bpy.ops.wm.read_factory_settings(use_empty=True)
            read(filepath=there)
        the_mesh()
        export(path)

    return trip


def alembic(path: Path) -> None:
    with TemporaryDirectory() as folder:
        there = str(Path(folder) / "copy.abc")
        bpy.ops.wm.alembic_export(filepath=there, normals=False, uvs=False)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.wm.alembic_import(filepath=there)
        the_mesh()
        export(path, animated=True)


def scaled(path: Path) -> None:
    keep_one_frame()
    the_mesh().scale = (1.0, 1.05, 0.97)
    bpy.ops.object.transform_apply()
    export(path)


def obj(path: Path) -> None:
    keep_one_frame()
    bpy.ops.wm.obj_export(
        filepath=str(path), export_normals=False, export_uv=False, export_materials=False
    )


TRIPS: dict[str, Callable[[Path], None]] = {
    "usd-binary.usdc": lambda path: export(path, animated=True),
    "usd-text.usda": lambda path: (keep_one_frame(), export(path)),
    "usd-package.usdz": lambda path: (keep_one_frame(), export(path)),
    "alembic.usdc": alembic,
    "obj.obj": obj,
    "fbx.usdc": through("fbx", bpy.ops.export_scene.fbx, bpy.ops.import_scene.fbx),
    "ply.usdc": through("ply", bpy.ops.wm.ply_export, bpy.ops.wm.ply_import),
    "stl.usdc": through("stl", bpy.ops.wm.stl_export, bpy.ops.wm.stl_import),
    "gltf.usdc": through("glb", bpy.ops.export_scene.gltf, bpy.ops.import_scene.gltf),
    "decimate-50.usdc": modified("DECIMATE", ratio=0.5),
    "decimate-20.usdc": modified("DECIMATE", ratio=0.2),
    "decimate-planar.usdc": modified("DECIMATE", decimate_type="DISSOLVE", angle_limit=0.035),
    "smooth-10.usdc": modified("SMOOTH", iterations=10),
    "laplacian-5.usdc": modified("LAPLACIANSMOOTH", iterations=5, lambda_factor=1.0),
    "triangulate.usdc": modified("TRIANGULATE"),
    "weld.usdc": modified("WELD", merge_threshold=1e-5),
    "displace.usdc": modified("DISPLACE", strength=0.2),
    "subdivision.usdc": modified("SUBSURF", levels=1),
    "non-uniform-scale.usdc": scaled,
}


def main() -> None:
    marked, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    for name, trip in TRIPS.items():
        begin(marked.absolute())
        trip((folder / name).absolute())
        print(f"{name}: written")


if __name__ == "__main__":
    main()
