"""Whether a simulated current is that of these recordings at all, before anybody asks what it left out.

In:  recordings with a recorded and a simulated current of an axis.
Out: in words, whose simulation it is where it is not this axis' and part's: of another part or axis, with its rows at
another rate, with the other sign; or that it follows nothing which was recorded. None where it can be theirs.
A simulation may be poor, and share little with the recording; it is refused only where it clearly is something else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import signal
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import KFold, cross_val_predict

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.columns import ACCELERATION, CURRENT, CURRENT_SIM, FORCE_SIM, VELOCITY
from pido.core.recording import Recording

_LIKE = 0.5  # correlation, at any shift in time, from which the two belong together, however much is missing
_CLEARLY = 0.8  # correlation with the recording, from which it is the other one's
_LESS_LEFT = 0.5  # of the variance, that the other one leaves at most beside this one
_RATES = (0.1, 0.2, 0.25, 1 / 3, 0.4, 0.5, 2 / 3, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)  # of the rows that are simulated
_EXPLAINED, _FOLLOWS_NOTHING = 0.5, 0.1  # of the variance, by what was recorded, of the recording and the simulation
_LEAST = 1e-3  # of the recorded current's spread: a simulation that hardly varies says nothing of itself
_FOLDS = 5


def of_another(parts: Sequence[Recording], axis: str) -> str | None:
    """Why the simulated current of `axis` cannot be that of some of these parts; None where it can in all."""
    reasons = {r.part.part: reason for r in parts if (reason := _not_its_own(parts, r, axis)) is not None}
    if not reasons:
        return None
    part, reason = next(iter(reasons.items()))
    more = f" As wrong in {', '.join(list(reasons)[1:])}." if len(reasons) > 1 else ""
    return f"in part {part}, {reason}{more}"


def _not_its_own(parts: Sequence[Recording], recording: Recording, axis: str) -> str | None:
    name = CURRENT_SIM[axis]
    seen, sim = _signal(recording, CURRENT[axis]), _signal(recording, name)
    at_once = float(seen @ sim) >= _LIKE * np.linalg.norm(seen) * np.linalg.norm(sim)  # as nearly always
    if np.std(sim) < _LEAST * np.std(seen) or at_once or (own := _alike(seen, sim)) >= _LIKE:
        return None
    others = [(_alike(seen, x), what, mend) for x, what, mend in _others(parts, recording, axis)]
    found, what, mend = max(others, key=lambda each: each[0])
    if found >= _CLEARLY and 1 - found**2 < _LESS_LEFT * (1 - own**2):
        return f"'{name}' {what} (correlation {found:.2f}; as it stands {own:.2f}). {mend}"
    if _follows_nothing(recording, axis):
        return (
            f"'{name}' does not follow the recorded current (correlation {own:.2f} at most, however it is shifted in "
            "time), nor any speed, acceleration or load of this part, which the recorded current does follow. Check "
            "that the simulation is of this part, and at its rate."
        )
    return None


def _others(parts: Sequence[Recording], recording: Recording, axis: str) -> Iterator[tuple[Float1D, str, str]]:
    """What the simulated current may be in truth: (signal, in words, what to do)."""
    sim = _signal(recording, CURRENT_SIM[axis])
    yield -sim, "has the opposite sign", "Turn its sign round."
    step = float(np.median(np.diff(recording.time)))
    rows = np.arange(len(sim), dtype=float)
    for rate in _RATES:
        stretched = np.interp(rows[rows * rate <= rows[-1]] * rate, rows, sim)
        what = f"fits when its rows are {step / rate * 1e3:.4g} ms apart, not {step * 1e3:.4g} ms as the recording's"
        yield stretched, what, "It was simulated at another rate: bring both to one time."
    for other in (a for a in AXES if a != axis and CURRENT_SIM[a] in recording):
        if CURRENT[other] in recording and _own(recording, other) >= _LIKE:
            continue  # two axes that move together
        what = f"is another axis': the recording follows '{CURRENT_SIM[other]}'"
        yield _signal(recording, CURRENT_SIM[other]), what, "Check the order of the columns."
    for other in (r for r in parts if r is not recording and CURRENT_SIM[axis] in r):
        what = f"is another part's: the recording follows that of part {other.part.part}"
        yield _signal(other, CURRENT_SIM[axis]), what, "Give each recording its own simulation."


def _own(recording: Recording, axis: str) -> float:
    return _alike(_signal(recording, CURRENT[axis]), _signal(recording, CURRENT_SIM[axis]))


def _signal(recording: Recording, name: str) -> Float1D:
    """(n,) – about its mean; 0 where it is not known."""
    values = np.asarray(recording[name], float)
    known = np.isfinite(values)
    return np.where(known, values - np.mean(values, where=known), 0.0) if known.any() else np.zeros(len(values))


def _alike(seen: Float1D, sim: Float1D) -> float:
    """The largest correlation at a shift of up to half of the recording, where at least half of the shorter one
    overlaps."""
    n, m = len(seen), len(sim)
    products = signal.correlate(seen, sim, method="fft")
    lags = signal.correlation_lags(n, m)
    first, last = np.maximum(lags, 0), np.minimum(lags + m, n)
    of_seen, of_sim = (np.r_[0.0, np.cumsum(u**2)] for u in (seen, sim))
    energy = (of_seen[last] - of_seen[first]) * (of_sim[last - lags] - of_sim[first - lags])
    near = (np.abs(lags) <= n // 2) & (last - first >= min(n, m) // 2) & (energy > 0)
    return float(np.max(products[near] / np.sqrt(energy[near]), initial=0.0))


def _follows_nothing(recording: Recording, axis: str) -> bool:
    """Whether speeds, accelerations and loads explain the recorded current, and nothing of the simulated one."""
    loads = [n for n in (*FORCE_SIM.values(), "m_sp_sim", "mrr_sim") if n in recording]
    motion = [n for n in (*VELOCITY.values(), *ACCELERATION.values()) if n in recording]
    if VELOCITY[axis] not in motion or not loads:
        return False  # what it follows may not be there
    columns = [_signal(recording, n) for n in (*motion, *loads)]
    columns += [np.sign(recording[n]) for n in VELOCITY.values() if n in motion]
    X = np.nan_to_num(np.stack(columns, axis=1))
    known = np.isfinite(recording[CURRENT[axis]]) & np.isfinite(recording[CURRENT_SIM[axis]])

    def explained(name: str) -> float:
        y = np.asarray(recording[name], float)[known]
        left = y - cross_val_predict(LinearRegression(), X[known], y, cv=KFold(_FOLDS))
        return 1 - float(np.var(left) / max(np.var(y), 1e-300))

    return explained(CURRENT[axis]) > _EXPLAINED and explained(CURRENT_SIM[axis]) < _FOLLOWS_NOTHING
