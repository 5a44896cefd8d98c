"""The report as a document: rows, distortions, and apart from them, what it cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from meshmark.benchmarking.cells import FPR, LUCKY_BER
from meshmark.benchmarking.published_figures import TABLE_1, TABLE_2
from meshmark.benchmarking.subjects import Subject
from meshmark.benchmarking.suite_rows import Cell
from meshmark.benchmarking.suites import Suite
from meshmark.benchmarking.tasks import Bench, Pairing, cell_seed
from meshmark.extension.recipe import Recipe
from meshmark.metrics import Distortion
from meshmark.version import __version__

FORMAT = 1

Result = Mapping[str, Any]

_FIGURES = ("ber_avg", "ber_max", "log10_p", "log10_p_single_frame_median", "verified")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one asset and scheme.

    Parameters
    ----------
    copy, distortion : mapping
        Results of marking, and of measuring what it did.
    cells : tuple of (mapping, mapping)
        For each cell of the suite the result on the marked copy, and on the unmarked asset.
    """

    pairing: Pairing
    copy: Result
    distortion: Result
    cells: tuple[tuple[Result, Result], ...]


def document_of(
    *,
    suite: Suite,
    recipes: Sequence[Recipe],
    subjects: Sequence[tuple[Subject, tuple[int, int]]],
    bench: Bench,
    outcomes: Sequence[Outcome],
    elapsed_s: float,
) -> dict[str, Any]:
    """Put everything into JSON values.

    All but `timings` is the same in every run.
    """
    pairs = [
        (outcome, cell, results)
        for outcome in outcomes
        for cell, results in zip(suite.cells, outcome.cells, strict=True)
    ]
    return {
        "format": FORMAT,
        "meshmark": __version__,
        "suite": suite.name,
        "seed": bench.seed,
        "key_id": bench.key.id,
        "fpr": FPR,
        "lucky_ber": LUCKY_BER,
        "informed": any(outcome.pairing.informed for outcome in outcomes),
        "frames": subjects[0][0].frames,
        "assets": [_asset(subject, *counts) for subject, counts in subjects],
        "schemes": [recipe.as_json() for recipe in recipes],
        "rows": [_row(bench, outcome, cell, *results) for outcome, cell, results in pairs],
        "distortion": [row for outcome in outcomes for row in _distortions(outcome)],
        "timings": _timings(outcomes, pairs, elapsed_s),
    }


def _asset(subject: Subject, frames: int, distinct: int) -> dict[str, Any]:
    return {
        "asset": subject.asset,
        "files": [{"file": name, "sha256": digest} for name, digest in subject.files],
        "frames": frames,
        "distinct_frames": distinct,
    }


def _row(
    bench: Bench, outcome: Outcome, cell: Cell, marked: Result, control: Result
) -> dict[str, Any]:
    subject, scheme = outcome.pairing.subject, outcome.pairing.scheme
    paper = TABLE_2.get((subject.asset, cell.label)) if cell.frames == "all" else None
    return {
        "asset": subject.asset,
        "attack": cell.attack,
        "parameters": dict(cell.parameters),
        "per": cell.per,
        "scheme": scheme,
        **_figures(marked),
        "attack_mrms_rel": marked.get("attack_mrms_rel"),
        "label": cell.label,
        "family": cell.family,
        "frames": cell.frames,
        "seed": cell_seed(bench, subject, cell),
        "worst": marked.get("worst"),
        "informed": marked.get("informed"),
        "notes": list(marked.get("notes", ())),
        "error": marked.get("error"),
        "plugin_failed": bool(marked.get("plugin")) or bool(control.get("plugin")),
        "paper": None if paper is None else {"ber_avg": paper.average, "ber_max": paper.maximum},
        "control": {
            **_figures(control),
            "frames_lucky": control.get("frames_lucky"),
            "informed": control.get("informed"),
            "error": control.get("error"),
        },
    }


def _figures(result: Result) -> dict[str, Any]:
    """Take the figures of a result; of one that failed there are none, and it is not verified."""
    return {name: result.get(name, False if name == "verified" else None) for name in _FIGURES}


def _distortions(outcome: Outcome) -> list[dict[str, Any]]:
    subject, scheme = outcome.pairing.subject, outcome.pairing.scheme
    paper = TABLE_1.get(subject.asset)
    nothing = {"prim": None, **{field.name: None for field in fields(Distortion)}}
    return [
        {
            "asset": subject.asset,
            "scheme": scheme,
            **row,
            "error": outcome.distortion.get("error"),
            "paper": None if paper is None else {"hausdorff": paper.hausdorff, "mrms": paper.mrms},
        }
        for row in outcome.distortion.get("rows", [nothing])
    ]


def _timings(
    outcomes: Sequence[Outcome], pairs: Sequence[tuple[Outcome, Cell, Any]], elapsed_s: float
) -> dict[str, Any]:
    """List seconds spent, whenever that was: results found on disk keep theirs."""
    return {
        "elapsed_s": round(elapsed_s, 2),
        "assets": [
            {
                **_names(outcome),
                **outcome.copy.get("timings", {}),
                **{
                    name: seconds
                    for name, seconds in outcome.distortion.get("timings", {}).items()
                    if name == "metrics_s"
                },
            }
            for outcome in outcomes
        ],
        "rows": [
            {
                **_names(outcome),
                "label": cell.label,
                "per": cell.per,
                "frames": cell.frames,
                "marked": dict(results[0].get("timings", {})),
                "control": dict(results[1].get("timings", {})),
            }
            for outcome, cell, results in pairs
        ],
    }


def _names(outcome: Outcome) -> dict[str, str]:
    return {
        "asset": outcome.pairing.subject.asset,
        "scheme": outcome.pairing.scheme,
    }


def failures(document: Mapping[str, Any]) -> list[str]:
    """List the cells that could not run, a line each."""
    return [
        f"{row['asset']}: {row['scheme']}: {row['label']} (per {row['per']}): {reason}"
        for row in document["rows"]
        if (reason := row["error"] or row["control"]["error"])
    ] + [
        f"{row['asset']}: {row['scheme']}: distortion: {row['error']}"
        for row in document["distortion"]
        if row["error"]
    ]
