"""Rows as the world hands them over, a table or an array, become `Samples`.

In:  X: a table (pandas, polars, Arrow, mapping) with the 13 inputs by name, or an array with them in their order.
Out: `Samples`. Further columns that are understood: `ar` (mm², else MRR over speed) and `direction_<axis>` (sign of the
     last motion; else that of the velocity, which knows nothing at standstill).

An input that is not among the columns is zero throughout: the axis rests, nothing is cut. Its terms are dropped by the
fit, which says so. A name that is not understood is refused, since it may be a misspelt one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator
from sklearn.utils.validation import validate_data

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ALIASES, CURRENT, INPUTS
from pido.core.machining import AxisLimits, Machine
from pido.core.samples import Samples
from pido.core.tables import columns_of, is_table, names_of

ANY_MILL = Machine(
    "any mill",
    {axis: AxisLimits(500.0, 5000.0, 50_000.0, (-1000.0, 1000.0)) for axis in LINEAR_AXES},
    spindle_max_deg_s=72_000.0,
    spindle_acc_deg_s2=36_000.0,
)
"""Round figures of a middle-sized three-axis mill, where nobody says which machine it is."""

DIRECTION = {axis: f"direction_{axis}" for axis in AXES}
KNOWN = (*INPUTS, "ar", *DIRECTION.values())


def named_columns(X: Any) -> tuple[Any, tuple[str, ...] | None]:
    """(n, k) numbers and what is in them, as `KNOWN` has it; None for an array. Raises ValueError for a name that is
    not understood, and for two names of one thing."""
    if not is_table(X):
        return X, None
    columns, names = columns_of(X), tuple(_understood(name) for name in names_of(X))
    strange = [name for name in names if name not in KNOWN]
    if strange:
        raise ValueError(f"column(s) {', '.join(strange)} are no input of an equation; known are {', '.join(KNOWN)}.")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"column(s) {', '.join(twice)} stand in X under two names: keep one of each.")
    return np.column_stack(list(columns.values())) if columns else np.zeros((0, 0)), names


def _understood(name: str) -> str:
    name = ALIASES.get(name, name)
    return f"direction_{name[4:]}" if name.startswith("dir_") else name


def checked(estimator: BaseEstimator, X: Any, *, reset: bool) -> tuple[Float2D, tuple[str, ...] | None]:
    """Finite numbers of X and what is in them; scikit-learn remembers its columns (`reset`) or compares them, under the
    names that they have in X."""
    values, names = named_columns(X)
    if names is not None:
        values = pd.DataFrame(values, columns=pd.Index(names_of(X)))
    found: Any = validate_data(estimator, values, reset=reset, dtype=np.float64)  # type: ignore[arg-type]
    return found, names


def rows_of(values: Float2D, names: tuple[str, ...] | None, currents: Float2D) -> Samples:
    """Samples of (n, k) checked numbers; `names` None: the first k of the 13 inputs. currents : (n, 4)."""
    if names is None:
        if values.shape[1] > len(INPUTS):
            raise ValueError(
                f"X has {values.shape[1]} columns without names, and there are {len(INPUTS)} inputs: name them."
            )
        names = INPUTS[: values.shape[1]]
    at = {name: k for k, name in enumerate(names)}
    n = len(values)
    inputs = np.column_stack([values[:, at[name]] if name in at else np.zeros(n) for name in INPUTS])
    speed = np.linalg.norm(inputs[:, :3], axis=1)
    removal = np.divide(inputs[:, -1], speed, out=np.zeros(n), where=speed > 0)
    velocity = inputs[:, [0, 1, 2, INPUTS.index("v_sp")]]
    direction = np.column_stack(
        [values[:, at[c]] if (c := DIRECTION[a]) in at else np.sign(velocity[:, i]) for i, a in enumerate(AXES)]
    )
    ar = values[:, at["ar"]] if "ar" in at else removal
    return Samples.real(inputs, ar, currents, direction, "", np.arange(n))


def targets(y: Any) -> tuple[Float2D, tuple[str, ...] | None, bool]:
    """(n, k) currents, their names where they have any, and whether y was one column without a second dimension.

    y : a table, an array, or one column of a table (pandas, polars, Arrow), which may know its name
    """
    if is_table(y):
        columns = columns_of(y)
        return np.column_stack(list(columns.values())), tuple(columns), False
    values = np.asarray(y, float)
    name = getattr(y, "name", None)
    names = (ALIASES.get(name, name),) if values.ndim == 1 and isinstance(name, str) else None
    return (values[:, None] if values.ndim == 1 else values), names, values.ndim == 1


def axis_of(names: tuple[str, ...] | None, count: int) -> tuple[int, ...]:
    """Which axis each column of y is: by name (`curr_x`), else in the order x, y, z, sp. ValueError where neither."""
    if names is not None and set(names) <= set(CURRENT.values()):
        return tuple(list(CURRENT.values()).index(name) for name in names)
    if count > len(AXES):
        raise ValueError(f"y has {count} columns, and there are {len(AXES)} axes.")
    return tuple(range(count))


def spread(values: Float2D, axes: tuple[int, ...]) -> Float2D:
    """(n, 4): the columns at their axes, NaN on the others."""
    out = np.full((len(values), len(AXES)), np.nan)
    out[:, axes] = values
    return out


def column_of(samples: Samples, name: str) -> Float1D:
    """The values of one known column."""
    if name == "ar":
        return samples.ar
    if name in INPUTS:
        return samples.inputs[:, INPUTS.index(name)]
    return samples.direction[:, list(DIRECTION.values()).index(name)]
