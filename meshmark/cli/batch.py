"""Answers for many sources by one command: streamed, resumed, in processes or on a cluster."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshmark.cli.console import batch_progress, exit_code, frame_progress, say, warn

if TYPE_CHECKING:
    from meshmark.commands.answers import Answer, AnswerFile
    from meshmark.commands.outcome import Outcome

ANSWERS = ("marked", "not marked", "inconclusive", "failed")

JsonlOption = Annotated[
    bool,
    typer.Option("--jsonl", help="Print one line of JSON for each source as it is finished."),
]
ResumeOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Add such lines to FILE, and leave out what is answered there."
    ),
]
JobsOption = Annotated[
    int | None,
    typer.Option(
        min=1, help="Processes, each on one source at a time; by default one a processor."
    ),
]
TimeoutOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="What one source may take: it is given up then, and no other is."
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Of a Dask cluster that does the work."),
]


class Tally:
    """Counts answers, for the exit code and for whoever asked for many."""

    def __init__(self) -> None:
        self._told: Counter[str] = Counter()
        self._worst = 0
        self._before = 0

    def add(self, verdict: str | None, error_code: int) -> None:
        """Count one: a verdict, or None and the exit code of an error."""
        self._told[verdict or "failed"] += 1
        self._worst = max(self._worst, error_code)

    def add_known(self, answers: Mapping[str, Answer]) -> None:
        """Count what was answered before."""
        for answer in answers.values():
            self.add(answer.verdict, answer.exit_code)
        self._before += len(answers)

    @property
    def exit_code(self) -> int:
        """The worst error's, or else that of all verdicts."""
        return self._worst or exit_code(self._told)

    def end(self) -> None:
        """Say how many there were, if several, and leave with the exit code unless that is 0."""
        if self._told.total() > 1:
            say(str(self))
        if self.exit_code:
            raise typer.Exit(self.exit_code)

    def __str__(self) -> str:
        counts = ", ".join(f"{self._told[each]:,} {each}" for each in ANSWERS if self._told[each])
        before = f", {self._before:,} of them before" if self._before else ""
        return f"{self._told.total():,} sources: {counts}{before}"


@dataclass(frozen=True)
class Batch:
    """How many sources are answered for.

    Parameters
    ----------
    stage : str
        What progress calls it.
    jsonl : bool
        Print lines.
    resume : Path, optional
        File of answers to go on with.
    jobs : int, optional
        Processes.
    scheduler : str, optional
        Address of a cluster.
    timeout : float, optional
        Seconds that one source may take.
    """

    stage: str
    jsonl: bool
    resume: Path | None
    jobs: int | None
    scheduler: str | None
    timeout: float | None

    @property
    def recorded(self) -> bool:
        """Whether there are lines."""
        return self.jsonl or self.resume is not None

    def require_sense(self, json: bool) -> None:
        """Refuse what does not go together.

        Parameters
        ----------
        json : bool
            Whether one document is asked for.
        """
        from meshmark.errors import UsageError

        if json and self.recorded:
            raise UsageError("--json is one document in the end; no --jsonl or --resume")
        if self.scheduler is not None and self.jobs is not None:
            raise UsageError("--scheduler says by itself who does the work; no --jobs")
        if self.timeout is not None and not 0.0 < self.timeout < math.inf:
            raise UsageError(
                f"--timeout must be a positive number of seconds, not {self.timeout:g}"
            )

    def answers(self) -> AbstractContextManager[AnswerFile | None]:
        """Open the file of answers, if there is one."""
        from meshmark.commands.answers import answers_kept

        return nullcontext() if self.resume is None else answers_kept(self.resume)

    def run(
        self,
        sources: Sequence[str],
        request: Any,
        answer: Callable[..., Outcome[Any]],
        tell: Callable[[Outcome[Any]], None],
    ) -> Tally:
        """Answer for all sources that are not answered yet, and count all.

        Parameters
        ----------
        request : AnyRequest
            A dataclass with `jobs`.
        answer : callable
            Takes a source, the request, and whoever is told of progress.
        tell : callable
            Told what became of each source, as soon as it is recorded.
        """
        tally = Tally()
        with self.answers() as kept:
            known = {} if kept is None else kept.known(sources, request)
            tally.add_known(known)
            left = [source for source in sources if source not in known]
            with closing(self._outcomes(left, request, answer)) as outcomes:
                for outcome in outcomes:
                    if self.recorded:
                        self._record(outcome, kept)
                    tell(outcome)
                    tally.add(outcome.answer, outcome.exit_code)
        return tally

    def _record(self, outcome: Outcome[Any], kept: AnswerFile | None) -> None:
        """Write a line into the file of answers, and print it."""
        from meshmark.commands.answers import as_line

        line = as_line(outcome)
        if kept is not None:
            kept.append(line)
        if self.jsonl:
            typer.echo(line)

    def _outcomes(
        self, sources: Sequence[str], request: Any, answer: Callable[..., Outcome[Any]]
    ) -> Generator[Outcome[Any]]:
        """Answer for sources, each in a process of its own if there are several."""
        from meshmark.commands.batch import Task, answer_many
        from meshmark.workers.ordered_map import default_jobs

        there = default_jobs() if self.jobs is None else self.jobs
        if not sources or self._is_done_here(sources):
            for source in sources:
                with frame_progress() as progress:
                    outcome = answer(source, replace(request, jobs=there), progress)
                yield outcome
            return
        n = min(there, len(sources))
        if self.scheduler is not None:
            from meshmark.commands.cluster import answer_on_cluster

            task = Task(answer, request, str(Path.cwd()))
            many = answer_on_cluster(sources, task, self.scheduler, warn)
        else:
            task = Task(answer, replace(request, jobs=there // n), str(Path.cwd()))
            many = answer_many(sources, task, n)
        shown = batch_progress(self.stage, len(sources), printing=self.jsonl)
        with shown as advance, closing(many):
            for outcome in many:
                yield outcome
                advance()

    def _is_done_here(self, sources: Sequence[str]) -> bool:
        """Whether this process does the work: it cannot end itself in time."""
        from meshmark.workers.ordered_map import JOBS_VARIABLE

        if self.scheduler is not None or self.timeout is not None:
            return False
        alone = self.jobs is None and os.environ.get(JOBS_VARIABLE) == "1"
        return len(sources) == 1 or alone
