"""Whatever is done to a chain is found, and the entry is named."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.ledger.chain import ORIGIN, Link, canonical, findings, hash_of, record_of


def chain(n: int) -> list[Link]:
    links: list[Link] = []
    for sequence in range(1, n + 1):
        previous = links[-1].hash if links else ORIGIN
        content = {"kind": "mark", "asset": f"creature {sequence % 3}", "recipient": "Zoë"}
        told = {"recorded_at": "2026-01-01T00:00:00+00:00", "recorded_by": "td"}
        links.append(Link.of({**content, "n": sequence, "sequence": sequence, **told}, previous))
    return links


def head(links: list[Link]) -> tuple[int, str]:
    return (links[-1].sequence, links[-1].hash) if links else (0, ORIGIN)


def found(links: list[Link], last: tuple[int, str]) -> list[tuple[int, str]]:
    return [(each.sequence, each.kind) for each in findings(links, last)]


def test_the_hash_is_that_of_the_hash_before_and_the_text() -> None:
    first, second = chain(2)
    assert first.hash == hashlib.sha256((64 * "0" + first.body).encode()).hexdigest()
    assert second.hash == hashlib.sha256((first.hash + second.body).encode()).hexdigest()
    line = json.loads(second.as_line())
    assert line == {"previous": first.hash, "hash": second.hash, "entry": second.entry}
    assert canonical(line["entry"]) == second.body


def test_what_is_recorded_has_a_name_that_place_and_time_do_not_change() -> None:
    first = chain(1)[0].entry
    later = {**first, "sequence": 7, "recorded_at": "2027-01-01T00:00:00+00:00"}
    assert record_of(first) == record_of(later)
    assert record_of(first) != record_of({**first, "recipient": "Zoe"})


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_whole_chain_is_whole(n: int) -> None:
    links = chain(n)
    assert not found(links, head(links))


def test_missing_entries_are_named() -> None:
    links = chain(6)
    last = head(links)
    assert found(links[:2] + links[3:], last) == [(3, "missing")]
    assert found(links[:1] + links[4:], last) == [(2, "missing")]
    assert found(links[1:], last) == [(1, "missing")]
    assert found(links[:-1], last) == [(6, "missing")]
    assert found([], last) == [(1, "missing")]
    told = [each.what for each in findings(links[:1] + links[4:], last)]
    assert told == ["and all up to entry 4 are missing"]


def test_a_swapped_pair_is_named() -> None:
    links = chain(5)
    swapped = [*links]
    swapped[1], swapped[2] = (
        replace(links[2], sequence=2),
        replace(links[1], sequence=3),
    )
    assert found(swapped, head(links)) == [(2, "re-ordered"), (3, "re-ordered")]


def test_another_history_with_the_old_head_is_found() -> None:
    links = chain(3)
    forged = Link.of({**links[2].entry, "recipient": "nobody"}, links[1].hash)
    assert found([*links[:2], forged], head(links)) == [(3, "changed")]
    assert found([*links, chain(4)[3]], head(links)) == [(4, "changed")]
    for body in ("{", "[]", "{}", "null"):
        nothing = Link(3, body, links[1].hash, hash_of(links[1].hash, body), {})
        assert found([*links[:2], nothing], (3, nothing.hash)) == [(3, "changed")]
    links = chain(4)
    forged = Link.of({**links[1].entry, "recipient": "nobody"}, links[0].hash)
    assert found([links[0], forged, *links[2:]], head(links)) == [(2, "changed")]


@given(st.integers(1, 5), st.data())
def test_any_changed_character_is_found(sequence: int, data: st.DataObject) -> None:
    links = chain(5)
    link = links[sequence - 1]
    place = data.draw(st.integers(0, len(link.body) - 1))
    other = data.draw(st.characters(codec="utf-8", exclude_characters=link.body[place]))
    body = link.body[:place] + other + link.body[place + 1 :]
    links[sequence - 1] = replace(link, body=body)
    assert found(links, head(links)) == [(sequence, "changed")]


@pytest.mark.parametrize("name", ["asset", "recipient", "record", "kind"])
def test_a_changed_column_is_found(name: str) -> None:
    links = chain(4)
    links[2] = replace(links[2], indexed={**links[2].indexed, name: "other"})
    assert found(links, head(links)) == [(3, "changed")]
