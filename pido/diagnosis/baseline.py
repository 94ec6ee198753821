"""The simulation that stands in where no simulated current is given: the paper's equation with its 17 terms.

In:  a recording.
Out: the terms row by row, without scale: the fit that uses them scales for itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.columns import INPUTS
from pido.core.machining import AxisLimits, Machine
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.diagnosis.state import AxisState
from pido.equations.terms import PAPER

_LEAST_MOTION = 0.01  # share of rows an axis must move in, or its speed terms would be fitted to noise
_UNIT = Machine(
    id="",
    axes={a: AxisLimits(v_max=1.0, a_max=1.0, j_max=1.0, travel_mm=(0.0, 1.0)) for a in ("x", "y", "z")},
    spindle_max_deg_s=1.0,
    spindle_acc_deg_s2=1.0,
    force_max_n=1.0,
    torque_max_nm=1.0,
    mrr_max_mm3_s=1.0,
)


def equation_rows(recording: Recording, state: AxisState) -> Float2D:
    """(17, n): the paper's terms; NaN where an input, or a value of it, was not recorded.

    A measured speed is never exactly zero: inside the dead band the sign of the speed is taken as 0, which is what
    sgn(0) is, and not as the sign of its noise.
    """
    unknown = np.full(len(recording), np.nan)
    rows = _terms(np.column_stack([recording.columns.get(c, unknown) for c in INPUTS]).astype(float))
    moving = {state.axis: state.moving, **{name: other.moving for name, other in state.others.items()}}
    for k, name in enumerate(PAPER.names):
        if name.startswith("sgn("):
            rows[k] *= moving.get(name[6:-1], True)
    return rows


def equation_names() -> tuple[str, ...]:
    return PAPER.names


def equation_inputs(names: Sequence[str]) -> tuple[str, ...]:
    """The columns that these terms of the equation follow from."""
    each_missing = np.where(np.eye(len(INPUTS), dtype=bool), np.nan, 1.0)
    unknown = np.isnan(_terms(each_missing)[[equation_names().index(n) for n in names]])
    return tuple(c for c, terms in zip(INPUTS, unknown.T, strict=True) if terms.any())


def supported_terms(rows: Sequence[Float2D], moving: Sequence[dict[str, Float1D]]) -> list[int]:
    """Indices of terms that these parts can support: known in each, not zero, not copies, of axes that really move."""
    joined = np.concatenate(rows, axis=1)
    share = {a: float(np.mean(np.concatenate([m[a] for m in moving]))) for a in moving[0]}
    keep: list[int] = []
    for k, name in enumerate(PAPER.names):
        row = joined[k]
        if not np.any(np.nan_to_num(row)) or any(np.isnan(r[k]).all() for r in rows):
            continue
        axis = next((a for a in ("sp", "x", "y", "z") if f"v_{a}" in name), None)
        if axis is not None and share.get(axis, 0.0) < _LEAST_MOTION:
            continue
        if any(_same(joined[j], row) for j in keep):
            continue
        keep.append(k)
    return keep


def _terms(inputs: Float2D) -> Float2D:
    """(17, n): the paper's terms, without scale, of (n, 13) inputs."""
    n = len(inputs)
    samples = Samples.real(inputs, np.zeros(n), np.full((n, 4), np.nan), np.zeros((n, 4)), "", np.arange(n))
    return PAPER.design(samples, _UNIT).T


def uneven_inputs(parts: Sequence[Recording], axis: str) -> list[str]:
    """A note for every column that some parts have, and the equation of `axis` does without because others lack it."""
    without = {c: [r.part.part for r in parts if c not in r or np.isnan(r[c]).all()] for c in INPUTS}
    return [
        f"axis {axis}: the equation in place of a simulation does without '{column}', which {', '.join(lack)} lacks. "
        "Give it in all parts."
        for column, lack in without.items()
        if 0 < len(lack) < len(parts)
    ]


def _same(one: Float1D, other: Float1D) -> bool:
    one, other = np.nan_to_num(one), np.nan_to_num(other)
    product = float(one @ other)
    return product**2 > (1 - 1e-9) * float(one @ one) * float(other @ other)
