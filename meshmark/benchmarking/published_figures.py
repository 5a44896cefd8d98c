"""The figures of the published method, to stand beside ours.

J.-S. Tsai, J.-T. Hsiao, W.-B. Huang, Y.-H. Kuo, "Geodesic-based robust blind watermarking method
for three-dimensional mesh animation by using mesh segmentation and vertex trajectory", ICASSP
2014: 16 bits, strength 0.05, 48 frames of each animation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperDistortion:
    """A row of Table 1: means over the frames. The paper gives no unit of length."""

    hausdorff: float
    mrms: float


@dataclass(frozen=True)
class PaperErrors:
    """A cell of Table 2: bit error rates of the best part, averaged and maximised over frames."""

    average: float
    maximum: float


TABLE_1: Mapping[str, PaperDistortion] = {
    "horse-gallop": PaperDistortion(0.007246, 0.000451),
    "elephant-gallop": PaperDistortion(0.006062, 0.000335),
    "camel-gallop": PaperDistortion(0.002688, 0.000153),
}

_ANIMATIONS = ("horse-gallop", "elephant-gallop", "camel-gallop")

_ROWS: Mapping[str, tuple[tuple[float, float], ...]] = {
    "noise 0.05 %": ((0.0443, 0.1250), (0.0026, 0.0625), (0.0013, 0.0625)),
    "noise 0.10 %": ((0.0443, 0.1250), (0.0026, 0.0625), (0.0013, 0.0625)),
    "quantization 10 bit": ((0.0469, 0.1875), (0.0026, 0.0625), (0.0052, 0.0625)),
    "quantization 11 bit": ((0.0469, 0.1875), (0.0026, 0.0625), (0.0052, 0.0625)),
    "similarity transformation": ((0.0391, 0.1875), (0.0, 0.0), (0.0, 0.0)),
    "simplification 10 %": ((0.0391, 0.1875), (0.0091, 0.0625), (0.0, 0.0)),
    "simplification 30 %": ((0.0677, 0.1875), (0.0339, 0.1250), (0.0104, 0.0625)),
    "smoothing 5": ((0.0469, 0.1250), (0.0104, 0.0625), (0.0, 0.0)),
    "smoothing 10": ((0.0469, 0.1250), (0.0273, 0.0625), (0.0, 0.0)),
    "cropping 10 %": ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    "cropping 30 %": ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    "temporal resampling 1/4": ((0.0534, 0.1875), (0.0, 0.0), (0.0, 0.0)),
    "temporal resampling 1/2": ((0.0508, 0.1875), (0.0, 0.0), (0.0, 0.0)),
}

TABLE_2: Mapping[tuple[str, str], PaperErrors] = {
    (animation, row): PaperErrors(*figures)
    for row, each in _ROWS.items()
    for animation, figures in zip(_ANIMATIONS, each, strict=True)
}

# Half a unit of the last printed digit: as near to a printed figure is as good.
ERROR_DIGIT = 0.5e-4
DISTORTION_DIGIT = 0.5e-6


def worse(ours: float | None, theirs: float, digit: float) -> bool:
    """Tell whether our figure is above the printed one, or missing."""
    return ours is None or ours > theirs + digit
