"""The mismatch finder as a scikit-learn regressor: fit on parts, predict the corrected current of others.

In:  X, a table of recordings in time order by the contract's column names (`part` says which rows belong together),
     y, the recorded currents. Out: simulation plus all findings; the findings themselves are in `diagnosis_`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from pido.core.arrays import Array1D, Float1D, Float2D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, TIME
from pido.core.machining import Machine
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.core.tables import columns_of, is_table
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.finding import Diagnosis

PART = "part"


class MismatchCorrection(RegressorMixin, BaseEstimator):
    """Names what a simulation left out, and adds it.

    machine : its dead bands and vertical axis, where the parts themselves do not say them
    about : what the plant knows of each part (`PartInfo` by name): order, clock, tools, workpiece
    seed : of the bootstrap
    """

    def __init__(
        self, machine: Machine | None = None, about: Mapping[str, PartInfo] | None = None, seed: int = 0
    ) -> None:
        self.machine = machine
        self.about = about
        self.seed = seed

    def fit(self, X: Any, y: Any) -> MismatchCorrection:
        """X : table with `time`, motion, and where there is a simulation `curr_<axis>_sim`; the rows of one part follow
        each other in time. `part` names each row's part; without it all rows are one.
        y : table with columns `curr_<axis>`; or (n,), (n, m) currents of the first m axes, A, NaN where not recorded.

        Raises ValueError for a table without names, DiagnosisError where nothing can be compared.
        """
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None: a diagnosis compares with currents.")
        columns = _columns(X)
        n = len(columns[TIME])
        self._flat = not is_table(y) and np.ndim(y) == 1
        given = _currents(y)
        if any(len(values) != n for values in given.values()):
            raise ValueError(f"X has {n} samples, y has inconsistent numbers of samples.")
        self.axes_ = tuple(axis for axis in AXES if CURRENT[axis] in given)
        self.feature_names_in_ = np.array([name for name in columns if name != PART], dtype=object)
        self.n_features_in_ = len(self.feature_names_in_)
        recordings = [recording for _, recording in self._parts({**columns, **given})]
        self.diagnosis_: Diagnosis = diagnose(recordings, machine=self.machine, seed=self.seed)
        return self

    def predict(self, X: Any) -> Float1D | Float2D:
        """Corrected currents, A, in the columns of y; no recorded current is read. NaN on an axis that could not be
        compared."""
        check_is_fitted(self, "diagnosis_")
        columns = _columns(X)
        out = np.full((len(columns[TIME]), len(self.axes_)), np.nan)
        for rows, recording in self._parts({k: v for k, v in columns.items() if k not in CURRENT.values()}):
            corrected = correct(self.diagnosis_.model, recording).corrected
            for i, axis in enumerate(self.axes_):
                if axis in corrected:
                    out[rows, i] = corrected[axis]
        return out[:, 0] if self._flat else out

    def _parts(self, columns: Mapping[str, Array1D]) -> list[tuple[Array1D, Recording]]:
        """Rows and recording of each part, in the order in which they first occur."""
        names = columns.get(PART, np.full(len(columns[TIME]), "all", dtype=object)).astype(str)
        found, first = np.unique(names, return_index=True)
        result = []
        for name in found[np.argsort(first)]:
            rows = np.flatnonzero(names == name)
            own = {k: np.asarray(v)[rows] for k, v in columns.items() if k != PART}
            # one recording begins at zero, wherever it stands in a longer table
            own[TIME] = own[TIME] - own[TIME][0]
            info = (self.about or {}).get(str(name)) or PartInfo(part=str(name), machine="unknown")
            result.append((rows, Recording(info, own)))
        return result


def _columns(X: Any) -> dict[str, Array1D]:
    if not is_table(X):
        raise ValueError("a diagnosis needs a table with column names (time, v_x, curr_x_sim, ...), not an array.")
    columns = columns_of(X)
    if TIME not in columns:
        raise ValueError(f"column 'time' (s) is missing; the table has {', '.join(columns)}.")
    return columns


def _currents(y: Any) -> dict[str, Array1D]:
    if is_table(y):
        columns = columns_of(y)
        strange = [name for name in columns if name not in CURRENT.values()]
        if strange:
            raise ValueError(f"y has column(s) {', '.join(strange)}; it holds currents: {', '.join(CURRENT.values())}.")
        return columns
    values = np.asarray(y, float)
    values = values[:, None] if values.ndim == 1 else values
    if values.shape[1] > len(AXES):
        raise ValueError(f"y has {values.shape[1]} columns, and there are {len(AXES)} axes.")
    return {CURRENT[axis]: values[:, i] for i, axis in enumerate(AXES[: values.shape[1]])}
