"""What no mechanism of the catalogue explains: how much of it there is, where it acts, and a model without a name.

In:  what is left of one axis' mismatch, and everything that the recording knows about the state.
Out: the share that a flexible model predicts on unseen parts; a formula in the recorded quantities, or a surface
     over one or
     two of them, with the units that make it an ampere.
A flexible model has no say in naming. It only tells when a name would be dressing up.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.core.errors import DiagnosisError
from pido.diagnosis.confirm import p_of_mean
from pido.diagnosis.mechanisms.base import Mechanism, Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import Noise

_TREES: dict[str, Any] = dict(
    max_iter=30,
    learning_rate=0.25,
    max_leaf_nodes=10,
    min_samples_leaf=30,
    l2_regularization=5.0,
    early_stopping=False,
)
LOOKED_AT = 3_000  # formulas, peaks and surfaces that are compared before one is claimed
_MOST_ROWS = 8_000
_FEWEST_ROWS = 200
_LONG_S = 10.0  # after which it no longer matters how long ago a block or a cut began
_SIGNED = ("v", "a", "force", "force_perp")  # quantities with a side: a surface may jump where they change sign


@dataclass(frozen=True, slots=True)
class Structure:
    """What a flexible model predicts of a residual on folds that it has not seen.

    explained : A² – mean square that it takes away (may be negative)
    share : of the residual's mean square
    p_value : one-sided, blocks as observations
    """

    explained: float
    share: float
    p_value: float


def signals(state: AxisState, names: Collection[str] | None = None) -> dict[str, tuple[Float1D, str]]:
    """Name -> (values (n,), unit) of everything known about the state that a current could depend on, or of `names`.

    Raises DiagnosisError where one of `names` is not known.
    """
    spindle = state.axis == "sp"
    length, speed = ("deg", "deg/s") if spindle else ("mm", "mm/s")
    a = state.axis
    found: dict[str, tuple[Float1D | Callable[[], Float1D | None] | None, str]] = {
        f"v_{a}": (state.v, speed),
        f"a_{a}": (state.a, f"{speed}²"),
        f"pos_{a}": (None if spindle else state.pos, length),
        f"held_{a}": (state.held, "–"),
        f"d_{a}": (state.since_reversal, length),
        f"I_{a}": (state.sim, "A"),
        **{f"I_{axis}": (sim, "A") for axis, sim in state.sims.items()},
        "feed": (lambda: _feed(state), "mm/s"),
        **{f"f_{axis}": (force, "N") for axis, force in state.forces.items()},
        "t_block": (lambda: _since_change(state.time, state.nc_line), "s"),
        "t_cut": (lambda: _since_change(state.time, state.engaged, state.engaged), "s"),
        "M_sp": (state.m_sp, "N·m"),
        "MRR": (state.mrr, "mm³/s"),
        "AR": (state.ar, "mm²"),
        "coolant": (state.coolant, "–"),
        "uptime": (state.clock if state.clock is not None else None, "s"),
    }
    for name, other in state.others.items():
        if name != a:
            found[f"v_{name}"] = (other.v, "deg/s" if name == "sp" else "mm/s")
            found[f"a_{name}"] = (other.a, "deg/s²" if name == "sp" else "mm/s²")
    out = {}
    for name in found if names is None else names:
        values, unit = found.get(name, (None, ""))
        values = values() if callable(values) else values
        if values is not None:
            out[name] = (_finite(np.asarray(values, float)), unit)
        elif names is not None:
            raise DiagnosisError(
                f"part {state.part}: what axis {a} follows without a name depends on {name}, which this part does not "
                "give. Add the columns that the diagnosed parts had."
            )
    return out


def _feed(state: AxisState) -> Float1D | None:
    """Speed along the path, mm/s; None with fewer than two linear axes."""
    speeds = [o.v for name, o in state.others.items() if name in LINEAR_AXES]
    if not speeds:
        return None
    return np.sqrt(sum(v**2 for v in (speeds if state.axis == "sp" else [state.v, *speeds])))


def _since_change(time: Float1D, values: Array1D | None, only: Bool1D | None = None) -> Float1D | None:
    """s since `values` changed, at most ten; 0 outside `only`; None without values."""
    if values is None:
        return None
    change = np.r_[True, values[1:] != values[:-1]]
    since = time - time[np.maximum.accumulate(np.where(change, np.arange(len(time)), 0))]
    return np.minimum(since, _LONG_S) * (1.0 if only is None else only)


def common_signals(states: Sequence[AxisState]) -> dict[str, tuple[Float1D, str]]:
    """The signals that every part has and that vary, parts one after another."""
    each = [signals(s) for s in states]
    names = [n for n in each[0] if all(n in e for e in each)]
    out = {n: (np.concatenate([e[n][0] for e in each]), each[0][n][1]) for n in names}
    return {n: v for n, v in out.items() if np.ptp(v[0]) > 0}


def _finite(values: Float1D) -> Float1D:
    """Unknown as zero, infinite (no reversal yet) as the largest known."""
    known = values[np.isfinite(values)]
    top = float(np.max(np.abs(known), initial=0.0))
    return np.nan_to_num(values, nan=0.0, posinf=top, neginf=-top)


def structure(mismatch: Mismatch, residual: Float1D, noise: Noise, seed: int) -> Structure:
    """How much of `residual` a flexible model of the state predicts on unseen folds."""
    few = coarse(mismatch, residual, noise)
    if len(few.rows) < _FEWEST_ROWS or not common_signals(mismatch.states):
        return Structure(0.0, 0.0, 1.0)
    features = np.column_stack([v[few.rows] for v, _ in common_signals(mismatch.states).values()])
    fold = _three_folds(mismatch, few.rows)
    y, prediction = few.values, np.zeros(len(few.rows))
    top = 8 * float(np.median(np.abs(y)) / 0.6745 + 1e-12)
    for k in np.unique(fold):
        learn = fold != k
        trees = HistGradientBoostingRegressor(random_state=seed, **_TREES)
        trees.fit(features[learn], np.clip(y[learn], -top, top))
        prediction[~learn] = trees.predict(features[~learn])
    gain = y**2 - (y - prediction) ** 2
    block = mismatch.block[few.rows]
    count = np.bincount(block)
    p = p_of_mean(np.bincount(block, gain * few.weights)[count > 0])
    total = float(np.mean(y**2)) or 1.0
    return Structure(float(np.mean(gain)), float(np.mean(gain)) / total, p)


def flexible_rest(
    mismatch: Mismatch,
    residual: Float1D,
    seed: int = 0,
    without: frozenset[str] = frozenset(),
    by_part: bool = False,
) -> Float1D:
    """(n,), A – `residual` without what a flexible model of the state predicts of it on blocks that it has not seen.

    without : signals that the model is not told
    by_part : parts that it has not seen, in place of blocks: places and loads tell the time, within one part

    What is left is the nearest thing to noise that can be had before anything has a name. The prediction is made on
    few rows and drawn between them; it is scaled back where it does not hold.
    """
    known = {name: v for name, v in common_signals(mismatch.states).items() if name not in without}
    width = max(1, int(np.ceil(mismatch.n / _MOST_ROWS)))
    rows = np.arange(width // 2, mismatch.n, width)
    rows = rows[mismatch.usable[rows]]
    if len(rows) < _FEWEST_ROWS or not known:
        return residual
    features = np.column_stack([v[rows] for v, _ in known.values()])
    padded = np.where(mismatch.usable, residual, 0.0)
    y = (
        np.convolve(padded, np.ones(width), "same")
        / np.maximum(np.convolve(mismatch.usable, np.ones(width), "same"), 1)
    )[rows]
    top = 8 * float(np.median(np.abs(y)) / 0.6745 + 1e-12)
    fold = mismatch.fold[rows] if by_part else mismatch.block[rows] % 3
    prediction = np.zeros(len(rows))
    for k in np.unique(fold):
        trees = HistGradientBoostingRegressor(random_state=seed, **_TREES)
        trees.fit(features[fold != k], np.clip(y[fold != k], -top, top))
        prediction[fold == k] = trees.predict(features[fold == k])
    power = float(prediction @ prediction)
    holds = float(np.clip(prediction @ y / power, 0.0, 1.0)) if power > 0 else 0.0
    return residual - holds * np.interp(np.arange(mismatch.n), rows, prediction)


@dataclass(frozen=True, slots=True)
class Coarse:
    """A residual averaged over the memory of its noise: few rows that hold nearly all that the many do.

    rows : (m,) – row in the middle of each average; values : (m,), A; weights : (m,), 1/A²
    """

    rows: Int1D
    values: Float1D
    weights: Float1D


def coarse(mismatch: Mismatch, residual: Float1D, noise: Noise, most: int = _MOST_ROWS) -> Coarse:
    """Averages over half the memory of the noise, or longer where there would be more than `most`."""
    memory = min(noise.memory / 2, mismatch.n / 1000)
    width = max(1, round(memory), int(np.ceil(mismatch.n / most)))
    n = mismatch.n // width * width
    usable = mismatch.usable[:n].reshape(-1, width)
    count = usable.sum(axis=1)
    sums = (residual[:n].reshape(-1, width) * usable).sum(axis=1)
    rows = np.arange(width // 2, n, width)
    same = mismatch.part[np.arange(0, n, width)] == mismatch.part[np.arange(width - 1, n, width)]
    keep = (count > width / 2) & same
    level = noise.level[rows]
    return Coarse(rows[keep], sums[keep] / count[keep], level[keep] ** -2.0)


class Unnamed(Mechanism):
    """A model of what no mechanism of the catalogue explains."""

    id: ClassVar[str] = "unknown"
    kind: ClassVar[Any] = "unexplained"
    looked_at: ClassVar[int] = LOOKED_AT

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away, `by` (2,) in natural units of each member; as it is where there is none."""
        return dict(shape)


@dataclass(frozen=True)
class Formula(Unnamed):
    """A product of recorded quantities, mostly one or two: dI = k * p(u) * q(w), k in A per their units; of none: k."""

    factors: tuple[tuple[str, str], ...]  # (signal, form)
    unit: str
    seen: tuple[tuple[float, float], ...] = ()  # per factor, range of the signal: a form without a reason ends there

    id: ClassVar[str] = "unknown"
    kind: ClassVar[Any] = "unexplained"
    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def looked_at(self) -> int:  # type: ignore[override]
        return LOOKED_AT if self.factors else 1

    @property
    def equation(self) -> str:  # type: ignore[override]
        return " * ".join(["dI = k", *(_written(s, f) for s, f in self.factors)])

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", f"A/({self.unit})" if self.unit != "–" else "A"),)

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        if not self.factors:
            return "a level of its own", ()
        return f"with {' and '.join(dict.fromkeys(s for s, _ in self.factors))}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return np.broadcast_to(self.values(signals(state, [n for n, _ in self.factors])), len(state.time))[:, None]

    def values(self, known: Mapping[str, tuple[Float1D, str]]) -> Float1D:
        """The product itself, (n,)."""
        out = np.ones(1)
        for i, (name, form) in enumerate(self.factors):
            u = known[name][0]
            out = out * FORMS[form](np.clip(u, *self.seen[i]) if self.seen else u)
        return out


LEVEL = Formula((), "–")
"""A constant, which is something only where it is confined."""


@dataclass(frozen=True)
class Peak(Unnamed):
    """A current that is there only around one value of one quantity, as a resonance is."""

    signal: str
    unit: str
    even: bool  # the same on both sides of zero

    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("k", "A"),)

    @property
    def equation(self) -> str:  # type: ignore[override]
        u = f"|{self.signal}|" if self.even else self.signal
        return f"dI = k * exp(-(({u} - c) / w)^2)"

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("c", self.unit, scale="linear"), Parameter("w", self.unit, low=0.0, scale="log"))

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = signals(state, [self.signal])[self.signal][0]
        return np.exp(-((((np.abs(u) if self.even else u) - shape["c"]) / shape["w"]) ** 2))[:, None]

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        c, w = shape["c"], shape["w"]
        return (c - w, c + w) if name == "c" else (w / 2, 2 * w)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in widths of the peak and in powers of e."""
        return {"c": shape["c"] + float(by[0]) * shape["w"], "w": shape["w"] * float(np.exp(np.clip(by[1], -3, 3)))}

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        u = f"|{self.signal}|" if self.even else self.signal
        low, high = shape["c"] - 1.2 * shape["w"], shape["c"] + 1.2 * shape["w"]
        return f"around {u} = {shape['c']:.3g} {self.unit}", (f"{u} > {low:.3g}", f"{u} < {high:.3g}")


@dataclass(frozen=True)
class Surface(Unnamed):
    """A piecewise linear curve or surface over one or two recorded quantities; its knots' heights are in A."""

    variables: tuple[str, ...]
    knots: tuple[tuple[float, ...], ...]
    split: tuple[bool, ...]  # the curve may jump where this quantity changes sign

    shape: ClassVar[tuple[Parameter, ...]] = ()
    held_back: ClassVar[float] = 1e-3

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = g({', '.join(self.variables)}), piecewise linear"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        count = int(np.prod([_width(k, s) for k, s in zip(self.knots, self.split, strict=True)]))
        return tuple(Parameter(f"g_{i}", "A") for i in range(count))

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"depending on {' and '.join(self.variables)}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        known = signals(state, self.variables)
        out = np.ones((len(state.time), 1))
        for name, knots, split in zip(self.variables, self.knots, self.split, strict=True):
            hats = _hats(known[name][0], np.asarray(knots), split)
            out = (out[:, :, None] * hats[:, None, :]).reshape(len(out), -1)
        return out


FORMS: Mapping[str, Any] = {
    "u": lambda u: u,
    "|u|": np.abs,
    "u²": lambda u: u**2,
    "u|u|": lambda u: u * np.abs(u),
    "sgn u": np.sign,
    "√|u|": lambda u: np.sqrt(np.abs(u)),
    "√|u| sgn u": lambda u: np.sqrt(np.abs(u)) * np.sign(u),
    "u³": lambda u: u**3,
}
_POWER = {"u": 1.0, "|u|": 1.0, "u²": 2.0, "u|u|": 2.0, "sgn u": 0.0, "√|u|": 0.5, "√|u| sgn u": 0.5, "u³": 3.0}


def formulas(known: Mapping[str, tuple[Float1D, str]]) -> list[Formula]:
    """Products of one or two forms of the signals; the same signal is not multiplied with itself."""
    plain = []
    for name, (values, unit) in known.items():
        signed = bool(values.min() < 0 < values.max())
        forms = ("sgn u",) if name.startswith("held") else (tuple(FORMS) if signed else ("u", "u²", "√|u|", "u³"))
        if set(np.unique(values[:: max(1, len(values) // 2000)])) <= {0.0, 1.0}:
            forms = ("u",)
        plain += [(name, f, unit) for f in forms if name != "uptime"]
    seen = {n: (float(v.min()), float(v.max())) for n, (v, _) in known.items()}
    out = [Formula(((n, f),), _unit([(u, f)]), (seen[n],)) for n, f, u in plain]
    for (n1, f1, u1), (n2, f2, u2) in itertools.combinations(plain, 2):
        if n1 != n2 and _POWER[f1] + _POWER[f2] <= 3:
            out.append(Formula(((n1, f1), (n2, f2)), _unit([(u1, f1), (u2, f2)]), (seen[n1], seen[n2])))
    return out


def peaks(known: Mapping[str, tuple[Float1D, str]], centres: int = 24) -> list[tuple[Peak, dict[str, float]]]:
    """Peaks around values that the quantities really take, in widths from a fiftieth to a quarter of their range."""
    out = []
    for name, (values, unit) in known.items():
        if name.startswith(("held", "coolant", "uptime", "I_")):
            continue
        for even in (False, True) if values.min() < 0 < values.max() else (False,):
            u = np.abs(values) if even else values
            low, high = np.quantile(u, [0.01, 0.99])
            if high <= low:
                continue
            at = np.unique(np.r_[np.quantile(u, np.linspace(0.02, 0.98, centres)), np.linspace(low, high, centres)])
            at = at[np.r_[True, np.diff(at) > 0.005 * (high - low)]]
            for w in (0.006, 0.02, 0.06, 0.2):
                out += [(Peak(name, unit, even), {"c": float(c), "w": float(w * (high - low))}) for c in at]
    return out


def surfaces(mismatch: Mismatch, count: int = 6) -> list[Surface]:
    """Curves over each signal and surfaces over each pair, knots at quantiles.

    None over a simulated current: it is a law of everything at once, and a curve over it fits what any law lacks.
    """
    known = {n: v for n, (v, _) in common_signals(mismatch.states).items() if n != "uptime" and n[:2] != "I_"}
    ready = {}
    for name, values in known.items():
        split = (name.split("_")[0] in _SIGNED and bool(values.min() < 0 < values.max())) or name.startswith("f_")
        knots = _knots(values[mismatch.usable], count)
        if len(knots) >= 2:
            ready[name] = (knots, split and bool(values.min() < 0 < values.max()))
    singles = [Surface((n,), (k,), (s,)) for n, (k, s) in ready.items()]
    pairs = [
        Surface((n, m), (ready[n][0], ready[m][0]), (ready[n][1], ready[m][1]))
        for n, m in itertools.combinations(ready, 2)
    ]
    return [*singles, *pairs]


def _knots(values: Float1D, count: int) -> tuple[float, ...]:
    low, high = np.quantile(values, [0.002, 0.998])
    inner = np.quantile(values, np.linspace(0.05, 0.95, count - 2))
    return tuple(float(k) for k in np.unique(np.round(np.r_[low, inner, high], 9)))


def _width(knots: Sequence[float], split: bool) -> int:
    return len(_sides(np.asarray(knots), split)[0]) + len(_sides(np.asarray(knots), split)[1])


def _sides(knots: Float1D, split: bool) -> tuple[Float1D, Float1D]:
    if not split:
        return np.zeros(0), knots
    scale = 0.02 * np.abs(knots).max()
    return np.r_[knots[knots < -scale], 0.0], np.r_[0.0, knots[knots > scale]]


def _hats(u: Float1D, knots: Float1D, split: bool) -> Float2D:
    left, right = _sides(knots, split)
    if not len(left):
        return _hat_rows(u, right)
    below = (u < 0)[:, None]
    return np.column_stack([_hat_rows(u, left) * below, _hat_rows(u, right) * ~below])


def _hat_rows(u: Float1D, knots: Float1D) -> Float2D:
    if len(knots) == 1:
        return np.ones((len(u), 1))
    u = np.clip(u, knots[0], knots[-1])
    at = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, len(knots) - 2)
    share = (u - knots[at]) / (knots[at + 1] - knots[at])
    out = np.zeros((len(u), len(knots)))
    rows = np.arange(len(u))
    out[rows, at] = 1 - share
    out[rows, at + 1] = share
    return out


def _three_folds(mismatch: Mismatch, rows: Any) -> Any:
    fold = np.unique(mismatch.fold[rows], return_inverse=True)[1]
    # One fold alone cannot be predicted from others: thirds of the time in its place.
    return fold % 3 if fold.max() > 0 else 3 * np.arange(len(rows)) // len(rows)


def _unit(factors: Sequence[tuple[str, str]]) -> str:
    parts = []
    for unit, form in factors:
        power = _POWER[form]
        if unit == "–" or power == 0:
            continue
        parts.append(f"({unit})" if power == 1 else f"({unit})^{power:g}")
    return "·".join(parts) or "–"


def _written(signal: str, form: str) -> str:
    return (
        form.replace("sgn u", f"sgn({signal})").replace("|u|", f"|{signal}|").replace("u", signal, 1)
        if (form not in ("u|u|", "√|u| sgn u"))
        else (f"{signal}·|{signal}|" if form == "u|u|" else f"√|{signal}|·sgn({signal})")
    )
