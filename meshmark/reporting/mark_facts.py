"""What a page says of a file that was marked: how far it was moved, and that it verifies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from meshmark.reporting.facts import Facts, Section, Table, shortened
from meshmark.reporting.wording import listed, log10, odds, percent, this_very_key

# Measures of distortion, and whether they are shares of the diagonal.
MEASURES = (
    ("mrms_rel", "MRMS", True),
    ("hausdorff_rel", "Hausdorff", True),
    ("normal_turn", "normals turned by (degrees)", False),
    ("flipped_faces", "flipped faces", False),
    ("max_move_edges", "farthest move (edges)", False),
    ("texture_drift", "texture drift (texels of 4k)", False),
    ("flicker", "flicker", False),
    ("jitter", "jitter", False),
)


def mark_facts(
    manifest: Mapping[str, Any], output: str, files: tuple[tuple[str, str], ...], command: str
) -> Facts:
    """Tell of a marked file by its manifest.

    Parameters
    ----------
    manifest : mapping
        See `meshmark.embedding.manifest`.
    output : str
        The marked file, as it was named.
    files : tuple of (str, str)
        Name and SHA-256 of every file involved.
    command : str
        What repeats it, with KEYFILE for the key.
    """
    answer, whose = manifest["verification"]["verdict"], manifest["recipient"]
    done = {
        "marked": "Marked, and found again",
        "not marked": "Written, but the mark is not found again",
        "inconclusive": "Written, but too small for the mark to be found by itself",
    }[answer]
    notes = (
        *(f"{each['prim']}: not marked: {each['reason']}" for each in manifest["skipped"]),
        *(
            f"{prim['prim']}: no mark by {layer['scheme']}: {layer['reason']}"
            for prim in manifest["prims"]
            for layer in prim["missing"]
        ),
        *(f"{prim['prim']}: {note}" for prim in manifest["prims"] for note in prim["notes"]),
    )
    sections = [_distortion(manifest), _verification(manifest)]
    if notes:
        sections.append(Section("What else there is to know", notes=notes))
    return Facts(
        title=f"Report on {shortened(output)}",
        kind="What marking did to this file",
        answer=answer,
        headline=f"{done}: {f'the copy for {whose}' if whose else 'a copy for nobody by name'}",
        words=tuple(_words(manifest, output)),
        figures=tuple(_figures(manifest)),
        sections=tuple(sections),
        files=files,
        command=command,
        command_note=(
            f"KEYFILE stands for the file of the key with the id {manifest['key_id']}. The key "
            "itself is nowhere in this report."
        ),
        schemes=tuple((layer["name"], layer["version"]) for layer in manifest["layers"]),
    )


def _worst(manifest: Mapping[str, Any], measure: str) -> float:
    told = [prim["distortion"][measure] for prim in manifest["prims"]]
    return max((value for value in told if value is not None), default=math.nan)


def _words(manifest: Mapping[str, Any], output: str) -> Iterator[str]:
    found, prims = manifest["verification"], manifest["prims"]
    schemes = listed([layer["name"] for layer in manifest["layers"]])
    yield (
        f"{shortened(output)} holds a hidden mark of the key {manifest['key_id']} in "
        f"{len(prims)} of {len(prims) + len(manifest['skipped'])} meshes, laid by {schemes}. The "
        "surface moved by "
        f"{percent(_worst(manifest, 'mrms_rel'))} of the diagonal of its box on average, and by "
        f"{percent(_worst(manifest, 'hausdorff_rel'))} at most, in the mesh that moved most. "
        "Points also slide along the surface, which moves no part of it; the view shows both. No "
        "point was added, removed or put in another order."
    )
    yield (
        "The written file was read back and verified. A key drawn at random would fit as well with "
        f"a probability of at most {odds(found['log10_p'])}{this_very_key(found['log10_p'])}. The "
        f"limit is {odds(math.log10(found['fpr']))}."
    )


def _figures(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "Made for", manifest["recipient"] or "nobody by name"
    yield "Surface moved by (MRMS)", percent(_worst(manifest, "mrms_rel"))
    yield "At most (Hausdorff)", percent(_worst(manifest, "hausdorff_rel"))
    yield "Probability by chance, at most", odds(manifest["verification"]["log10_p"])
    yield "Marked meshes", f"{len(manifest['prims']):,}"
    yield "Key id", manifest["key_id"]


def _distortion(manifest: Mapping[str, Any]) -> Section:
    rows = tuple(
        (
            prim["prim"],
            f"{prim['points']:,}",
            f"{prim['distortion']['compared_frames']:,.0f} of {prim['marked_frames']:,}",
            *(_measure(prim["distortion"][name], share) for name, _, share in MEASURES),
        )
        for prim in manifest["prims"]
    )
    columns = ("mesh", "points", "frames compared", *(label for _, label, _ in MEASURES))
    numbers = tuple(range(1, len(columns)))
    return Section(
        "Distortion",
        (
            "Distances are shares of the diagonal of the mesh's box. Means are over the frames "
            "that were compared; flicker and jitter are of all frames.",
        ),
        tables=(Table("Mesh by mesh", columns, rows, numbers).without_empty(),),
    )


def _measure(value: float | None, share: bool) -> str:
    if value is None:
        return ""
    return percent(value) if share else f"{value:.3g}"


def _verification(manifest: Mapping[str, Any]) -> Section:
    rows = tuple(
        (
            prim["prim"],
            listed([layer["scheme"] for layer in prim["layers"]]),
            f"{prim['carriers']:,}",
            *_verified(prim["verification"]),
            f"{prim['checked_frames']:,} of {prim['marked_frames']:,}",
        )
        for prim in manifest["prims"]
    )
    columns = ("mesh", "layers", "carriers", "answer", "log10 p", "chips", "frames checked")
    return Section(
        "What was found again in the written file",
        tables=(Table("Mesh by mesh", columns, rows, (2, 4, 5, 6)),),
    )


def _verified(found: Mapping[str, Any] | None) -> tuple[str, str, str]:
    if found is None:
        return "nothing", "", ""
    return found["verdict"], log10(found["log10_p"]), f"{found['chips']:,}"
