"""What a page says of a marked file is what its manifest says, in words."""

from __future__ import annotations

import pytest

from meshmark.reporting.mark_facts import MEASURES, mark_facts
from meshmark.reporting.page import page
from report_pages import HOSTILE, outline


def prim(name: str, mrms: float, verified: bool = True) -> dict:
    found = {"verdict": "marked", "log10_p": -30.5, "chips": 96}
    return {
        "prim": name,
        "points": 1234,
        "marked_frames": 24,
        "checked_frames": 12,
        "carriers": 6,
        "layers": [{"scheme": "relief", "carriers": 6}],
        "missing": [{"scheme": "apex", "reason": "no tips"}],
        "notes": [f"posed by {name}"],
        "verification": found if verified else None,
        "distortion": {
            **{measure: 0.25 for measure, _, _ in MEASURES},
            "mrms_rel": mrms,
            "texture_drift": None,
            "compared_frames": 12.0,
        },
    }


def manifest(answer: str = "marked", name: str = "/A", recipient: str | None = "ACME") -> dict:
    return {
        "key_id": "0123456789abcdef",
        "recipient": recipient,
        "layers": [{"name": "apex", "version": "5"}, {"name": "relief", "version": "2"}],
        "prims": [prim(name, 0.0001), prim("/B", 0.0002, verified=False)],
        "skipped": [{"prim": "/C", "reason": "too few points"}],
        "verification": {"verdict": answer, "log10_p": -30.5, "fpr": 1e-6},
    }


def facts(*arguments, **options):
    return mark_facts(manifest(*arguments, **options), "out.usdc", (), "meshmark embed")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("marked", "Marked, and found again: the copy for ACME"),
        ("not marked", "Written, but the mark is not found again: the copy for ACME"),
        ("inconclusive", "Written, but too small for the mark to be found by itself: the copy"),
    ],
)
def test_the_headline_says_what_became_of_it(answer, said) -> None:
    assert facts(answer).headline.startswith(said)


def test_a_copy_for_nobody_says_so() -> None:
    assert facts(recipient=None).headline.endswith("a copy for nobody by name")


def test_the_mesh_that_moved_most_is_told_of() -> None:
    told = dict(facts().figures)
    assert told["Surface moved by (MRMS)"] == "0.02\u202f%"
    assert told["Probability by chance, at most"] == "1 in 3 × 10³⁰"
    assert "in 2 of 3 meshes, laid by apex and relief" in " ".join(facts().words)


def test_measures_that_nobody_took_have_no_column() -> None:
    [table] = facts().sections[0].tables
    assert "texture drift (texels of 4k)" not in table.columns
    assert table.rows[0][:4] == ("/A", "1,234", "12 of 24", "0.01\u202f%")


def test_what_holds_no_mark_is_named() -> None:
    verified, notes = facts().sections[1], facts().sections[2].notes
    assert verified.tables[0].rows[1][3] == "nothing"
    assert "/C: not marked: too few points" in notes
    assert "/A: no mark by apex: no tips" in notes


def test_names_in_a_manifest_cannot_break_out() -> None:
    parsed = outline(page(facts(name=f"/{HOSTILE}", recipient=HOSTILE), None))
    assert "script" not in parsed.tags
    assert "img" not in parsed.tags
    assert any(f"/{HOSTILE}" in text for text in parsed.heard)
