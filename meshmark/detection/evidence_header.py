"""What an evidence file says of itself: parsed before any array is, and bounded in all it claims.

A file that is not authentic may say anything. Whatever is refused here raises `ValueError`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NoReturn, TypeVar

from meshmark.detection.evidence import Evidence, InformedFacts
from meshmark.extension.informed import MOST_VERTICES
from meshmark.statistics.word_windows import WINDOW_SIZE

Thing = TypeVar("Thing")

# Bytes of the header.
LONGEST = 1 << 24
# Characters of a name or note, and how many of one kind there may be.
TEXT, MANY = 1 << 12, 1 << 16
VARIANTS, FRAMES = 1 << 8, 1 << 20
# Readings, carriers and chips of a frame, and bytes of its evidence.
SHAPE, FRAME_BYTES = (1 << 16, 1 << 12, 1 << 12), 1 << 26
# Words where carriers' shapes tell roughly which, and where any may be: all subsets are summed.
PLACED_WORDS, FREE_WORDS = 1 << 12, 16
RESTORED = 1 << 16
# Evidence hardly compresses: a stranger's that claims so many times its size would fill a disk.
EXPANSION = 64


@dataclass(frozen=True)
class RestorationHeader:
    """A `RestoredVariant` but for its arrays; `placed` if carriers' shapes tell their words."""

    restored: int
    log_belief: float
    shape: tuple[int, int, int]
    placed: bool

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame's arrays."""
        R, C, K = self.shape
        return R * C * K + (8 * (R * C + C) if self.placed else 0)


@dataclass(frozen=True)
class ItemHeader:
    """Evidence of a mesh but for its arrays: see `Evidence`."""

    prim: str
    part: str
    also: tuple[str, ...]
    scheme: str
    n_words: int
    n_frames: int
    tracked: bool
    bit_threshold: float
    variants: tuple[RestorationHeader, ...]
    informed: InformedFacts | None
    n_vertices: int

    @property
    def n_bytes(self) -> int:
        """Bytes of all arrays."""
        variants = (8 * s.shape[0] + self.n_frames * s.frame_bytes for s in self.variants)
        return 8 * self.n_frames + sum(variants) + 2 * self.n_vertices


@dataclass(frozen=True)
class Header:
    """The header of an evidence file: see `StoredEvidence`."""

    files: tuple[tuple[str, str], ...]
    original: tuple[tuple[str, str], ...]
    recipes: tuple[dict[str, Any], ...]
    frames: str | None
    notes: tuple[str, ...]
    items: tuple[ItemHeader, ...]
    parameters: dict[str, Any]
    path: str
    version: str

    @property
    def n_bytes(self) -> int:
        """Bytes of all arrays."""
        return sum(item.n_bytes for item in self.items)


def header_text(
    files: Sequence[tuple[str, str]],
    original: Sequence[tuple[str, str]],
    recipes: Sequence[Any],
    frames: str | None,
    notes: Sequence[str],
    items: Sequence[Evidence],
    parameters: Mapping[str, Any],
    path: str,
    version: str,
) -> str:
    """Return the header of an evidence file as JSON."""
    document = {
        "files": [list(pair) for pair in files],
        "original": [list(pair) for pair in original],
        "recipes": list(recipes),
        "frames": frames,
        "notes": list(notes),
        "items": [_described(item) for item in items],
        **({"parameters": dict(parameters)} if parameters else {}),
        **({"path": path} if path else {}),
        **({"version": version} if version else {}),
    }
    return json.dumps(document, allow_nan=False)


def _described(item: Evidence) -> dict[str, Any]:
    return {
        "prim": item.prim,
        "part": item.part,
        "also": list(item.also),
        "scheme": item.scheme,
        "n_words": item.n_words,
        "n_frames": len(item.times),
        "tracked": item.tracked,
        "decisive": item.bit_threshold,
        "informed": None if item.informed is None else asdict(item.informed),
        **({} if item.vertices is None else {"vertices": len(item.vertices.steps)}),
        "strands": [
            {
                "restored": variant.restored,
                "log_belief": variant.log_belief,
                "shape": list(variant.shape[1:]),
                "placed": variant.posteriors is not None,
            }
            for variant in item.variants
        ],
    }


def parse_header(text: str) -> Header:
    """Parse the header of an evidence file.

    Raises
    ------
    ValueError
        If anything in it is of another type, out of bounds, missing or too much.
    """
    try:
        document = json.loads(text, parse_constant=_refuse)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    files, original, recipes, frames, notes, items, parameters, path, version = _values(
        document,
        *("files", "original", "recipes", "frames", "notes", "items"),
        # Readers were given none, or the file is older.
        parameters={},
        # A store tells these.
        path="",
        version="",
    )
    known = _several(recipes, _recipe)
    header = Header(
        files=_several(files, _file),
        original=_several(original, _file),
        recipes=known,
        frames=None if frames is None else _text(frames),
        notes=_several(notes, _text),
        items=_several(items, _item),
        parameters=_parameters(parameters),
        path=_text(path),
        version=_text(version),
    )
    schemes = {recipe["scheme"]["name"] for recipe in known}
    if not all(item.scheme in schemes for item in header.items):
        raise ValueError("scheme")
    return header


def _parameters(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or len(value) > MANY:
        raise ValueError("parameters")
    return {_text(name): _parameter(each) for name, each in value.items()}


def _parameter(value: Any) -> Any:
    if isinstance(value, list):
        return list(_several(value, _text))
    return _text(value) if isinstance(value, str) else _number(value, -1e9, 1e9)


def _item(value: Any) -> ItemHeader:
    (
        *(prim, part, also, scheme, n_words, n_frames, tracked, bit_threshold, informed, variants),
        n_vertices,
    ) = _values(
        value,
        *("prim", "part", "also", "scheme", "n_words", "n_frames", "tracked", "decisive"),
        *("informed", "strands"),
        # Older files tell of none.
        vertices=0,
    )
    item = ItemHeader(
        prim=_text(prim),
        part=_text(part),
        also=_several(also, _text),
        scheme=_text(scheme),
        n_words=_whole(n_words, 1, PLACED_WORDS),
        n_frames=_whole(n_frames, 1, FRAMES),
        tracked=_flag(tracked),
        bit_threshold=_number(bit_threshold, 0.0, 1.0),
        variants=_several(variants, _strand, VARIANTS),
        informed=None if informed is None else _facts(informed),
        n_vertices=_whole(n_vertices, 0, MOST_VERTICES),
    )
    if not item.variants or item.bit_threshold == 1.0:
        raise ValueError("item")
    # Variants differ in how much they show, never in what a word is.
    if len({(s.shape[2], s.placed) for s in item.variants}) != 1:
        raise ValueError("strands")
    if not (item.n_words >= WINDOW_SIZE if item.variants[0].placed else item.n_words <= FREE_WORDS):
        raise ValueError("words")
    return item


def _facts(value: Any) -> InformedFacts:
    prim, poses, maps, method, residual, covered, patches = _values(
        value, "prim", "poses", "maps", "method", "residual", "covered", "patches"
    )
    return InformedFacts(
        prim=_text(prim),
        poses=_several(poses, lambda pose: _number(pose, 0.0, FRAMES)),
        maps=_several(maps, _text),
        method=_text(method),
        residual=_number(residual, 0.0, 1e6),
        covered=_number(covered, 0.0, 2.0),
        patches=_whole(patches, 0, SHAPE[2]),
    )


def _strand(value: Any) -> RestorationHeader:
    restored, log_belief, shape, placed = _values(
        value, "restored", "log_belief", "shape", "placed"
    )
    if not isinstance(shape, list) or len(shape) != len(SHAPE):
        raise ValueError("shape")
    R, C, K = (_whole(size, 1, most) for size, most in zip(shape, SHAPE, strict=True))
    variant = RestorationHeader(
        _whole(restored, 0, RESTORED), _number(log_belief, -1e3, 0.0), (R, C, K), _flag(placed)
    )
    if variant.frame_bytes > FRAME_BYTES:
        raise ValueError("frame")
    return variant


def _file(value: Any) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError("file")
    return _text(value[0]), _text(value[1])


def _recipe(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not isinstance(value.get("scheme"), dict):
        raise ValueError("recipe")
    _text(value["scheme"].get("name"))
    return value


def _values(value: Any, *names: str, **optional: Any) -> list[Any]:
    if not isinstance(value, dict) or value.keys() - optional.keys() != set(names):
        raise ValueError("names")
    return [{**optional, **value}[name] for name in (*names, *optional)]


def _several(value: Any, parse: Callable[[Any], Thing], most: int = MANY) -> tuple[Thing, ...]:
    if not isinstance(value, list) or len(value) > most:
        raise ValueError("list")
    return tuple(map(parse, value))


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > TEXT:
        raise ValueError("text")
    # Half of a character pair is no text.
    value.encode()
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError("flag")
    return value


def _whole(value: Any, low: int, high: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError("whole number")
    return value


def _number(value: Any, low: float, high: float) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ValueError("number")
    if not math.isfinite(value) or not low <= value <= high:
        raise ValueError("number")
    return float(value)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(constant)
