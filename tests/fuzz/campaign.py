"""Runs inputs by the thousand, each batch in a process forked from one that has all loaded."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .inputs import Input, make_input
from .judging import faults
from .reader import fork_readers
from .running import Place, Ran, limit_resources
from .seeds import Seed

BATCH = 40
# Of so many inputs, one is read by processes forked from ours, and one by processes started anew as
# for users. All others are read in the same process, where what should not is caught as well; what
# fails there counts if it fails as for users, too.
FORKED, AS_FOR_USERS = 10, 500
TOLD = 6000  # characters of what was printed
PATIENCE = 20.0  # seconds for one command


@dataclass(frozen=True)
class Outcome:
    """What came of an input.

    Parameters
    ----------
    index : int
        Of the input.
    codes : tuple
        Exit code of each command that ended.
    faults : tuple of str
        What was wrong, with the last command.
    told : str
        The last command, and what it printed on stderr.
    at_first : tuple of str
        What was wrong when it was read in the process of the command.
    """

    index: int
    codes: tuple[int, ...]
    faults: tuple[str, ...] = ()
    told: str = ""
    at_first: tuple[str, ...] = ()


class Campaign:
    """The inputs of one seed of randomness.

    Parameters
    ----------
    seeds : dict
        What is altered, by kind.
    seed : int
        Of the randomness.
    kinds : sequence of str
        Kinds of inputs wanted.
    root : Path
        Where inputs are run.
    """

    def __init__(
        self, seeds: dict[str, list[Seed]], seed: int, kinds: Sequence[str], root: Path
    ) -> None:
        self._seeds, self._seed, self._kinds = seeds, seed, kinds
        self._root = root

    def make(self, index: int) -> Input:
        """Make an input."""
        return make_input(self._seeds, self._seed, index, self._kinds)

    def run(self, indices: Sequence[int]) -> Iterator[Outcome]:
        """Run inputs; one that fails is run again alone and slowly, and only that counts."""
        left = list(indices)
        while left:
            batch = left[:BATCH]
            done = 0
            for outcome in self._forked([self.make(i) for i in batch]):
                done += 1
                yield self._again(outcome) if outcome.faults else outcome
            left = left[done:]

    def _again(self, outcome: Outcome) -> Outcome:
        return replace(self.alone(self.make(outcome.index)), at_first=outcome.faults)

    def alone(self, given: Input, fast: bool = False) -> Outcome:
        """Run one input in a process of its own, which tells where it fails."""
        [outcome] = self._forked([given], fast=fast, debug=True)
        return outcome

    def _forked(
        self, batch: list[Input], fast: bool = True, debug: bool = False
    ) -> Iterator[Outcome]:
        """Run inputs one after the other in a child, until one fails."""
        theirs, ours = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(theirs)
            _child(batch, self._root, ours, fast, debug)
        os.close(ours)
        codes: list[int] = []
        index, command = batch[0].index, ""
        with os.fdopen(theirs, "rb", buffering=0) as pipe:
            for line in _lines(pipe, pid):
                if line is None:
                    yield Outcome(index, tuple(codes), ("hang",), command)
                    break
                told = json.loads(line)
                if "began" in told:
                    index, codes = told["began"], []
                elif "command" in told:
                    command = told["command"]
                elif "done" in told:
                    yield Outcome(index, tuple(codes))
                else:
                    codes.append(told["code"])
                    if told["faults"]:
                        yield Outcome(index, tuple(codes), tuple(told["faults"]), told["err"])
        status = os.waitpid(pid, 0)[1]
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) != signal.SIGKILL:
            name = signal.Signals(os.WTERMSIG(status)).name
            yield Outcome(index, tuple(codes), (name,), command)
        elif os.WIFEXITED(status) and os.WEXITSTATUS(status):
            raise RuntimeError(f"input {index}: the fuzzer itself failed")


def _lines(pipe: Any, pid: int) -> Iterator[bytes | None]:
    """Yield lines as they come; None where one is not there in time, and the child is killed."""
    rest = b""
    while True:
        end = time.monotonic() + PATIENCE
        ready, _, _ = select.select([pipe], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            os.killpg(pid, signal.SIGKILL)
            yield None
            return
        data = pipe.read(1 << 16)
        if not data:
            return
        *lines, rest = (rest + data).split(b"\n")
        yield from lines


def _child(batch: list[Input], root: Path, pipe: int, fast: bool, debug: bool) -> None:
    code = 1
    try:
        os.setpgid(0, 0)
        limit_resources()
        if debug:
            os.environ["MESHMARK_DEBUG"] = "1"
        _run(batch, Place(root), pipe, fast)
        code = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)


def _run(batch: list[Input], place: Place, pipe: int, fast: bool) -> None:
    for given in batch:
        fork_readers(fast and given.index % AS_FOR_USERS != 0)
        more = ("--trusted",) if fast and given.index % FORKED else ()
        _tell(pipe, {"began": given.index})
        for number, arguments in enumerate(given.commands):
            if arguments[1].startswith("out") and not Path(arguments[1]).exists():
                continue
            _tell(pipe, {"command": _spelled(arguments)})
            # What reads no source has none to trust.
            words = arguments if arguments[0] == "try" else (*arguments, *more)
            ran = place.run(given, words, number)
            wrong = faults(given, ran)
            _tell(pipe, {"code": ran.code, "faults": wrong, "err": _told(ran, wrong)})
            if wrong:
                return
        place.clear(given)
        _tell(pipe, {"done": True})


def _told(ran: Ran, wrong: list[str]) -> str:
    if not wrong:
        return ""
    return f"{_spelled(ran.arguments)}\n{ran.err[-TOLD:]}\n{' '.join(ran.stray)}"


def _spelled(arguments: Sequence[str]) -> str:
    return f"$ meshmark {' '.join(arguments)}"


def _tell(pipe: int, what: dict[str, Any]) -> None:
    data = json.dumps(what).encode() + b"\n"
    while data:
        data = data[os.write(pipe, data) :]
