"""How much generated rows count in a model's loss (paper, eq. 7).

In:  origins of rows. Out: one weight per row, for any estimator that takes sample weights.

    L = sum_c (N_c / N) omega_c mean_{k in c} (M(In_k) - I_k)²,  c in {data, PE}
      = (1 / N) sum_k omega_c(k) (M(In_k) - I_k)²

The share N_c / N of eq. 7 and the 1 / N_c of its mean cancel: every row simply weighs omega of its category.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.samples import REAL


def loss_weights(origin: Int1D, data: float = 1.0, generated: float = 1.0) -> Float1D:
    """(n,): omega_data for real rows, omega_PE for PiA and PiE rows."""
    return np.where(np.asarray(origin) == REAL, float(data), float(generated))


def certainty_weights(origin: Int1D, expected_error: Float2D, typical: Float1D, generated: float = 1.0) -> Float2D:
    """(n, 4): as above, and a generated current counts less the larger its expected error is beside the `typical`
    (4,) error of a real row, A:  omega_PE typical² / (typical² + expected_error²)."""
    square = np.asarray(typical, float) ** 2
    trust = square / np.maximum(square + np.nan_to_num(expected_error) ** 2, 1e-300)
    return np.where(np.asarray(origin)[:, None] == REAL, 1.0, generated * trust)
