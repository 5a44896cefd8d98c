"""From frames to evidence to verdicts, by a scheme that says what the test tells it to."""

from __future__ import annotations

import sys
import tracemalloc
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp

from meshmark.detection.evidence import in_steps
from meshmark.detection.extraction import Extraction, extract
from meshmark.detection.looks import HOPE, LOOKS, QUICK, Look
from meshmark.detection.significance import judge
from meshmark.detection.verdict import Verdict
from meshmark.detection.verify import verify
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.statistics.word_windows import WordPosterior
from meshmark.testing.meshes import icosphere

KEY = Key(bytes(range(32)))
NAME, M, K = "oracle", 4, 16
WORDS = KEY.words(NAME, M, K)
SILENCE = np.zeros((M, K))


@dataclass
class Oracle:
    """A scheme that sees, at each time, what it was given for it; and notes what it saw."""

    given: dict[float, np.ndarray]
    restorations: tuple[int, ...] = (0, 10, 30)
    seen: list[tuple[float, bytes]] = field(default_factory=list)
    n_chips = K
    n_words = M
    follows_vertices = False

    def observe(self, frame, reference=None) -> Observation:
        self.seen.append((frame.time, frame.points.tobytes()))
        if frame.time not in self.given:
            raise CapacityError("nothing is seen")
        soft = self.given[frame.time]
        return Observation(soft[None], np.zeros(1), np.zeros((M, 1)), np.arange(M))

    def require_capacity(self, animation, *, jobs) -> None:
        raise NotImplementedError

    def plan(self, animation, words, *, generator, step, jobs) -> None:
        raise NotImplementedError


@dataclass
class OracleRecipe:
    """Stands where a `Recipe` would."""

    oracle: Oracle
    scheme: str = NAME
    informed: bool = False

    def build(self) -> Oracle:
        return self.oracle


def still(n_frames) -> MeshAnimation:
    V, F = icosphere(1)
    return MeshAnimation.from_arrays(
        np.tile(V, (n_frames, 1, 1)), F, times=np.arange(float(n_frames)), prim="/Ball"
    )


def marked_at(times, n_frames) -> Oracle:
    return Oracle({float(t): WORDS if t in times else SILENCE for t in range(n_frames)})


def noise_at(times, seed=0) -> Oracle:
    rng = np.random.default_rng(seed)
    return Oracle({float(t): rng.uniform(-1, 1, size=(M, K)) for t in times})


def test_nothing_is_measured_twice_by_looks_that_grow() -> None:
    scheme, told = noise_at(range(6)), []
    view = Extraction(still(6), scheme, NAME)
    view.look([0], (0,))
    assert len(scheme.seen) == 1
    view.look([0])
    assert len(scheme.seen) == 3
    view.look([0, 2, 4], progress=lambda done, total: told.append((done, total)))
    assert len(scheme.seen) == len(set(scheme.seen)) == 9
    assert told == [(2, 3), (3, 3)]
    view.look([0, 2, 4])
    assert len(scheme.seen) == 9


def test_blends_are_not_shown_and_are_told_of() -> None:
    V, F = icosphere(1)
    # Out and back in straight lines: all but the ends and the turn are blends.
    out = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
    moved = V + np.multiply.outer(out, [1.0, 0.0, 0.0])[:, None, :]
    animation = MeshAnimation.from_arrays(moved, F, times=np.arange(7.0), prim="/Ball")
    scheme = marked_at([0, 3, 6], 7)
    for frames in (":", "auto"):
        found = verify(animation, KEY, recipes=[OracleRecipe(scheme)], frames=frames, fpr=1e-40)
        [note] = found.notes
        assert "/Ball: oracle: 4 of 7 frames are blends" in note
    assert {time for time, _ in scheme.seen} == {0.0, 3.0, 6.0}


def test_looks_that_grew_show_what_one_look_shows() -> None:
    grown, scheme = noise_at(range(6)), noise_at(range(6))
    view = Extraction(still(6), grown, NAME)
    for frames in ([0], [0, 3], range(6)):
        found = view.look(frames)
    at_once = extract(still(6), scheme, NAME)
    np.testing.assert_array_equal(found.times, at_once.times)
    for one, two in zip(found.variants, at_once.variants, strict=True):
        assert (one.restored, one.log_belief) == (two.restored, two.log_belief)
        for frame, wanted in zip(one.frames, two.frames, strict=True):
            np.testing.assert_array_equal(frame.steps, wanted.steps)
    assert set(grown.seen) == set(scheme.seen)


PLACED = WordPosterior(np.arange(2.0, 2.0 + M)[None], np.full(M, 0.1))


@dataclass
class Turning(Oracle):
    """Names its carriers the other way round in frame 1, and tells words by their places."""

    n_words = 16

    def observe(self, frame, reference=None) -> Observation:
        order = np.arange(M)[:: -1 if frame.time == 1.0 else 1]
        own = super().observe(frame)
        placed = WordPosterior(PLACED.position[:, order], PLACED.p_null)
        return replace(own, soft=own.soft[:, order], vertices=order, posterior=placed)


def test_what_is_kept_of_a_frame_is_what_it_is_judged_by() -> None:
    scheme = Turning(noise_at(range(4)).given)
    view = Extraction(still(4), scheme, NAME)
    frames = range(4)
    for variant in view.look(frames).variants:
        wanted = np.array([in_steps(scheme.given[float(t)][None]) for t in frames])
        for t, frame in enumerate(variant.frames):
            assert frame.steps.dtype == np.int8
            np.testing.assert_array_equal(frame.steps, wanted[t])
            np.testing.assert_array_equal(frame.posterior.position, PLACED.position)


@dataclass
class Wide(Oracle):
    """Reads what it sees in many ways."""

    n_words = 16

    def observe(self, frame, reference=None) -> Observation:
        rng = np.random.default_rng(int(frame.time))
        where = WordPosterior(np.tile(PLACED.position, (READINGS, 1)), PLACED.p_null)
        prior = np.full(READINGS, -np.log(READINGS))
        soft = rng.uniform(-1, 1, size=(READINGS, M, K))
        return Observation(soft, prior, np.zeros((M, 1)), np.arange(M), where)


READINGS = 128


def peak_of_looking(n_frames: int) -> int:
    """Bytes that looking at so many frames, and judging them, takes beside the animation."""
    scheme, animation = Wide({}), still(n_frames)
    tracemalloc.start()
    judge(extract(animation, scheme, NAME), KEY)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_looking_at_many_frames_takes_hardly_more_memory_than_few(monkeypatch) -> None:
    monkeypatch.setattr("meshmark.workers.disk_list.ROOM", 1)
    more = (peak_of_looking(30) - peak_of_looking(6)) / 24
    # Three times 8 kB of evidence and 4 kB of places are kept of each frame, on disk.
    assert more < 9_000


@pytest.mark.parametrize("restorations", [(0,), (0, 10), (0, 10, 30, 50)])
def test_what_may_have_been_done_to_a_copy_shares_one_belief(restorations) -> None:
    scheme = noise_at([0])
    scheme.restorations = restorations
    whole = extract(still(1), scheme, NAME)
    assert [variant.restored for variant in whole.variants] == list(restorations)
    assert logsumexp([variant.log_belief for variant in whole.variants]) == pytest.approx(
        0, abs=1e-12
    )
    # A look that leaves restorations out may not believe more in what it looks at.
    [plain] = Extraction(still(1), scheme, NAME).look([0], (0,)).variants
    assert plain.log_belief == whole.variants[0].log_belief


def test_a_frame_without_carriers_is_silent() -> None:
    evidence = extract(still(3), noise_at([0, 2]), NAME)
    assert [bool(np.any(steps)) for steps in evidence.variants[0].under(0)] == [True, False, True]


def test_no_carriers_at_all_name_the_mesh() -> None:
    with pytest.raises(CapacityError, match=r"/Ball.*no carrier"):
        extract(still(3), noise_at([]), NAME)


def test_looks_share_the_rate_and_the_last_sees_everything() -> None:
    assert sum(look.share for look in LOOKS) == 1.0
    assert (LOOKS[-1].frames, LOOKS[-1].restored) == (None, "all")


def test_a_look_undoes_no_smoothing_the_most_or_all() -> None:
    asked = (0, 10, 30)
    restored = {name: Look(1, name, 1.0).restorations(asked) for name in ("none", "most", "all")}
    assert restored == {"none": (0,), "most": (0, 30), "all": asked}
    assert Look(1, "most", 1.0).restorations((0,)) == (0,)


@given(n_frames=st.integers(1, 300))
def test_a_look_spreads_over_the_frames_there_are(n_frames) -> None:
    before: set[int] = set()
    for look in LOOKS:
        frames = look.chosen(range(n_frames), 0)
        count = n_frames if look.frames is None else min(look.frames, n_frames)
        assert len(frames) >= count
        assert frames == sorted(set(frames))
        assert before <= set(frames) <= set(range(n_frames))
        before = set(frames)
        if count > 1:
            # From the first to the last, without a gap much longer than the others.
            assert (frames[0], frames[-1]) == (0, n_frames - 1)
            assert np.diff(frames).max() <= np.ceil((n_frames - 1) / (count - 1))


def new_frames(look: int, n_frames: int = 24) -> list[int]:
    """List the frames that a look is the first to see."""
    earlier = LOOKS[look - 1].chosen(range(n_frames), 0) if look else []
    return sorted(set(LOOKS[look].chosen(range(n_frames), 0)) - set(earlier))


def hinted_at(times, n_frames=24) -> Oracle:
    """Mark some frames, and leave a mere hint in the others: six chips that are right."""
    hint = np.where(np.arange(M * K).reshape(M, K) < 6, WORDS, 0.0)
    return Oracle({float(t): WORDS if t in times else hint for t in range(n_frames)})


@pytest.mark.parametrize("look", [0, 2, 3, 4])
def test_more_frames_are_looked_at_only_while_they_do_not_decide(look) -> None:
    scheme = hinted_at(new_frames(look))
    verdict = verify(still(24), KEY, recipes=[OracleRecipe(scheme)], frames="auto")
    assert verdict.verdict == "marked"
    frames = LOOKS[look].chosen(range(24), 0)
    assert {time for time, _ in scheme.seen} == set(map(float, frames))
    restorations = LOOKS[look].restorations(scheme.restorations)
    alone = Extraction(still(24), hinted_at(new_frames(look)), NAME).look(frames, restorations)
    paid = judge(alone, KEY).log10_p - np.log10(LOOKS[look].share)
    assert verdict.log10_p == pytest.approx(paid, abs=1e-12)


@pytest.fixture
def gives_up(monkeypatch) -> None:
    """Let `verify` give up on what the oracle sees, as it does on what apex does."""
    monkeypatch.setattr(sys.modules[verify.__module__], "GIVEN_UP", (NAME,))


def verdict_on(scheme, n_frames=24, **asked) -> Verdict:
    return verify(still(n_frames), KEY, recipes=[OracleRecipe(scheme)], **asked)


def marked_unseen(n_frames) -> Oracle:
    """Mark all frames but those of the quick looks, which show noise."""
    quick = QUICK[-1].chosen(range(n_frames), 0)
    given = {float(t): WORDS for t in range(n_frames)} | noise_at(quick, seed=1).given
    return Oracle(given)


def test_by_a_scheme_that_was_not_measured_nobody_gives_up() -> None:
    found = verdict_on(marked_unseen(24), frames="auto")
    assert (found.verdict, found.ended) == ("marked", "marked")


@pytest.mark.usefixtures("gives_up")
def test_without_hope_the_quick_looks_are_the_last() -> None:
    scheme = marked_unseen(24)
    found = verdict_on(scheme, frames="auto")
    assert (found.verdict, found.log10_p, found.ended) == ("not marked", 0.0, "no hope")
    assert found.hope > HOPE
    assert {time for time, _ in scheme.seen} == set(map(float, QUICK[-1].chosen(range(24), 0)))
    [note] = found.notes
    assert note.startswith("oracle: 4 of 24 frames give no hope")
    assert [(look.frames, look.restored) for look in found.looks] == [
        (look.frames, look.restored) for look in QUICK
    ]
    # Whoever wants to be sure looks at everything.
    whole = verdict_on(scheme, frames=":")
    assert (whole.verdict, whole.ended, whole.notes) == ("marked", "marked", ())


@pytest.mark.usefixtures("gives_up")
def test_a_little_hope_is_enough_to_look_at_everything() -> None:
    found = verdict_on(hinted_at(new_frames(4)), frames="auto")
    assert (found.verdict, found.ended, len(found.looks)) == ("marked", "marked", 5)
    hints = verdict_on(hinted_at(()), frames="auto")
    assert (hints.verdict, hints.ended, len(hints.looks)) == ("inconclusive", "all seen", 5)
    # What shows no chip shows no hope.
    silent = verdict_on(marked_at((), 24), frames="auto")
    assert (silent.verdict, silent.ended) == ("inconclusive", "no hope")


@pytest.mark.usefixtures("gives_up")
def test_nobody_gives_up_over_frames_that_cannot_be_read() -> None:
    scheme = marked_unseen(24)
    points = np.array([frame.points for frame in still(24)])
    points[QUICK[-1].chosen(range(24), 0)[1], 0] = np.nan
    broken = MeshAnimation.from_arrays(points, icosphere(1)[1], times=np.arange(24.0), prim="/Ball")
    found = verify(broken, KEY, recipes=[OracleRecipe(scheme)], frames="auto")
    assert found.verdict == "marked"


@pytest.mark.usefixtures("gives_up")
def test_giving_up_takes_the_rate_of_the_last_look_for_granted() -> None:
    # What 64 chips can reach is enough for half of this rate, and not for an eighth.
    reach = extract(still(1), noise_at([0]), NAME).reachable_log10_p
    fpr = 10.0 ** (reach + np.log10(4.0))
    for seed, frames in ((1, "auto"), (1, ":")):
        found = verdict_on(noise_at(range(8), seed), 8, frames=frames, fpr=fpr)
        assert found.verdict == "not marked"


def test_looks_and_one_look_give_the_same_answer() -> None:
    for scheme, answer in ((marked_at((0, 1), 3), "marked"), (noise_at(range(3)), "not marked")):
        looked = verify(still(3), KEY, recipes=[OracleRecipe(scheme)], frames="auto")
        whole = verify(still(3), KEY, recipes=[OracleRecipe(scheme)])
        auto = verify(still(3), KEY, recipes=[OracleRecipe(scheme)], frames="auto")
        assert looked.verdict == whole.verdict == auto.verdict == answer
        assert auto.log10_p == looked.log10_p


def test_a_scheme_that_sees_nothing_is_paid_for_and_noted() -> None:
    blind = OracleRecipe(noise_at([]), "blind")
    sharp = OracleRecipe(marked_at((0,), 1))
    alone = verify(still(1), KEY, recipes=[sharp], frames="auto")
    both = verify(still(1), KEY, recipes=[blind, sharp], frames="auto")
    assert both.log10_p == pytest.approx(alone.log10_p + np.log10(2), abs=1e-12)
    assert [prim.scheme for prim in both.prims] == [NAME]
    [note] = both.notes
    assert note.startswith("/Ball: blind: no carrier")
    nothing = verify(still(1), KEY, recipes=[blind], frames="auto")
    assert (nothing.verdict, nothing.log10_p, nothing.prims) == ("inconclusive", 0.0, ())
