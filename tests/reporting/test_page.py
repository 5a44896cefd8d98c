"""A page says what the verdict says, to everybody, whatever a file is called, in 2 MB."""

from __future__ import annotations

import base64
import hashlib
import json
import re

import pytest

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.reporting import still as picture
from meshmark.reporting.copy_facts import copy_facts
from meshmark.reporting.page import ASSETS, LARGEST, page
from meshmark.reporting.selection import select
from meshmark.reporting.view import ROOM, view_of
from meshmark.testing.meshes import icosphere
from report_pages import HOSTILE, asked, outline, verdict


def view_named(prim: str):
    asset = as_asset(MeshAnimation.from_arrays(*icosphere(2), prim=prim))
    return view_of(asset, select(asset), label=f"Moved {prim}", marked=asset)


@pytest.fixture(scope="module", autouse=True)
def _small_pictures():
    """Render stills of a tenth of the size: these tests do not look at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(picture, "HEIGHT", picture.HEIGHT // 10)
        patch.setattr(picture, "WIDTH", picture.WIDTH // 10)
        yield


@pytest.fixture(scope="module")
def hostile() -> str:
    facts = copy_facts(asked(HOSTILE), verdict(HOSTILE, recipient=HOSTILE))
    return page(facts, view_named(f"/{HOSTILE}"))


def test_the_verdict_is_said_first_and_in_words() -> None:
    heard = outline(page(copy_facts(asked(), verdict()), None)).heard
    assert heard[:3] == [
        "Report on copy.usdc",
        "Is this file a marked copy?",
        "Marked: this is the copy made for ACME",
    ]
    told = " ".join(heard)
    assert "at most 1 in 1,000,000,000,000" in told
    assert "The limit set beforehand is 1 in 1,000,000." in told
    assert "does not say who passed the file on" in told
    assert "meshmark report copy.usdc" in told
    assert "0123456789abcdef" in told
    assert "scheme relief 2" in told


@pytest.mark.parametrize(
    ("answer", "headline", "meaning"),
    [
        ("not marked", "Not marked", "does not prove that the file was never marked"),
        ("inconclusive", "Inconclusive", "neither for a mark nor against one"),
    ],
)
def test_other_answers_say_what_they_do_not_mean(answer, headline, meaning) -> None:
    facts = copy_facts(asked(), verdict(answer=answer, log10_p=-0.1))
    assert facts.headline.startswith(headline)
    assert meaning in " ".join(facts.words)
    assert "ACME" not in " ".join((facts.headline, *facts.words))


def test_every_search_is_told_and_their_product_is_what_was_paid() -> None:
    [table, pooled, looks] = copy_facts(asked(), verdict()).sections[1].tables
    assert [row[1:] for row in table.rows] == [
        ("2", "× 2"),
        ("3", "× 3"),
        ("4", "× 2"),
        ("", "× 8"),
        ("", "× 96"),
    ]
    assert pooled.rows == (("apex", "2", "−1.00"),)
    assert [row[2] for row in looks.rows] == ["1", "4"]


def test_frames_are_drawn_and_can_be_read_as_a_table() -> None:
    text = page(copy_facts(asked(), verdict(frames=5)), None)
    assert text.count('<rect class="value"') == 5
    assert "log10 p of 5 frames, each by itself: from 0.00 to −12.00" in text
    evidence = copy_facts(asked(), verdict(frames=5)).sections[0]
    assert evidence.tables[1].rows[0] == ("1", "−12.00", "12.5\u202f%")


def test_names_cannot_break_out_of_the_text(hostile: str) -> None:
    parsed = outline(hostile)
    assert parsed.tags.count("script") == 2
    assert parsed.tags.count("img") == 1
    assert not [name for name, _ in parsed.attributes if name.startswith("on")]
    assert "{{ 7*7 }}" in hostile
    assert any(HOSTILE in text for text in parsed.heard)


def test_data_in_the_page_are_data(hostile: str) -> None:
    [data] = re.findall(r'<script type="application/json" id="view-data">(.*?)</script>', hostile)
    told = json.loads(data)
    assert "<" not in data
    T, n = len(told["times"]), told["points"]
    assert len(base64.b64decode(told["positions"])) == 6 * T * n
    assert len(base64.b64decode(told["heat"]["values"])) == T * n
    assert len(base64.b64decode(told["moves"]["values"])) == 3 * T * n


def test_the_policy_lets_nothing_in_but_the_pages_own(hostile: str) -> None:
    [policy] = [value for _, value in outline(hostile).attributes if "default-src" in value]
    assert policy.startswith("default-src 'none';")
    for tag in ("style", "script"):
        [body] = re.findall(f"<{tag}>(.*?)</{tag}>", hostile, re.S)
        digest = base64.b64encode(hashlib.sha256(body.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert " style=" not in re.sub(r"<script>.*?</script>", "", hostile, flags=re.S)
    addresses = [value for name, value in outline(hostile).attributes if name in ("src", "href")]
    assert all(value.startswith("data:") for value in addresses)


def test_the_same_facts_give_the_same_bytes(hostile: str) -> None:
    again = page(
        copy_facts(asked(HOSTILE), verdict(HOSTILE, recipient=HOSTILE)), view_named(f"/{HOSTILE}")
    )
    assert again == hostile


def test_a_crowd_of_meshes_frames_and_files_stays_small() -> None:
    name = "x" * 3000
    many = verdict(name, prims=1000, frames=1500)
    text = page(copy_facts(asked(name, files=5000), many), None)
    script = (ASSETS / "viewer.js").stat().st_size
    # Four letters for three bytes of a view, beside its still.
    assert len(text.encode()) + script + ROOM * 4 // 3 + 150_000 < LARGEST
    assert "this list of all 5,000 files" in text
    assert "and 700 more" in text


def test_headings_and_labels_lead_through_the_page(hostile: str) -> None:
    parsed = outline(hostile)
    assert parsed.tags.count("h1") == 1
    assert parsed.tags.count("h2") >= 5
    assert parsed.tags.count("th") > parsed.tags.count("table")
    assert ("lang", "en") in parsed.attributes
    labels = [value for name, value in parsed.attributes if name == "for"]
    names = [value for name, value in parsed.attributes if name == "id"]
    assert set(labels) <= set(names)
    assert len(set(names)) == len(names)
