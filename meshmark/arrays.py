"""Types of arrays, as they are called everywhere."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
# As sparse matrices hold indices.
Int32Array: TypeAlias = NDArray[np.int32]
BoolArray: TypeAlias = NDArray[np.bool_]
# Of any width: +1 and -1.
SignArray: TypeAlias = NDArray[np.signedinteger[Any]]
