"""Physical equations as scikit-learn regressors: for pipelines, searches and cross-validation.

In:  X with the 13 inputs (`pido.equations.tables`), y with one current or several; a current may be NaN where it was
     not recorded. Out: regressors whose fitted equations are `equations_` (one for every four columns of y).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Literal, overload

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from pido.core.arrays import Float1D, Float2D
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.choose import CELLS
from pido.equations.fit import GlobalEquation, LocalEquations, fit_global, fit_local, fit_local_from
from pido.equations.moments import Moments
from pido.equations.tables import ANY_MILL, axis_of, checked, rows_of, spread, targets
from pido.equations.terms import TermSet, term_set
from pido.equations.weights import Kernel
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import Grid

Equation = GlobalEquation | LocalEquations


class _EquationRegressor(RegressorMixin, BaseEstimator, ABC):
    """What both have in common: X and y to samples, four columns of y at a time."""

    machine: Machine | None
    terms: str | TermSet
    equations_: list[Any]

    def fit(self, X: Any, y: Any) -> Any:
        """X : (n, k) table or array; y : (n,) or (n, m), A, NaN where a current was not recorded.

        Raises ValueError for missing inputs, which are never filled in, and for names that are not understood.
        """
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None: an equation is fitted on currents.")
        values, self._names = checked(self, X, reset=True)
        currents, self._targets, self._flat = targets(y)
        if not np.isfinite(currents[~np.isnan(currents)]).all():
            raise ValueError("Input y contains infinity or a value too large for dtype('float64').")
        if len(currents) != len(values):
            raise ValueError(f"X has {len(values)} samples, y has inconsistent numbers of samples: {len(currents)}.")
        if np.isnan(currents).all(axis=0).any():
            raise ValueError("Input y contains NaN only in at least one column: leave that axis out.")
        by_name = self._targets is not None and currents.shape[1] <= 4
        groups = [axis_of(self._targets, currents.shape[1])] if by_name else _fours(currents.shape[1])
        self.equations_, self._where = [], []
        done = 0
        for axes in groups:
            block = currents[:, done : done + len(axes)]
            rows = rows_of(values, self._names, spread(block, axes))
            self.equations_.append(self._equation(rows))
            self._where.append(axes)
            done += len(axes)
        return self

    def _predict(self, X: Any, which: int) -> Float2D:
        check_is_fitted(self, "equations_")
        values, names = checked(self, X, reset=False)
        out = []
        for equation, axes in zip(self.equations_, self._where, strict=True):
            rows = rows_of(values, names, np.full((len(values), 4), np.nan))
            found = equation.predict_with_support(rows)[which] if which else equation.predict(rows)
            out.append(found[:, axes])
        joined = np.column_stack(out)
        return joined[:, 0] if self._flat else joined

    def predict(self, X: Any) -> Float1D | Float2D:
        """Currents, A: (n,) where y was (n,), else (n, m)."""
        return self._predict(X, 0)

    @property
    def term_names_(self) -> tuple[str, ...]:
        """Terms in the order of `coefficients_`."""
        check_is_fitted(self, "equations_")
        return self.equations_[0].terms.names

    @property
    def dropped_(self) -> tuple[str, ...]:
        """Terms that the rows cannot tell from the constant, or that are zero throughout."""
        check_is_fitted(self, "equations_")
        return _overall(self.equations_[0]).dropped

    @property
    def coefficients_(self) -> Float2D:
        """(m, terms), A per unit of each term: of the equation for all samples."""
        check_is_fitted(self, "equations_")
        blocks = [
            _overall(e).coefficients[list(axes)] / e.terms.scale(e.machine)
            for e, axes in zip(self.equations_, self._where, strict=True)
        ]
        return np.vstack(blocks)

    @abstractmethod
    def _equation(self, rows: Samples) -> Equation:
        """The equation that is fitted on `rows`."""

    def _terms(self) -> TermSet:
        return term_set(self.terms) if isinstance(self.terms, str) else self.terms

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        tags.target_tags.single_output = True
        # columns are scaled by what a machine can reach: numbers of size one are noise to it
        if tags.regressor_tags is not None:
            tags.regressor_tags.poor_score = True
        return tags


class PhysicalEquation(_EquationRegressor):
    """One physical equation for all samples (paper, eq. 5 and 17), by least squares.

    machine : whose ranges scale the terms; None: round figures of a middle-sized mill
    terms : 'paper', 'paper-held', 'held', 'held-small', 'friction', 'constant', or a `TermSet`

    >>> X = {"v_x": np.r_[-30.0:30.0:200j], "a_x": np.zeros(200)}
    >>> model = PhysicalEquation(terms="held").fit(X, 0.8 * np.sign(X["v_x"]) + 0.02 * X["v_x"])
    >>> dict(zip(model.term_names_, model.coefficients_[0].round(3).tolist()))["held(v_x)"]
    0.8
    """

    def __init__(self, machine: Machine | None = None, terms: str | TermSet = "held") -> None:
        self.machine = machine
        self.terms = terms

    def _equation(self, rows: Samples) -> GlobalEquation:
        return fit_global(rows, self.machine or ANY_MILL, self._terms())


class LocalPhysicalEquations(_EquationRegressor):
    """One physical equation per bin of (v_x, v_y, AR) (paper, eq. 9 to 13), drawn to the one for all where support
    runs out; in bins that hold no sample it is that one.

    alpha, beta, sigma : kernel of eq. 10; bin_width : mm/s, mm/s, mm²
    blend : False for the equations as printed
    exact_up_to : samples times bins up to which distances are exact; beyond, per-bin statistics are used
    """

    def __init__(
        self,
        machine: Machine | None = None,
        terms: str | TermSet = "held",
        *,
        alpha: float = 0.1,
        beta: float = 0.02,
        sigma: float = 4.8,
        bin_width: tuple[float, float, float] = (1.0, 1.0, 10.0),
        blend: bool = True,
        exact_up_to: float = 3e8,
    ) -> None:
        self.machine = machine
        self.terms = terms
        self.alpha = alpha
        self.beta = beta
        self.sigma = sigma
        self.bin_width = bin_width
        self.blend = blend
        self.exact_up_to = exact_up_to

    @overload
    def predict(self, X: Any) -> Float1D | Float2D: ...
    @overload
    def predict(self, X: Any, return_std: Literal[True]) -> tuple[Float1D | Float2D, Float1D | Float2D]: ...
    def predict(self, X: Any, return_std: bool = False) -> Any:
        """Currents, A, and with `return_std` their standard errors, A: NaN where there were no more rows than terms
        that they determine, which leaves nothing to tell the noise by."""
        if not return_std:
            return self._predict(X, 0)
        error = self._predict(X, 1)
        both = zip(map(_overall, self.equations_), self._where, strict=True)
        told = np.concatenate([e.effective[list(axes)] > e.rank[list(axes)] for e, axes in both])
        return self._predict(X, 0), np.where(told[0] if self._flat else told, error, np.nan)

    def _equation(self, rows: Samples) -> LocalEquations:
        machine, terms, grid = self.machine or ANY_MILL, self._terms(), Grid(self.bin_width)
        bins = relevant_bins(rows.reduced, grid)
        kernels = [Kernel(self.alpha, self.beta, self.sigma)] * 4
        if len(rows) * len(bins) <= self.exact_up_to:
            return fit_local(rows, bins, machine, terms=terms, kernels=kernels, grid=grid, blend=self.blend)
        moments = Moments(terms, machine, CELLS)
        moments.add(rows)
        return fit_local_from(moments, bins, kernels=kernels, grid=grid, blend=self.blend)


def _overall(equation: Equation) -> GlobalEquation:
    return equation.overall if isinstance(equation, LocalEquations) else equation


def _fours(count: int) -> list[tuple[int, ...]]:
    """Columns of y four at a time, as many as there are axes to fit at once."""
    return [tuple(range(min(4, count - k))) for k in range(0, count, 4)]
