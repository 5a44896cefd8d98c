from __future__ import annotations

import os

import numpy as np
import pytest

from meshmark.detection import significance
from meshmark.detection.decision import decide
from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.detection.gathering import AssetEvidence
from meshmark.detection.significance import judge_each, log10_p_of
from meshmark.detection.verify import judge_all
from meshmark.errors import InputError, UsageError
from meshmark.keys import Key
from meshmark.recipients import LONGEST, name_or_file, read_names, recipient_name, spellings
from meshmark.statistics.word_windows import WordPosterior

KEY = Key(bytes(range(32)))
COMPOSED, DECOMPOSED = "Andr\u00e9", "Andre\u0301"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("acme", "acme"),
        ("  acme\t", "acme"),
        ("\ufeffacme", "acme"),
        (" \ufeff acme", "acme"),
        (DECOMPOSED, COMPOSED),
        ("\u212b", "\u00c5"),
        ("Acme  Inc.", "Acme  Inc."),
        ("\u0645\u06cc\u200c\u062e", "\u0645\u06cc\u200c\u062e"),
    ],
)
def test_names_have_one_form(text, name) -> None:
    assert recipient_name(text) == name
    assert recipient_name(name) == name


@pytest.mark.parametrize(
    "text",
    ["", " \t ", "\ufeff", "a\0b", "a\nb", "a\x1b[31m", "a\x85b", "a\u2028b", "\udcff", "x" * 257],
)
def test_what_is_no_name_is_refused(text) -> None:
    with pytest.raises(UsageError, match="recipient") as caught:
        recipient_name(text)
    assert len(str(caught.value)) < 100
    assert recipient_name("x" * LONGEST) == "x" * LONGEST


def test_every_form_is_looked_for_once() -> None:
    assert spellings(["a", "b", "a"]) == ("a", "b")
    assert spellings([DECOMPOSED, COMPOSED, " b "]) == (COMPOSED, DECOMPOSED, "b", " b ")


def test_at_signs_are_escaped_on_the_command_line(tmp_path) -> None:
    assert name_or_file("@@acme") == "@acme"
    assert name_or_file("@@@acme") == "@@acme"
    assert name_or_file("ac@me") == "ac@me"
    assert name_or_file(f"@{tmp_path / 'names'}") == tmp_path / "names"


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"], ids=["unix", "windows", "mac"])
def test_files_of_names_are_read_whatever_wrote_them(tmp_path, mark, end) -> None:
    lines = ["acme", "# a comment", "", " globex ", r"\#1", r"\\#2", r"\x", "@home", DECOMPOSED]
    (tmp_path / "names").write_bytes(mark + end.join(line.encode() for line in lines))
    names = ["acme", "globex", "#1", r"\#2", r"\x", "@home", DECOMPOSED]
    assert read_names(tmp_path / "names") == names


def test_files_put_together_hold_no_byte_order_mark(tmp_path) -> None:
    (tmp_path / "names").write_bytes(b"\xef\xbb\xbfacme\n\xef\xbb\xbfglobex\n\xef\xbb\xbf# a\n")
    assert read_names(tmp_path / "names") == ["acme", "globex"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"acme\nglo\0bex\n", "line 2: .*U\\+0000"),
        (b"acme\n" + b"x" * 1000, "line 2: .*256"),
        ("acme".encode("utf-16"), "UTF-8"),
        (b"caf\xe9", "UTF-8"),
    ],
)
def test_files_of_something_else_are_refused(tmp_path, data, message) -> None:
    (tmp_path / "names").write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_names(tmp_path / "names")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
def test_what_is_no_file_is_not_waited_for(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(InputError, match="not a file"):
            read_names(path)


def test_files_without_end_are_refused(tmp_path) -> None:
    with (tmp_path / "names").open("wb") as file:
        file.truncate(1 << 33)
    with pytest.raises(InputError, match="too large"):
        read_names(tmp_path / "names")


@pytest.mark.parametrize("marked", [COMPOSED, DECOMPOSED, f" {COMPOSED}"])
def test_marks_of_older_forms_are_found_and_paid_for(marked) -> None:
    words = KEY.words("apex", 8, 16, marked)
    where = WordPosterior(np.arange(8.0)[None], np.full(8, 0.1))
    variant = RestoredVariant.of(
        0.9 * words[None, None].astype(float), np.zeros(1), posteriors=(where,)
    )
    item = Evidence("/A", "apex", 8, np.zeros(1), (variant,))
    found = AssetEvidence("a", (item,), 1, (), 0.0)
    verdict = judge_all(found, KEY, recipients=[marked])
    assert (verdict.verdict, verdict.recipient) == ("marked", marked)
    unpaid = decide("a", (item,), KEY, recipients=[marked])
    price = np.log10((1 + len(spellings([marked]))) / 2)
    assert verdict.log10_p == pytest.approx(unpaid.log10_p + price)


@pytest.mark.parametrize("marked", [True, False])
@pytest.mark.parametrize("n_frames", [1, 3])
def test_many_names_are_judged_like_each_by_itself(monkeypatch, marked, n_frames) -> None:
    rng = np.random.default_rng(7)
    names = [None, *(f"recipient {n}" for n in range(150))]
    words = KEY.words_of("apex", 24, 16, names)
    soft = rng.uniform(-1.0, 1.0, size=(2, n_frames, 30, 5, 16))
    where = WordPosterior(rng.uniform(0.0, 23.0, size=(30, 5)), np.full(5, 0.2))
    where.position[4] = np.arange(3, 8)
    if marked:
        soft[0, :, 4] = 0.5 * soft[0, :, 4] + 0.5 * words[77, 3:8]
    variants = tuple(
        RestoredVariant.of(
            each, np.full(30, -np.log(30.0)), n, np.log(0.5), posteriors=(where,) * n_frames
        )
        for n, each in enumerate(soft)
    )
    item = Evidence("/A", "apex", 24, np.arange(float(n_frames)), variants)
    counted = []
    exact = significance._pooled_log10_p

    def noted(evidence, words, *bound):
        counted.append(0 if bound else len(words))
        return exact(evidence, words, *bound)

    monkeypatch.setattr(significance, "_pooled_log10_p", noted)
    found, best = log10_p_of(item, words), judge_each(item, KEY, names)[0]
    assert (best.recipient == "recipient 76") == marked
    assert max(counted) < len(names)
    # The same without bounds: everybody is judged exactly.
    monkeypatch.setattr(significance, "_together", exact)
    np.testing.assert_allclose(found, log10_p_of(item, words), rtol=1e-12, atol=0)
    same = judge_each(item, KEY, names)[0]
    assert (same.recipient, same.log10_p) == (best.recipient, pytest.approx(best.log10_p, 1e-12))


@pytest.mark.parametrize("n_frames", [1, 3])
def test_of_many_names_all_that_fit_are_found_though_most_are_left_out_early(n_frames) -> None:
    rng = np.random.default_rng(8)
    names = [None, *(f"recipient {n}" for n in range(400))]
    words = KEY.words_of("apex", 24, 16, names)
    soft = rng.uniform(-0.6, 0.6, size=(n_frames, 30, 5, 16))
    where = WordPosterior(rng.uniform(0.0, 23.0, size=(30, 5)), np.full(5, 0.2))
    where.position[4] = where.position[9] = np.arange(3, 8)
    soft[:, 4] += 0.3 * words[77, 3:8]
    soft[:, 9] += 0.3 * words[304, 3:8]
    variant = RestoredVariant.of(soft, np.full(30, -np.log(30.0)), posteriors=(where,) * n_frames)
    item = Evidence("/A", "apex", 24, np.arange(float(n_frames)), (variant,))
    log10_p = log10_p_of(item, words)
    limit = float(np.sort(log10_p)[1])
    found = judge_each(item, KEY, names, limit)
    assert {one.recipient for one in found} == {"recipient 76", "recipient 303"}
    np.testing.assert_allclose([one.log10_p for one in found], np.sort(log10_p)[:2], rtol=1e-12)
