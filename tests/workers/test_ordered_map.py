from __future__ import annotations

import errno
import gc
import os
import pickle
import shutil
import signal
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from meshmark.errors import InputError, OutputError, UsageError, WorkerError
from meshmark.workers.ordered_map import (
    JOBS_VARIABLE,
    TRIED,
    Workers,
    default_jobs,
    ordered_map,
    prepare_workers,
    shared_workers,
)
from meshmark.workers.pool import Pool
from meshmark.workers.scratch import DOUBLE, ScratchFile


def square(x: int) -> int:
    return x * x


def fail_at_seven(x: int) -> int:
    if x == 7:
        raise InputError("seven is bad", source="a.usd", prim="/A", time=7.0)
    return x


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order(jobs) -> None:
    assert list(ordered_map(square, range(20), jobs=jobs)) == [x * x for x in range(20)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_come_home_whole(jobs) -> None:
    with pytest.raises(InputError, match=r"a\.usd: /A: frame 7: seven is bad"):
        list(ordered_map(fail_at_seven, range(20), jobs=jobs))


@pytest.mark.parametrize("size", [10, 10_000_000])
def test_long_results_do_not_go_through_a_pipe(size) -> None:
    # A worker that is killed while it writes into one leaves a torn message.
    with closing(Pool(2)) as pool:
        kept = pool.keep(bytes)
        assert isinstance(kept, Path)
        calls = [pool.submit(kept, size) for _ in range(4)]
        assert all(len(pickle.dumps(call.result())) < 4000 for call in calls)
        assert [pool.result(call) for call in calls[:2]] == [bytes(size)] * 2
        pool.drop(calls[2:])
        assert list(kept.parent.iterdir()) == [kept]


def test_long_results_come_all_the_same_where_nothing_can_be_written(tmp_path) -> None:
    (tmp_path / "function").write_bytes(pickle.dumps(bytes))
    with closing(Pool(1)) as pool:
        call = pool.submit(tmp_path / "function", 1)
        assert pool.result(call) == bytes(1)
        shutil.rmtree(tmp_path)
        assert pool.result(pool.submit(tmp_path / "function", 100_000)) == bytes(100_000)


def process_of(x: int) -> tuple[int, int]:
    return x, os.getpid()


def slowly(x: int) -> tuple[int, int]:
    """Take long enough for workers to start meanwhile, however busy the machine is."""
    start = time.process_time()
    while time.process_time() - start < 0.03:
        pass
    return x, os.getpid()


ITEMS = range(60)


@pytest.mark.parametrize("jobs", [1, 3])
def test_workers_stay_for_every_round_beside_this_process(jobs) -> None:
    items, processes = ITEMS if jobs > 1 else range(3), set()
    with Workers(slowly, jobs) as workers:
        for n in (len(items), 0, 1, 7):
            found = list(workers.map(items[:n]))
            assert [x for x, _ in found] == list(items[:n])
            processes |= {process for _, process in found}
    assert os.getpid() in processes
    assert len(processes) == jobs


def test_all_is_worked_on_here_until_workers_are_ready(monkeypatch) -> None:
    monkeypatch.setattr(Pool, "count_ready", lambda pool: 0)
    with Workers(process_of, 2) as workers:
        assert list(workers.map(range(9))) == [(x, os.getpid()) for x in range(9)]


@pytest.mark.slow
def test_two_items_are_for_two_processes() -> None:
    with shared_workers(2):
        prepare_workers(["meshmark.keys"], len(ITEMS))
        list(ordered_map(slowly, ITEMS, jobs=2))
        there, here = ordered_map(slowly, range(2), jobs=2)
    assert here == (1, os.getpid())
    assert there[0] == 0
    assert there[1] != os.getpid()


@pytest.mark.slow
def test_a_worker_that_cannot_get_ready_says_so_when_it_is_asked() -> None:
    with shared_workers(2):
        prepare_workers(["no_such_module"], len(ITEMS))
        assert [x for x, _ in ordered_map(slowly, ITEMS, jobs=2)] == list(ITEMS)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failed_round_does_not_spoil_the_next(jobs) -> None:
    with Workers(fail_at_seven, jobs) as workers:
        with pytest.raises(InputError, match="seven is bad"):
            list(workers.map(range(20)))
        assert list(workers.map(range(7))) == list(range(7))


@pytest.mark.parametrize("jobs", [1, 2])
def test_items_are_consumed_as_results_are_taken(jobs) -> None:
    taken = []
    items = (taken.append(x) or x for x in range(100))
    with Workers(square, jobs) as workers:
        results = workers.map(items)
        assert [next(results) for _ in range(3)] == [0, 1, 4]
        assert 3 <= len(taken) <= (3 if jobs == 1 else 3 + 2 * jobs + 2)


def processes_of(jobs) -> set[int]:
    return {process for _, process in ordered_map(process_of, range(8), jobs=jobs)}


def work_after_an_import(x: int) -> int:
    """Take some CPU time, the first item as much as all others together."""
    start = time.process_time()
    while time.process_time() - start < (0.2 if x == 0 else 0.01):
        pass
    return os.getpid()


def test_light_work_starts_no_workers() -> None:
    with shared_workers(2):
        found = list(ordered_map(work_after_an_import, range(12), jobs=2, light=True))
    assert found == [os.getpid()] * 12
    assert list(ordered_map(square, range(2), jobs=2, light=True)) == [0, 1]


@pytest.mark.slow
def test_light_work_is_given_to_workers_if_it_is_not_light_or_they_run(monkeypatch) -> None:
    monkeypatch.setattr("meshmark.workers.ordered_map.TO_START", 0.05)
    with shared_workers(2):
        prepared = list(ordered_map(slowly, ITEMS, jobs=2, light=True))
        assert [process for _, process in prepared[:TRIED]] == [os.getpid()] * TRIED
        assert {process for _, process in prepared} > {os.getpid()}
        assert len(set(ordered_map(work_after_an_import, range(4), jobs=2, light=True))) == 2


def test_workers_are_shared_and_end_with_the_block() -> None:
    with shared_workers(2):
        found = {process for _, process in ordered_map(slowly, ITEMS, jobs=2)}
        with shared_workers(2):
            found |= processes_of(2)
        with Workers(process_of, 2) as workers:
            found |= {process for _, process in workers.map(range(8))}
            # Two functions at a time.
            assert list(ordered_map(square, range(4), jobs=2)) == [0, 1, 4, 9]
        found |= processes_of(2)
        [worker] = found - {os.getpid()}
        assert Path(f"/proc/{worker}").exists()
    assert not Path(f"/proc/{worker}").exists()
    assert worker not in processes_of(2)


def killed_elsewhere(home: int) -> int:
    if os.getpid() != home:
        # As the system does to whoever asks for too much memory.
        os.kill(os.getpid(), signal.SIGKILL)
    return slowly(home)[0]


def test_a_killed_worker_is_told_of_and_replaced() -> None:
    with shared_workers(2):
        with pytest.raises(WorkerError, match=f"worker process died.*{JOBS_VARIABLE}=1"):
            list(ordered_map(killed_elsewhere, [os.getpid()] * 200, jobs=2))
        assert list(ordered_map(square, range(4), jobs=2)) == [0, 1, 4, 9]


@pytest.mark.slow
def test_one_item_is_begun_elsewhere_beside_other_work() -> None:
    with shared_workers(2), Workers(process_of, jobs=2) as workers:
        assert not workers.are_ready
        assert workers.begin(1)() == (1, os.getpid())
        list(ordered_map(slowly, ITEMS, jobs=2))
        assert workers.are_ready
        finish = workers.begin(2)
        assert list(ordered_map(square, range(4), jobs=1)) == [0, 1, 4, 9]
        item, process = finish()
        assert item == 2
        assert process != os.getpid()
    assert Workers(process_of, jobs=1).begin(3)() == (3, os.getpid())


@pytest.mark.slow
def test_a_worker_killed_beside_other_work_is_told_of_and_replaced() -> None:
    with shared_workers(2), Workers(killed_elsewhere, jobs=2) as workers:
        list(ordered_map(slowly, ITEMS, jobs=2))
        finish = workers.begin(os.getpid())
        with pytest.raises(WorkerError, match="worker process died"):
            finish()
        assert list(ordered_map(square, range(4), jobs=2)) == [0, 1, 4, 9]


def test_a_round_left_half_way_does_not_spoil_the_next() -> None:
    with shared_workers(2):
        first = next(iter(ordered_map(square, range(50), jobs=2)))
        assert [first, *ordered_map(process_of, [3, 4], jobs=2)][1][0] == 3


def test_functions_reach_workers_where_nothing_can_be_written(monkeypatch) -> None:
    def refuse(*args, **kwargs):
        raise OSError("read-only file system")

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    assert list(ordered_map(square, range(8), jobs=2)) == [x * x for x in range(8)]


def threads_of(x: int) -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.mark.parametrize("jobs", [1, 2])
def test_linear_algebra_keeps_to_one_thread(jobs) -> None:
    with threadpool_limits(limits=2, user_api="blas"), shared_workers(jobs):
        assert set().union(*ordered_map(threads_of, range(4), jobs=jobs)) == {1}


def test_jobs_from_the_environment(monkeypatch) -> None:
    monkeypatch.setenv(JOBS_VARIABLE, "3")
    assert default_jobs() == 3
    for text in ("0", "-1", "many", "1.5"):
        monkeypatch.setenv(JOBS_VARIABLE, text)
        with pytest.raises(UsageError, match=JOBS_VARIABLE):
            default_jobs()
    monkeypatch.delenv(JOBS_VARIABLE)
    assert default_jobs() >= 1


def test_displacements_keep_their_float32_values_in_any_order() -> None:
    rng = np.random.default_rng(0)
    D = rng.normal(scale=1e-3, size=(5, 11, 3)).astype(np.float32)
    scratch = ScratchFile.create(5, 11)
    for index in (4, 0, 2, 1, 3):
        scratch.write(index, D[index].astype(np.float64))
    for index in range(5):
        np.testing.assert_array_equal(scratch.read(index), D[index])


def test_what_more_is_computed_with_keeps_its_float64_values() -> None:
    d = np.random.default_rng(1).normal(size=(11, 3))
    scratch = ScratchFile.create(2, 11, DOUBLE)
    scratch.write(1, d)
    for seen in (scratch, pickle.loads(pickle.dumps(scratch))):
        np.testing.assert_array_equal(seen.read(1), d)
        assert not seen.read(0).any()


def test_one_number_a_point_is_kept_as_well() -> None:
    shares = np.array([[0.5], [1.0], [0.0]])
    scratch = ScratchFile.create(2, 3, width=1)
    scratch.write(1, shares)
    for seen in (scratch, pickle.loads(pickle.dumps(scratch))):
        np.testing.assert_array_equal(seen.read(1), shares)
        assert not seen.read(0).any()


def test_frames_never_written_are_not_displaced() -> None:
    scratch = ScratchFile.create(5, 7)
    scratch.write(1, np.ones((7, 3)))
    for index in (0, 2, 4):
        assert scratch.read(index).shape == (7, 3)
        assert not scratch.read(index).any()


def test_a_full_disk_is_told_of_before_the_work(monkeypatch, tmp_path) -> None:
    def refuse(handle: int, offset: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(os, "posix_fallocate", refuse, raising=False)
    with pytest.raises(OutputError, match=f"{tmp_path}: .*No space left.*TMPDIR"):
        ScratchFile.create(5, 7)
    assert not any(tmp_path.iterdir())
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(OutputError, match="No such file"):
        ScratchFile.create(5, 7)


def test_the_file_goes_with_its_maker_not_with_copies() -> None:
    scratch = ScratchFile.create(1, 3)
    scratch.write(0, np.ones((3, 3)))
    copy = pickle.loads(pickle.dumps(scratch))
    np.testing.assert_array_equal(copy.read(0), np.ones((3, 3)))
    del copy
    gc.collect()
    assert scratch.path.exists()
    path = scratch.path
    del scratch
    gc.collect()
    assert not path.exists()
