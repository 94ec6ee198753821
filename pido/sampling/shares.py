"""How many samples a bin is given, from how many it holds (paper, section III-F and eq. 15 and 16).

In:  number of real samples per bin. Out: number of PiA and PiE samples to generate.

    f_PiA(x) = -5.908e-8 x⁴ + 3.653e-6 x³ + 4.098e-4 x² - 1.017e-2 x + 1.768e-2
    f_PiE(x) = -1.119e-6 x⁴ + 3.314e-4 x³ - 3.522e-2 x² + 1.335 x + 1.766

x and the result are percent of the target density rho (40 samples per bin). x is clipped to 100, where the polynomials
end; a negative share is none. At rho = 40 eq. 15 never asks for more than 1.28 % of 40, half a sample: rounded to the
nearest whole number PiA is next to nothing, rounded by chance its mean is kept. The paper states no rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pido.core.arrays import Array1D, Float1D, Int1D
from pido.core.errors import FitError

Share = Callable[[Float1D], Float1D]


def paper_pia(x: Float1D) -> Float1D:
    """Eq. 15: percent of the target density to add by PiA where x percent of it are there.

    >>> round(float(paper_pia(np.array(82.0))), 2)
    1.28
    """
    x = np.clip(x, 0.0, 100.0)
    return np.maximum(np.polyval([-5.908e-8, 3.653e-6, 4.098e-4, -1.017e-2, 1.768e-2], x), 0.0)


def paper_pie(x: Float1D) -> Float1D:
    """Eq. 16: percent of the target density to add by PiE where x percent of it are there.

    >>> round(float(paper_pie(np.array(30.0))), 1)
    18.2
    """
    x = np.clip(x, 0.0, 100.0)
    return np.maximum(np.polyval([-1.119e-6, 3.314e-4, -3.522e-2, 1.335, 1.766], x), 0.0)


def generous_pie(x: Float1D) -> Float1D:
    """Four times eq. 16 where a bin holds samples, none where it holds none: for equations that have proven better."""
    return np.where(np.asarray(x) > 0, 4.0 * paper_pie(x), 0.0)


def fill(x: Float1D) -> Float1D:
    """What is missing to the target density, in percent: the plainest balance."""
    return np.clip(100.0 - np.asarray(x, float), 0.0, 100.0)


def nothing(x: Float1D) -> Float1D:
    """No samples at all."""
    return np.zeros_like(np.asarray(x, float))


SHARES: dict[str, Share] = {
    "paper-pia": paper_pia,
    "paper-pie": paper_pie,
    "generous-pie": generous_pie,
    "fill": fill,
    "none": nothing,
}


@dataclass(frozen=True)
class ShareRule:
    """Shares of the target density, and how a share becomes a whole number.

    density : rho, samples per bin
    pia, pie : percent of rho to add, as functions of percent of rho that is there
    rounding : 'stochastic' keeps the mean over bins; 'nearest' is the other reading of the paper
    """

    density: float = 40.0
    pia: Share = paper_pia
    pie: Share = paper_pie
    rounding: Literal["stochastic", "nearest"] = "stochastic"

    def __post_init__(self) -> None:
        if not 0 < self.density < np.inf:
            raise FitError(f"target density {self.density}: it must be positive and finite (samples per bin).")

    def wanted(self, n_real: Int1D, rng: np.random.Generator) -> tuple[Int1D, Int1D]:
        """Number of PiA and PiE samples for bins that hold `n_real`. PiA never exceeds n_real: each is drawn once."""
        x = 100.0 * np.asarray(n_real).astype(float) / self.density
        pia, pie = (self._round(f(x) / 100.0 * self.density, rng) for f in (self.pia, self.pie))
        return np.minimum(pia, n_real), pie

    def _round(self, number: Array1D, rng: np.random.Generator) -> Int1D:
        if self.rounding == "nearest":
            return np.rint(number).astype(np.int64)
        whole = np.floor(number)
        return (whole + (rng.random(number.shape) < number - whole)).astype(np.int64)
