"""The report as a page: our figures, the paper's beside them, and every worse one marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from meshmark.benchmarking.informed_cells import BLIND_FRAMES
from meshmark.benchmarking.informed_tables import ABOUT_INFORMED, informed_tables
from meshmark.benchmarking.markdown import number, table
from meshmark.benchmarking.published_figures import DISTORTION_DIGIT, ERROR_DIGIT, worse
from meshmark.benchmarking.report_command import command_of
from meshmark.benchmarking.report_document import failures

Row = Mapping[str, Any]

STAGES = ("read", "attack", "segment", "distances", "other")
INFORMED_STAGES = ("read", "attack", "beside", "other")

_ABOUT_SHARES = """\
**Reading the tables.** BER is the published figure, the smallest bit error rate among the parts
of a frame, averaged and maximised over frames. Bits that a scheme leaves undecided are neither
right nor wrong (`apex` decides at seven to three), and frames that it passes over are left out
(`apex`: blends of those beside them). The figure is a minimum over several tries, and the last
columns tell what that is worth: the share of *unmarked* frames whose best part shows at most
{lucky:g}. No verdict rests on it. log10 p bounds the probability that a key chosen at random does
as well on the very same file, all frames and parts together, corrected for multiple testing; beside
it, the median of what single frames say. *Found* means p <= {fpr:g}. The attack's MRMS is its own,
against the marked copy, in space and both ways: what was moved elsewhere or added counts. The
control columns are the same attacks, with the same random numbers, on the unmarked asset."""


def page_of(document: Mapping[str, Any], plots: Sequence[str] = ()) -> str:
    """Lay out a report in Markdown.

    Parameters
    ----------
    document : mapping
        From `run_benchmark`.
    plots : sequence of str
        File names of the plots, beside the page.
    """
    sections = [
        f"# Benchmark `{document['suite']}`",
        f"```console no-run\n$ {command_of(document)}\n```",
        f"meshmark {document['meshmark']}, seed {document['seed']}, public key "
        f"`{document['key_id']}`. Everything but the costs is the same in every run.",
        ABOUT_INFORMED.format(fpr=document["fpr"], blind_frames=BLIND_FRAMES)
        if document["informed"]
        else _ABOUT_SHARES.format(lucky=document["lucky_ber"], fpr=document["fpr"]),
        *_failures(document),
        *(text for asset in document["assets"] for text in _asset_section(document, asset)),
        _costs(document),
        *_plots(plots),
    ]
    return "\n\n".join(sections) + "\n"


def _failures(document: Mapping[str, Any]) -> list[str]:
    reasons = failures(document)
    if not reasons:
        return []
    return ["## Could not run", "\n".join(f"- {reason}" for reason in reasons)]


def _asset_section(document: Mapping[str, Any], asset: Row) -> list[str]:
    name = asset["asset"]
    rows = [row for row in document["rows"] if row["asset"] == name]
    spent = [row for row in document["distortion"] if row["asset"] == name]
    schemes = list(dict.fromkeys(row["scheme"] for row in rows))
    sections = [f"## {name}", _frames(asset), "### Distortion", _distortion_table(spent)]
    if document["informed"]:
        own = [row for row in document["timings"]["rows"] if row["asset"] == name]
        return [*sections, *informed_tables(rows, own)]
    for scheme in schemes:
        own = [row for row in rows if row["scheme"] == scheme]
        sections += [f"### {name}, `{scheme}`", _attack_table(own), _worse_rows(own), _control(own)]
    return sections


def _frames(asset: Row) -> str:
    frames, distinct = asset["frames"], asset["distinct_frames"]
    text = f"{frames} frame{'s' if frames != 1 else ''}"
    if distinct < frames:
        text += (
            f", of which only {distinct} differ: the others repeat earlier ones (one cycle, played "
            "again), so that they are no further evidence of robustness"
        )
    return text + "."


def _distortion_table(rows: Sequence[Row]) -> str:
    names = ("flipped_faces", "max_move_edges", "flicker", "flicker_world")
    known = {"asset", "scheme", "prim", "error", "paper", "hausdorff", "mrms"}
    known |= {"hausdorff_rel", "mrms_rel", "mrms_rel_error", "compared_frames", *names}
    extra = [name for name in rows[0] if name not in known]
    header = ["scheme", "Hausdorff / diagonal (absolute)", "paper", "MRMS / diagonal (absolute)"]
    header += ["paper", *(name.replace("_", " ") for name in (*names, *extra))]
    lines = [
        [
            f"`{row['scheme']}`" + (f" {row['prim']}" if row["prim"] else ""),
            *_against_paper(row, "hausdorff"),
            *_against_paper(row, "mrms"),
            *(_plain(row[name]) for name in (*names, *extra)),
        ]
        for row in rows
    ]
    note = (
        "Means over the frames, flicker and jitter across them: flicker on the moving surface, "
        "and in space, where what rests on a turning limb shows too. The paper gives no unit of "
        "length; its figures are compared with ours over the diagonal of the bounding box."
    )
    return f"{table(header, lines)}\n\n{note}"


def _against_paper(row: Row, name: str) -> list[str]:
    ours, paper = row[f"{name}_rel"], row["paper"]
    if ours is None:
        return ["-", "-" if paper is None else f"{paper[name]:.6f}"]
    text = f"{ours:.6f} ({row[name]:.6f})"
    if paper is None:
        return [text, "-"]
    if worse(ours, paper[name], DISTORTION_DIGIT):
        text = f"**{text} worse**"
    return [text, f"{paper[name]:.6f}"]


def _attack_table(rows: Sequence[Row]) -> str:
    static = any(row["frames"] == "first" for row in rows)
    header = ["attack", "per", *(["frames"] if static else [])]
    header += ["BER avg", "paper", "BER max", "paper", "log10 p", "median frame", "found"]
    header += ["attack MRMS / diagonal"]
    header += ["control log10 p", "control found", "control frames by luck"]
    lines = [
        [
            row["label"],
            row["per"],
            *([row["frames"]] if static else []),
            *_errors_against_paper(row),
            number(row["log10_p"], ".1f"),
            number(row["log10_p_single_frame_median"], ".1f"),
            _found(row),
            number(row["attack_mrms_rel"], ".6f"),
            number(row["control"]["log10_p"], ".1f"),
            _found(row["control"]),
            number(row["control"]["frames_lucky"], ".0%"),
        ]
        for row in rows
    ]
    return table(header, lines)


def _errors_against_paper(row: Row) -> list[str]:
    cells = []
    for name in ("ber_avg", "ber_max"):
        text = number(row[name], ".4f")
        if is_worse(row, name):
            text = f"**{text} worse**"
        cells += [text, "-" if row["paper"] is None else f"{row['paper'][name]:.4f}"]
    return cells


def is_worse(row: Row, name: str) -> bool:
    """Tell whether a row's figure, `ber_avg` or `ber_max`, is above the paper's."""
    return row["paper"] is not None and worse(row[name], row["paper"][name], ERROR_DIGIT)


def _found(row: Row) -> str:
    if row["error"]:
        return "could not run"
    return "yes" if row["verified"] else "no"


def _worse_rows(rows: Sequence[Row]) -> str:
    compared = [row for row in rows if row["paper"] is not None]
    if not compared:
        return "The paper has none of these rows."
    bad = [row for row in compared if is_worse(row, "ber_avg") or is_worse(row, "ber_max")]
    if not bad:
        return f"None of the {len(compared)} rows that the paper has too is worse than there."
    lines = [f"{len(bad)} of the {len(compared)} rows that the paper has too are worse:"]
    return "\n".join([*lines, "", *(_diagnosis(row) for row in bad)])


def _diagnosis(row: Row) -> str:
    worst = row["worst"]
    head = f"- {row['label']}, per {row['per']}: "
    if row["error"]:
        return head + str(row["error"])
    if worst is None:
        return head + "; ".join(row["notes"] or ["no part decides enough bits in any frame"])
    time = "the frame" if worst["time"] is None else f"frame {worst['time']:g}"
    return (
        f"{head}BER avg {number(row['ber_avg'], '.4f')} for {row['paper']['ber_avg']:.4f}, max "
        f"{number(row['ber_max'], '.4f')} for {row['paper']['ber_max']:.4f}; worst is {time}, "
        f"where part {worst['part']} does best with {worst['ber']:.4f}"
    )


def _control(rows: Sequence[Row]) -> str:
    ran = [row["control"] for row in rows if row["control"]["error"] is None]
    if not ran:
        return "No control could run."
    found = sum(control["verified"] for control in ran)
    lucky = [control["frames_lucky"] for control in ran if control["frames_lucky"] is not None]
    share = sum(lucky) / len(lucky) if lucky else 0.0
    text = (
        f"Control: {found} of {len(ran)} unmarked copies found; by luck alone, "
        f"{share:.1%} of unmarked frames show a BER that a reader would take for a mark."
    )
    return f"**{text}**" if found else text


def _costs(document: Mapping[str, Any]) -> str:
    timings = document["timings"]
    stages = INFORMED_STAGES if document["informed"] else STAGES
    lines = []
    for asset in timings["assets"]:
        names = asset["asset"], asset["scheme"]
        sides = [
            row[side]
            for row in timings["rows"]
            if (row["asset"], row["scheme"]) == names
            for side in ("marked", "control")
        ]
        sums = [sum(side.get(f"{stage}_s", 0.0) for side in sides) for stage in stages]
        own = [asset.get("embed_s"), asset.get("metrics_s"), *sums]
        lines.append([names[0], f"`{names[1]}`", *(number(s, ".1f") for s in own)])
    header = ["asset", "scheme", "mark", "metrics", *stages]
    about = (
        "*Mark* is making the master. *Beside* is laying copies upon their original and reading "
        "them; *other* is trying keys and names on what was read."
        if document["informed"]
        else "*Other* is measuring less segmentation and distances, and judging."
    )
    return (
        f"## Cost\n\nSeconds, added up over all cells and both columns, whichever processes they "
        f"ran in; this run took {timings['elapsed_s']:.0f} s, and computed only what was not there "
        f"already. {about}\n\n{table(header, lines)}"
    )


def _plots(plots: Sequence[str]) -> list[str]:
    if not plots:
        return []
    return ["## Against strength", *(f"![{name.partition('.')[0]}]({name})" for name in plots)]


def _plain(x: Any) -> str:
    return f"{x:.4g}" if isinstance(x, int | float) else "-" if x is None else str(x)
