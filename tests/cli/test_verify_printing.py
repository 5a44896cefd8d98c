"""What `verify` prints of a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.cli.verdicts import _tell_prim
from meshmark.detection.bit_error_rate import BitErrors
from meshmark.detection.significance import HypothesisResult
from meshmark.detection.verdict import PrimVerdict


@pytest.mark.parametrize(
    ("rates", "told"),
    [
        ([0.25, np.nan], "8 chips in 2 frames, BER avg 0.2500 max 0.2500"),
        ([np.nan, np.nan], "8 chips in 2 frames"),
    ],
)
def test_rates_of_errors_are_told_where_bits_were_decided(capsys, rates, told) -> None:
    errors = BitErrors(np.array(rates), np.array([0, -1]))
    finding = HypothesisResult(None, -1.0, np.zeros(2), errors)
    prim = PrimVerdict("/a", "relief", "not marked", -1.0, None, 8, (1.0, 2.0), finding)
    _tell_prim(prim, whose=False)
    assert capsys.readouterr().err.rstrip().endswith(told)
