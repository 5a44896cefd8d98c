"""What single vertices tell of recipients: for copies that were put together from several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.detection.original_layout import OriginalLayout
from meshmark.extension.informed import signs_of
from meshmark.keys import Key
from meshmark.statistics.decoys import log_e_among_decoys

# Secrets that are drawn from the key beside each recipient's.
DECOYS = 31
# Recipients that are tried beside decoys: those whose own chips fit best. Times a number that is 0
# or 1, an e-value still is one.
TRIED = 32


@dataclass(frozen=True, eq=False)
class VertexEvidence:
    """What was measured of single vertices, and what it is read by.

    Parameters
    ----------
    steps : (V,) int16
        What a `meshmark.extension.informed.VertexReader` made of them.
    on : OriginalLayout or None
        Where chips lie on the original; None where that is not at hand, as nothing of it is saved.
    """

    steps: NDArray[np.int16]
    on: OriginalLayout | None = None

    def log_e(self, key: Key, scheme: str, recipients: Sequence[str]) -> FloatArray:
        """Log e-value of each recipient's chips, (n,); 0 where the original is not at hand.

        Of those that are not among the `TRIED` it is -inf.
        """
        if self.on is None or not recipients:
            return np.zeros(len(recipients))
        layout: Any = self.on.layout
        signs = np.array([signs_of(key, scheme, layout, name) for name in recipients])
        names = [str(decoy) for decoy in range(DECOYS)]
        decoys = key.words_of(f"{scheme}/decoys", 1, layout.n_chips, names)[:, 0]
        tried = np.arange(len(signs))
        if len(signs) > TRIED:
            own = self.on.scheme.vertex_fits(self.steps, layout, signs, decoys[:0])
            best = np.argsort(-own.sum(axis=0)[:, 0], kind="stable")[:TRIED]
            tried = np.sort(best)
        log_e = np.full(len(signs), -np.inf)
        fits = self.on.scheme.vertex_fits(self.steps, layout, signs[tried], decoys)
        log_e[tried] = log_e_among_decoys(fits)
        return log_e
