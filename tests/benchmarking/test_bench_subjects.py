"""Assets of a benchmark: names, files, frames; and where results are kept."""

from __future__ import annotations

import json

import numpy as np
import pytest

from meshmark.benchmarking.store import Store, code_hash, identity_hash
from meshmark.benchmarking.subjects import (
    count_distinct,
    in_memory,
    select_first,
    select_frames,
    short_names,
    subjects_of,
)
from meshmark.benchmarking.timing import StageClock
from meshmark.errors import InputError, OutputError, UsageError
from meshmark.extension.registry import catalogue
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import dumbbell


def moving(steps: np.ndarray) -> MeshAnimation:
    V, F = dumbbell()
    return MeshAnimation.from_arrays(V[None] + steps[:, None, None] * [1.0, 0, 0], F)


def test_stems_are_names_where_they_differ() -> None:
    assert short_names(["a/horse.usdc", "b/dog-obj"]) == ["horse", "dog-obj"]
    assert short_names(["a/x.usda", "b/x.usdc", "y.usda"]) == ["a/x.usda", "b/x.usdc", "y"]


def test_repeated_frames_are_not_counted() -> None:
    cycle = np.array([0.0, 1.0, 2.0])
    assert count_distinct(moving(cycle)) == 3
    assert count_distinct(moving(np.tile(cycle, 2))) == 3
    V, _ = dumbbell()
    diagonal = np.linalg.norm(np.ptp(V, axis=0))
    assert count_distinct(moving(np.array([0.0, 0.9e-3 * diagonal]))) == 1
    assert count_distinct(moving(np.array([0.0, 1.1e-3 * diagonal]))) == 2


def test_frames_are_selected() -> None:
    asset = Asset("x", (moving(np.arange(5.0)),), "memory")
    assert select_frames(asset, "2:5:2").meshes[0].times.tolist() == [2.0, 4.0]
    assert select_first(asset).meshes[0].times.tolist() == [1.0]
    with pytest.raises(UsageError):
        select_frames(asset, "9:10")


def test_stored_positions_are_those_of_a_file() -> None:
    animation = moving(np.array([1 / 3, 2 / 3]))
    asset = Asset("x", (animation,), "memory")
    stored = in_memory(asset, stored=True).meshes[0][1].points
    assert not np.array_equal(stored, animation[1].points)
    np.testing.assert_array_equal(stored, animation[1].points.astype(np.float32))
    np.testing.assert_array_equal(in_memory(asset).meshes[0][1].points, animation[1].points)


def test_sources_are_looked_at_first(tmp_path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        subjects_of([str(tmp_path / "nowhere.usda")], None)


def test_results_are_found_by_what_determines_them(tmp_path) -> None:
    store = Store(tmp_path / "deep" / "cells")
    store.save({"a": 1, "b": [2]}, {"x": 3})
    assert store.load({"b": [2], "a": 1}) == {"identity": {"a": 1, "b": [2]}, "x": 3}
    assert store.load({"a": 1, "b": [3]}) is None
    assert store.finished({"a": 1, "b": [2]})


def test_failures_and_broken_files_are_not_finished(tmp_path) -> None:
    store = Store(tmp_path)
    store.save({"a": 1}, {"error": "no"})
    assert not store.finished({"a": 1})
    store.path({"a": 2}).write_text('{"half": ')
    assert not store.finished({"a": 2})
    store.path({"a": 3}).write_text(json.dumps([]))
    assert not store.finished({"a": 3})


def test_a_folder_that_cannot_be_made_is_told(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        Store(tmp_path / "file" / "cells")


def test_code_is_part_of_the_identity() -> None:
    [solver] = [o for o in catalogue().of_kind("geodesic") if o.name == "heat"]
    assert code_hash([]) == code_hash([])
    assert code_hash([]) != code_hash([solver])
    assert identity_hash({"a": 1, "b": 2}) == identity_hash({"b": 2, "a": 1})


def test_a_clock_adds_up() -> None:
    clock = StageClock()
    for _ in range(2):
        with clock.stage("one"):
            sum(range(1000))
    with pytest.raises(ZeroDivisionError), clock.stage("two"):
        1 / 0  # noqa: B018
    assert clock.seconds["one"] > 0
    assert set(clock.seconds) == {"one", "two"}
