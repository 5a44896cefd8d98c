"""The reader of USD's own files; pxr is imported when one is read or written, not before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from meshmark.arrays import FloatArray
from meshmark.mesh.asset import Asset
from meshmark.usd.names import BAKE, FOLLOW, LAYER_SUFFIXES, READER, STAGE_SUFFIXES
from meshmark.usd.stamp import NO_STAMPS, Stamps

if TYPE_CHECKING:
    from meshmark.usd.delivery import Delivery
    from meshmark.usd.variant_places import Places
    from meshmark.usd.writing import Override


@dataclass(frozen=True)
class UsdReader:
    """Reads stages; writes layers over them, and assets of any origin as new stages.

    Parameters
    ----------
    variants : sequence of str
        What to select that a stage does not select itself; see `meshmark.usd.reading.read_stage`.
    strict : bool
        Whether a stage must have such variants.
    """

    variants: Sequence[str] = ()
    strict: bool = True

    @property
    def name(self) -> str:
        """What it is called."""
        return READER

    def accepts(self, source: str) -> bool:
        """Tell whether the source is called as USD's files are."""
        return source.lower().endswith(STAGE_SUFFIXES)

    def read(self, source: str, prims: Sequence[str] = ()) -> Asset:
        """Read the meshes of a stage; see `meshmark.usd.reading.read_stage`."""
        from meshmark.usd.reading import read_stage

        return read_stage(source, list(prims) or None, self.variants, strict=self.strict)

    def files(self, source: str) -> list[Path]:
        """List the files a stage is composed from, sorted."""
        from meshmark.usd.opening import stage_files

        return sorted(stage_files(source))

    def files_in_reach(self, source: str) -> list[Path]:
        """List every file a stage names, itself first; none if it is missing."""
        from meshmark.usd.reach import files_in_reach

        return files_in_reach(source) if Path(source).is_file() else []

    def texture_coordinates(self, source: str, prim: str) -> FloatArray | None:
        """Read those of a mesh; see `meshmark.usd.texture_coordinates`."""
        from meshmark.usd.texture_coordinates import read_texture_coordinates

        return read_texture_coordinates(source, prim, self.variants)

    def require_writable(self, source: str, output: Path) -> None:
        """Refuse nothing."""

    def writes(self, output: Path) -> bool:
        """Tell whether the output is called as a layer is."""
        return output.suffix.lower() in LAYER_SUFFIXES

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        """Write a layer over the original's stage; or a new stage, if it is none."""
        self.lay(marked, original, output)

    def lay(
        self,
        marked: Asset,
        original: Asset,
        output: Path,
        *,
        skel: str = BAKE,
        stamps: Stamps = NO_STAMPS,
        primvars: str = FOLLOW,
        places: Places | None = None,
    ) -> Override | None:
        """Write as `write` does, and tell of it.

        Parameters
        ----------
        places : Places, optional
            As `places` found them for the same meshes, or for more.

        Returns
        -------
        Override or None
            Which meshes are marked in some variants only; None if there are no variants.
        """
        if original.reader == READER:
            from meshmark.usd.writing import write_override

            return write_override(
                original,
                marked,
                output,
                skel=skel,
                stamps=stamps,
                primvars=primvars,
                places=places,
            )
        from meshmark.usd.stages import write_stage

        write_stage(original.with_meshes(marked.meshes), output, stamps)
        return None

    def places(self, original: Asset) -> Places:
        """Find out where an override layer puts points; see `meshmark.usd.variant_places`.

        Raises
        ------
        OutputError
            If something in the source is stronger than any layer can be inside a variant.
        """
        from meshmark.usd.opening import open_stage
        from meshmark.usd.variant_places import find_places

        points = open_stage(original.source, original.variants).points
        prims = (points.stage.GetPrimAtPath(mesh.prim) for mesh in original.meshes)
        return find_places(original, points, prims)

    def deliver(
        self,
        marked: Asset,
        original: Asset,
        output: Path,
        *,
        keep_metadata: bool = False,
        skel: str = BAKE,
        stamps: Stamps = NO_STAMPS,
        primvars: str = FOLLOW,
    ) -> Delivery | None:
        """Write one file in which no unmarked point is left.

        Returns
        -------
        Delivery or None
            What was done to the original's stage beyond marking it; None if it is none.
        """
        if original.reader == READER:
            from meshmark.usd.delivery import write_flattened

            return write_flattened(
                original,
                marked,
                output,
                keep_metadata=keep_metadata,
                skel=skel,
                stamps=stamps,
                primvars=primvars,
            )
        self.lay(marked, original, output, stamps=stamps)
        return None

    def written_names(self, original: Asset) -> dict[str, str]:
        """Map each mesh's path in the original to its path in what is written."""
        if original.reader == READER:
            return {mesh.prim: mesh.prim for mesh in original.meshes}
        from meshmark.usd.stages import stage_paths

        paths = map(str, stage_paths(original))
        return dict(zip((mesh.prim for mesh in original.meshes), paths, strict=True))
