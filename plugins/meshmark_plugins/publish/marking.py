"""What the hooks share: mark a file that is about to be published, or say why it cannot be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmark.c2pa.sidecar import require_installed, sidecar_path
from meshmark.commands.inspect import why_not
from meshmark.delivery.unmarked import require_allowed, require_extent, require_small, split_fit
from meshmark.embedding.file import mark_file
from meshmark.embedding.manifest import manifest_path, own_manifest
from meshmark.errors import CapacityError, InputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.files.places import assets_folder
from meshmark.keys import Key
from meshmark.mesh.asset import LeftOut
from meshmark.recipients import recipient_name
from meshmark.sources.reading import read
from meshmark.usd.names import LAYER_SUFFIXES
from meshmark_plugins.publish.recording import Recorder

if TYPE_CHECKING:
    # It needs a package that not everybody has.
    from meshmark.c2pa.signing import Signer

# Single files that hold meshes, and can be marked.
MARKABLE = (*LAYER_SUFFIXES, ".glb", ".obj")
# Those that hold meshes, too, and would go out as they are.
UNMARKABLE = (
    *(".usdz", ".gltf", ".abc", ".fbx", ".dae", ".ply", ".stl", ".bgeo", ".ma", ".mb", ".blend"),
    *(".max", ".hip", ".hiplc", ".c4d", ".ztl"),
)

# Kinds of files that go with a marked one: its manifest, and its content credentials.
BESIDE = ("meshmark", "c2pa")

NOTHING_RECORDED = Recorder(None, None, None)


@dataclass(frozen=True)
class Published:
    """What became of a file.

    Parameters
    ----------
    path : Path
        What may be published: the marked file, or the unmarked one if somebody waived its mark.
    told : dict
        What there is to record of it, as JSON values.
    beside : mapping of str to Path
        What goes with the marked file, by its kind in `BESIDE`.
    """

    path: Path
    told: dict[str, Any]
    beside: Mapping[str, Path] = field(default_factory=dict)


def holds_meshes(path: str | Path) -> bool:
    """Tell whether a file holds meshes, by its name."""
    return Path(path).suffix.lower() in (*MARKABLE, *UNMARKABLE)


def require_capacity(source: str | Path, options: Mapping[str, Any]) -> None:
    """Refuse what `mark` could not mark. No vertex is moved, so this is quick.

    Parameters
    ----------
    options : mapping
        As `mark` takes them.

    Raises
    ------
    InputError, CapacityError
        Saying what cannot be read, or what can hold no mark.
    """
    _require_markable(Path(source))
    recipe, more = _recipe(options)
    allowed = more.get("allow_unmarked", ())
    parameters = more.get("parameters")
    asset = split_fit(
        read(source, more.get("prims", ()), parameters=parameters, isolated=not _trusted(more))
    )
    told = ((mesh.prim, why_not(mesh, recipe)) for mesh in asset.meshes)
    unfit = [LeftOut(prim, reason) for prim, reason in told if reason is not None]
    if len(unfit) == len(asset.meshes):
        raise CapacityError(
            f"no mesh can hold a mark: {unfit[0].reason}", source=source, prim=unfit[0].prim
        )
    if _delivers(Path(source)):
        require_allowed(asset, allowed)
        require_extent(asset, allowed)
        require_small(asset, unfit, allowed)


def mark(
    source: str | Path,
    output: str | Path,
    key_file: str | Path,
    *,
    recipient: str | None = None,
    waiver: str | None = None,
    options: Mapping[str, Any] | None = None,
    recorder: Recorder = NOTHING_RECORDED,
    published: Path | None = None,
) -> Published:
    """Mark a file into another that can be published in its place.

    USD files become one file in which nothing unmarked is left. What was done before is not done
    again: neither if the output is there, nor if the source is marked already.

    Parameters
    ----------
    source, output : str or Path
        What was to be published, and what is to be published instead.
    key_file : str or Path
        The owner's key.
    recipient : str, optional
        Whose copy it will be.
    waiver : str, optional
        Who allows, and why, that what can hold no mark is published unmarked.
    options : mapping, optional
        More of what `meshmark.mark_file` takes; and `schemes`, the names of the layers, and
        `c2pa`, the files that sign, as `Signer.of` takes them.
    recorder : Recorder, optional
        Of a ledger. What cannot be recorded is not published.
    published : Path, optional
        Where the output goes from there, for the ledger.

    Raises
    ------
    MeshmarkError
        Saying why it cannot be published.
    """
    key, (recipe, more) = Key.load(Path(key_file)), _recipe(options or {})
    source, output = Path(source), Path(output)
    before = marked_before(source, key, recipient, waiver)
    if before is not None:
        if "signer" in more and "c2pa" not in before.beside:
            raise UsageError(
                "is marked, but not signed: publish what it was made of", source=source
            )
        return before
    if waiver and _delivers(output):
        more["allow_unmarked"] = ["all"]
    try:
        _require_markable(source)
        manifest = mark_file(
            source,
            output,
            key,
            recipe=recipe,
            recipient=recipient,
            deliver=_delivers(output),
            record=lambda document: recorder.mark(document, output, published),
            **{"trusted": False, **more},
        )
    except (CapacityError, InputError) as error:
        if not waiver:
            raise
        recorder.waiver(source, waiver, str(error), recipient)
        told = {"file": source.name, "marked": False, "reason": str(error), "waiver": waiver}
        return Published(source, told)
    done = _marked(output, manifest.document, waiver)
    if waiver and manifest["skipped"]:
        unmarked = "; ".join(f"{each['prim']}: {each['reason']}" for each in manifest["skipped"])
        recorder.waiver(source, waiver, unmarked, recipient)
    return done


def marked_before(
    source: Path, key: Key, recipient: str | None, waiver: str | None
) -> Published | None:
    """Return a file as it is, if the manifest beside it says that this key has marked it.

    Raises
    ------
    UsageError
        If it is another's copy, as marks would pile up; or a layer over what is unmarked.
    """
    document = own_manifest(source)
    if document is None or document["key_id"] != key.id:
        return None
    if _delivers(source) and not document["delivered"]:
        raise UsageError("is a layer over an unmarked file; publish that", source=source)
    wanted = None if recipient is None else recipient_name(recipient)
    if document["recipient"] != wanted:
        raise UsageError(
            f"is marked for {document['recipient']}, not for {wanted}: publish what it was made of",
            source=source,
        )
    return _marked(source, document, waiver)


def _require_markable(path: Path) -> None:
    if path.suffix.lower() not in MARKABLE:
        raise CapacityError(
            f"files of this kind cannot be marked; publish one of {', '.join(MARKABLE)} instead",
            source=path,
        )


def _marked(path: Path, document: dict[str, Any], waiver: str | None) -> Published:
    """Let a marked file pass, if it verifies and nothing unmarked is in it that must not be."""
    found = document["verification"]
    # What a deliverable may leave unmarked was decided before it was written.
    for each in () if waiver or document["delivered"] else document["skipped"]:
        raise CapacityError(
            f"would be published unmarked: {each['reason']}", source=path, prim=each["prim"]
        )
    if found["verdict"] != "marked":
        raise CapacityError(
            f"was marked, but verifies with log10 p {found['log10_p']:.2f} only", source=path
        )
    assets = assets_folder(path)
    told = {
        "file": path.name,
        "marked": True,
        "key_id": document["key_id"],
        "recipient": document["recipient"],
        "log10_p": found["log10_p"],
        "unmarked": document["skipped"],
        "assets": assets.name if assets.is_dir() else None,
        "waiver": waiver,
    }
    places = (manifest_path(path), sidecar_path(path) if "c2pa" in document else None)
    beside = {kind: place for kind, place in zip(BESIDE, places, strict=True) if place}
    return Published(path, told, beside)


def _recipe(options: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Take apart the layers and all other options; read who signs."""
    more = dict(options)
    schemes, recipe = more.pop("schemes", None), more.pop("recipe", None)
    signs = more.pop("c2pa", None)
    if signs:
        more["signer"] = _signer(signs)
    return [Recipe(name) for name in schemes] if schemes else recipe, more


def _signer(files: Mapping[str, str]) -> Signer:
    require_installed()
    from meshmark.c2pa.signing import Signer

    missing = [name for name in ("certificates", "key") if not files.get(name)]
    if missing:
        raise UsageError(f"the option c2pa lacks {' and '.join(missing)}")
    return Signer.of(Path(files["certificates"]), Path(files["key"]), files.get("tsa"))


def _trusted(options: Mapping[str, Any]) -> bool:
    return bool(options.get("trusted", False))


def _delivers(path: Path) -> bool:
    return path.suffix.lower() in LAYER_SUFFIXES
