"""`PiDOSampler`: the method as imbalanced-learn's `fit_resample(X, y)`, with continuous currents as y.

In:  X with the 13 inputs (`pido.equations.tables`), y with the currents of one to four axes.
Out: the real rows, untouched and first, then PiA and PiE rows that balance them for the coming part; where each row
     comes from is in `sample_origin_`.
imbalanced-learn itself refuses continuous targets and is not needed; its pipelines take any `fit_resample`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted, check_random_state

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.columns import INPUTS
from pido.core.machining import Machine
from pido.core.samples import ORIGINS, PIA, REAL, Samples
from pido.core.tables import column_like, is_table, like, names_of
from pido.equations.tables import ANY_MILL, axis_of, checked, column_of, named_columns, rows_of, spread, targets
from pido.feature_space.grid import Grid
from pido.sampling.gate import Gate
from pido.sampling.method import PAPER_METHOD, Method, adapt, balance_for
from pido.sampling.optimise import Report
from pido.sampling.shares import SHARES, ShareRule


class PiDOSampler(BaseEstimator):
    """Adds physically generated rows where the coming part needs them and the data are thin.

    machine : whose limits bound every generated row; None: round figures of a middle-sized mill
    path : X of the coming part (its currents are not needed); None: the bins that X itself visits
    method : 'adaptive' chooses the equation per axis from held-out rows and gates what it says; 'paper' is as printed
    density, pia, pie : target density in samples per bin, and names of the share rules of eq. 15 and 16
    leverage_quantile : largest leverage of a generated row, as a quantile of the real rows'; None: no gate
    incomplete : a row of which one axis' current was refused by the gate is left out ('drop'), or has NaN there
        ('nan'); an axis of y that was not recorded at all is NaN in every row, and leaves none out
    random_state : int, numpy RandomState or None

    After `fit_resample`, one entry per row: `sample_origin_` (arrays: `origin` 'real', 'pia' or 'pie'; `row` in X,
    -1 for PiE; bin centre `v_x`, `v_y`, `ar`, NaN for real rows; `expected_error`, A) and `sample_weight_` (how
    much a row should count); `sample_indices_` (the rows of X behind real and PiA rows) and `report_` (bin by bin, of
    the rows that are returned).
    """

    def __init__(
        self,
        machine: Machine | None = None,
        path: Any = None,
        *,
        method: Literal["adaptive", "paper"] = "adaptive",
        density: float = 40.0,
        pia: str = "paper-pia",
        pie: str = "paper-pie",
        leverage_quantile: float | None = 0.95,
        incomplete: Literal["drop", "nan"] = "drop",
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.machine = machine
        self.path = path
        self.method = method
        self.density = density
        self.pia = pia
        self.pie = pie
        self.leverage_quantile = leverage_quantile
        self.incomplete = incomplete
        self.random_state = random_state

    def fit(self, X: Any, y: Any) -> PiDOSampler:
        """Check X and y and remember their columns; `fit_resample` does the work."""
        self._rows(X, y)
        return self

    def fit_resample(self, X: Any, y: Any, *, part: Any = None) -> tuple[Any, Any]:
        """(X, y) with generated rows after the real ones, in the kind of table or array that came in, under its names.

        X : (n, k); y : (n,) or (n, m), A, m <= 4, NaN where a current was not recorded; a column of a table is of the
        axis that its name says (`curr_sp`)
        part : (n,) names of the parts that the rows come from; held-out choices then leave whole parts out
        Raises ValueError for columns and options that are not understood and for values that are missing; FitError for
        settings.
        """
        values, names, real, axes, flat = self._rows(X, y)
        if part is not None:
            parts = np.asarray(part, dtype=object)
            if parts.shape != (len(real),):
                raise ValueError(
                    f"part has the shape {parts.shape}; it names the part of each of {len(real)} rows of X."
                )
            real = replace(real, part=parts)
        recorded = np.isfinite(real.currents[:, axes]).any(axis=0)
        if not recorded.any():
            raise ValueError("Input y contains NaN only: rows are generated with currents, and none was recorded.")
        machine, method = self.machine or ANY_MILL, self._method()
        path = real if self.path is None else self._path()
        seed = check_random_state(self.random_state).randint(np.iinfo(np.int32).max)
        rng = np.random.default_rng(seed)
        balanced = balance_for(path, real, machine, method, adapt(real, machine, method), rng=rng)
        generated, weights = balanced.generated, balanced.weights
        known = np.isfinite(generated.currents[:, axes][:, recorded])
        keep = np.flatnonzero(known.all(axis=1) if self.incomplete == "drop" else known.any(axis=1))
        generated, weights = generated.take(keep), weights[keep][:, axes]
        self._describe(real, generated, weights, balanced.report.counting(generated), method.grid)
        more_X = np.column_stack([column_of(generated, name) for name in (names or INPUTS[: values.shape[1]])])
        more_y = generated.currents[:, axes]
        own = names_of(X) if names is not None else None
        return _joined(X, values, more_X, own, False), _joined(y, real.currents[:, axes], more_y, self._targets, flat)

    def _rows(self, X: Any, y: Any) -> tuple[Float2D, tuple[str, ...] | None, Samples, tuple[int, ...], bool]:
        values, names = checked(self, X, reset=True)
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None: rows are generated with currents.")
        currents, self._targets, flat = targets(y)
        if len(currents) != len(values):
            raise ValueError(f"X has {len(values)} samples, y has inconsistent numbers of samples: {len(currents)}.")
        if np.isinf(currents).any():
            raise ValueError("Input y contains infinity or a value too large for dtype('float64').")
        axes = axis_of(self._targets, currents.shape[1])
        return values, names, rows_of(values, names, spread(currents, axes)), axes, flat

    def _path(self) -> Samples:
        values, names = named_columns(self.path)
        values = np.asarray(values, float)
        return rows_of(values, names, np.full((len(values), 4), np.nan))

    def _method(self) -> Method:
        if self.incomplete not in ("drop", "nan"):
            raise ValueError(f"incomplete '{self.incomplete}': it is 'drop' or 'nan'.")
        for name in (self.pia, self.pie):
            if name not in SHARES:
                raise ValueError(f"no share rule '{name}'; there are {', '.join(SHARES)}.")
        share = ShareRule(self.density, SHARES[self.pia], SHARES[self.pie])
        if self.method == "paper":
            return Method(
                share=share, gate=PAPER_METHOD.gate, nuisance="paper", adaptive=False, weigh_by_certainty=False
            )
        if self.method != "adaptive":
            raise ValueError(f"method '{self.method}': it is 'adaptive' or 'paper'.")
        nuisance: Literal["joint", "planned"] = "joint" if self.path is None else "planned"
        return Method(share=share, gate=Gate(self.leverage_quantile, compare=False), nuisance=nuisance)

    def _describe(self, real: Samples, generated: Samples, weights: Float2D, report: Report, grid: Grid) -> None:
        rows: Int1D = np.r_[np.arange(len(real)), np.where(generated.origin == PIA, generated.row, -1)]
        centres = np.vstack([np.full((len(real), 3), np.nan), grid.centres(generated.voxel)])
        origin = np.r_[np.full(len(real), REAL), generated.origin]
        error: Float1D = np.r_[np.zeros(len(real)), np.nan_to_num(generated.expected_error).max(axis=1, initial=0.0)]
        self.sample_origin_ = {
            "origin": np.asarray(ORIGINS, dtype=object)[origin],
            "row": rows,
            "v_x": centres[:, 0],
            "v_y": centres[:, 1],
            "ar": centres[:, 2],
            "expected_error": error,
        }
        self.sample_indices_ = rows[rows >= 0]
        self.sample_weight_: Float1D = np.r_[np.ones(len(real)), weights.mean(axis=1)]
        self.report_ = report

    def get_feature_names_out(self, input_features: Any = None) -> np.ndarray:
        """Names of the columns that come out: those that went in."""
        check_is_fitted(self, "n_features_in_")
        return np.asarray(_check_feature_names_in(self, input_features), dtype=object)


def _joined(template: Any, own: Float2D, more: Float2D, names: tuple[str, ...] | None, flat: bool) -> Any:
    """Real rows as they came, generated ones below, in the kind of `template`."""
    values = np.vstack([own, more])
    if names is not None and is_table(template):
        return like(template, {name: values[:, k] for k, name in enumerate(names)})
    if flat and not isinstance(template, np.ndarray | list):
        return column_like(template, values[:, 0])
    dtype = getattr(template, "dtype", None)
    values = values[:, 0] if flat else values
    if isinstance(template, list):
        return values.tolist()
    return values.astype(dtype) if dtype is not None and np.dtype(dtype).kind == "f" else values
