"""What noise looks like, so that an effect can be told from it: coloured, and louder in some states than in others.

In:  a residual, row by row in time, with the places where the record is interrupted and a class of state per row.
Out: a `Noise` that turns residual and regressors into rows with independent errors of unit variance.
Source: generalised least squares with autoregressive errors (Cochrane and Orcutt 1949; Hamilton, Time Series Analysis,
ch. 8); order by BIC (Schwarz 1978); scale by the normal-consistent median absolute deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import lfilter
from scipy.sparse import csr_array, dia_array, diags_array

from pido.core.arrays import Array2D, Bool1D, Float1D, Int1D

MAD_TO_SD = 1.4826022185056018  # of a normal distribution
HUBER = 6.0  # whitened residuals beyond this many sd are spikes, not noise: they are limited to it
BEYOND = 50.0  # standard deviations that neither noise nor an effect worth a name has in a single row
_AROUND = 5  # rows around such a row that share its weight
_BLOCK = 128  # rows in which power is compared to set events aside
_NEIGHBOURS = 60  # frequencies on either side whose median is the noise at a frequency
_LOUD = 2.5  # times the usual power of a block: an event or an effect, not noise
_SHORTEST_AVERAGE = 3  # rows; the noise of a shorter memory is as good as white
_FEWEST = 60  # rows that a class of state needs for a noise level of its own


@dataclass(frozen=True, slots=True)
class Noise:
    """An AR(p) process times a level per row.

    ar : (p,) – e_t = sum_j ar_j * e_(t-j) + innovation, of the residual divided by its level
    level : (n,) – standard deviation of the residual per row
    innovation : scalar – standard deviation of the innovation of the scaled residual
    valid : (n,) – rows whose p predecessors belong to the same uninterrupted stretch
    """

    ar: Float1D
    level: Float1D
    innovation: float
    valid: Bool1D

    def whiten(self, rows: Array2D) -> Array2D:
        """(k, n) -> (k, n) with unit, independent errors; rows that have no full past become zero; float32 stays."""
        kind = np.float32 if rows.dtype == np.float32 else float
        scaled = rows / self.level.astype(kind, copy=False)
        out = scaled.copy()
        for lag, phi in enumerate(self.ar, start=1):
            out[..., lag:] -= float(phi) * scaled[..., :-lag]
        out *= (self.valid / self.innovation).astype(kind, copy=False)
        return out

    def matrix(self) -> csr_array:
        """(n, n), sparse: `whiten(rows)` is `rows @ matrix().T`, for rows that are zero nearly everywhere."""
        n, lags = len(self.level), np.arange(len(self.ar) + 1)
        past = np.r_[1.0, -self.ar][:, None] / self.level  # of the row that is a lag before
        return csr_array(diags_array(self.valid / self.innovation) @ dia_array((past, -lags), shape=(n, n)).tocsr())

    @property
    def memory(self) -> float:
        """Integrated autocorrelation time, samples (>= 1)."""
        return autocorrelation_time(self.ar)


@dataclass(frozen=True, slots=True)
class Averaged(Noise):
    """Noise judged by averages over its own memory: what is slow counts, and nothing that is quicker.

    Each average stands in the first of its rows; `valid` are these rows.

    first : (m,) – first row of each average; counted : (n,) – rows that enter it
    """

    first: Int1D
    counted: Bool1D

    def whiten(self, rows: Array2D) -> Array2D:
        """(k, n) -> (k, n): averages with independent errors of unit variance, zero in all rows but the first."""
        kind = np.float32 if rows.dtype == np.float32 else float
        scaled = rows * (self.counted / self.level).astype(kind)
        out = np.zeros_like(scaled)
        out[..., self.first] = np.add.reduceat(scaled, self.first, axis=-1) * self._share().astype(kind)
        return out

    def matrix(self) -> csr_array:
        """(n, n), sparse: `whiten(rows)` is `rows @ matrix().T`."""
        n = len(self.level)
        of = np.repeat(np.arange(len(self.first)), np.diff(self.first, append=n))
        values = self._share()[of] * self.counted / self.level
        return csr_array((values, (self.first[of], np.arange(n))), shape=(n, n))

    def _share(self) -> Float1D:
        """(m,) – of a sum of scaled rows, what is an average of unit variance."""
        count = np.add.reduceat(self.counted.astype(float), self.first)
        return 1.0 / (np.sqrt(np.maximum(count, 1.0)) * self.innovation)


def averaged(noise: Noise, residual: Float1D, part: Int1D, usable: Bool1D) -> Averaged | None:
    """`noise` judged by averages over its memory, their scale read from a residual; None where that is a row or two.

    part : (n,) – index of the part; no average reaches over the end of one
    """
    width = round(noise.memory)
    if width < _SHORTEST_AVERAGE:
        return None
    starts = np.r_[True, part[1:] != part[:-1]]
    first = np.flatnonzero(_since_start(starts) % width == 0)
    valid = np.zeros(len(part), bool)
    valid[first] = np.add.reduceat(usable, first) > 0
    plain = Averaged(np.zeros(0), noise.level, 1.0, valid, first, usable)
    return replace(plain, innovation=robust_sd(plain.whiten(residual[None])[0][valid]))


def autocorrelation_time(ar: Float1D, longest: int = 20_000) -> float:
    """Samples that count as one: 1 + 2 * sum of the autocorrelations of an AR process, at least 1.

    >>> round(autocorrelation_time(np.array([0.5])), 6)  # (1 + phi) / (1 - phi)
    3.0
    """
    if len(ar) == 0:
        return 1.0
    # Variance of the mean over variance of the sample: spectrum at zero over total power.
    psi = impulse_response(ar, longest)
    gain = 1.0 / (1.0 - float(np.sum(ar))) ** 2
    return float(max(1.0, gain / np.sum(psi**2)))


def impulse_response(ar: Float1D, longest: int) -> Float1D:
    """(m,) – what one unit innovation becomes, until it has died away."""
    unit = np.zeros(longest)
    unit[0] = 1.0
    return np.asarray(lfilter([1.0], np.r_[1.0, -ar], unit))


def estimate_noise(
    residual: Float1D,
    starts: Bool1D,
    state: Int1D,
    usable: Bool1D | None = None,
    highest_order: int = 24,
    smooth_spectrum: bool = False,
) -> Noise:
    """Level per class of state, then AR by Yule-Walker with the order of least BIC.

    residual : (n,) – what a flexible fit left over
    starts : (n,) – True where a row does not follow the one before it
    state : (n,) – class of state, 0, 1, ...; classes with few rows share the common level
    smooth_spectrum : what stands out of the spectrum as a line, or only at its lowest end, is taken for an effect that
        has not been found yet; for a first look, before anything is in the fit
    """
    usable = np.ones(len(residual), bool) if usable is None else usable
    common = robust_sd(residual[usable])
    level = np.full(len(residual), common)
    for c in np.unique(state):
        rows = (state == c) & usable
        if rows.sum() >= _FEWEST:
            # Shrunk to the common level: few independent samples stand behind a class.
            own = robust_sd(residual[rows])
            weight = rows.sum() / (rows.sum() + 4 * _FEWEST)
            level[state == c] = np.exp(weight * np.log(max(own, 0.2 * common)) + (1 - weight) * np.log(common))
    # What is beyond all noise and no model reaches (a spike at a change of speed, too short for the sampling) may not
    # outvote everything else.
    amiss = maximum_filter1d(np.where(usable, np.abs(residual), 0.0), _AROUND)
    level = np.where(amiss > BEYOND * level, amiss / HUBER, level)
    scaled = np.where(usable, np.clip(residual / level, -HUBER, HUBER), 0.0)
    quiet = usable & _quiet(scaled, usable)
    # Rows of loud blocks keep their place in time and are left out of every product.
    kept = np.where(quiet, scaled, 0.0)
    if smooth_spectrum:
        ar = _ar_of_spectrum(kept, int(quiet.sum()), highest_order)
    else:
        ar, _ = fit_ar(kept, starts | ~quiet | _after(~quiet), highest_order, quiet)
    noise = Noise(ar, level, 1.0, _has_past(starts | ~usable | _after(~usable), len(ar)) & usable)
    innovations = noise.whiten(residual[None])[0][noise.valid & quiet]
    return replace(noise, innovation=max(float(np.std(np.clip(innovations, -HUBER, HUBER))), 1e-9))


def _ar_of_spectrum(x: Float1D, n: int, highest_order: int) -> Float1D:
    """AR coefficients from a periodogram whose every value is the median of its neighbours."""
    power = np.abs(np.fft.rfft(x)) ** 2 / max(1, n)
    if len(power) > 2 * _NEIGHBOURS:
        power = median_filter(power, 2 * _NEIGHBOURS + 1, mode="reflect") / np.log(2)
    gamma = np.fft.irfft(power, len(x))[: highest_order + 1]
    return _least_bic(gamma, n, highest_order)[0]


def _quiet(x: Float1D, usable: Bool1D) -> Bool1D:
    """Rows of blocks whose power is not far above that of the usual block."""
    block = np.arange(len(x)) // _BLOCK
    count = np.bincount(block, usable)
    power = np.bincount(block, x**2 * usable) / np.maximum(count, 1)
    usual = np.median(power[count > _BLOCK / 2]) if np.any(count > _BLOCK / 2) else np.inf
    return (power <= _LOUD * usual)[block] if usual > 0 else np.ones(len(x), bool)


def _after(gap: Bool1D) -> Bool1D:
    return np.r_[False, gap[:-1]]


def fit_ar(x: Float1D, starts: Bool1D, highest_order: int, counted: Bool1D | None = None) -> tuple[Float1D, float]:
    """AR coefficients and innovation sd of a zero-mean series with interruptions; rows not `counted` are zero.

    Autocovariances are taken within uninterrupted stretches only; a small taper keeps the system positive definite.
    """
    counted = np.ones(len(x), bool) if counted is None else counted
    n = int(counted.sum())
    highest_order = int(min(highest_order, max(0, n // 50)))
    since = _since_start(starts)
    gamma = np.array(
        [
            np.sum(x[lag:] * x[: len(x) - lag] * (since[lag:] >= lag)) / max(1, np.sum((since >= lag) & counted))
            for lag in range(highest_order + 1)
        ]
    )
    if gamma[0] <= 0:
        return np.zeros(0), 1.0
    gamma *= 1 - np.arange(highest_order + 1) / (50.0 * (highest_order + 1))
    return _least_bic(gamma, n, highest_order)


def _least_bic(gamma: Float1D, n: int, highest_order: int) -> tuple[Float1D, float]:
    """AR coefficients and innovation sd of the order that BIC prefers, from autocovariances."""
    best = (n * np.log(gamma[0]), np.zeros(0), gamma[0])
    for p in range(1, min(highest_order, len(gamma) - 1) + 1):
        phi = np.asarray(solve_toeplitz(gamma[:p], gamma[1 : p + 1]), float)
        variance = gamma[0] - phi @ gamma[1 : p + 1]
        if variance <= 1e-9 * gamma[0]:
            break
        score = n * np.log(variance) + p * np.log(n)
        if score < best[0] - 1e-9:
            best = (score, phi, variance)
    return best[1], float(np.sqrt(best[2]))


def robust_sd(x: Float1D) -> float:
    """Standard deviation that a tenth of spikes does not move much; never zero."""
    if len(x) == 0:
        return 1.0
    sd = MAD_TO_SD * float(np.median(np.abs(x - np.median(x))))
    spread = float(np.std(np.clip(x, -8 * sd, 8 * sd))) if sd > 0 else float(np.std(x))
    # A coarse quantisation has a median deviation of zero or of one step: the larger of the two figures is safe.
    return max(sd, 0.7 * spread, 1e-9)


def _since_start(starts: Bool1D) -> Int1D:
    index = np.arange(len(starts))
    return index - np.maximum.accumulate(np.where(starts, index, 0))


def _has_past(starts: Bool1D, order: int) -> Bool1D:
    first = starts.copy()
    if len(first):
        first[0] = True
    return _since_start(first) >= order
