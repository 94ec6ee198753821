"""Array types, named by their dimensions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float1D = NDArray[np.float64]
Float2D = NDArray[np.float64]
Float3D = NDArray[np.float64]
Complex2D = NDArray[np.complex128]
Int1D = NDArray[np.int64]
Int2D = NDArray[np.int64]
Bool1D = NDArray[np.bool_]
Bool2D = NDArray[np.bool_]
Array1D = NDArray[Any]
Array2D = NDArray[Any]
