"""Whether an equation has a piece of physics already: then each fit finds its size, and adding it changes nothing.

In:  a term that would extend a term set, the machine. Out: names of the terms that make it up, none where it is new;
     and how large its columns can be on this machine.

Asked of rows that go through all that the machine can do, at rest and in motion, in the air and in the cut. What a
recording at hand cannot tell apart may still be two things: only what is the same for every part counts.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import INPUTS
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.terms import ExtraTerm, TermSet

_ROWS = 4_000
_DECADES = 5.0  # below the largest: friction is decided far below rapid traverse
_LEFT = 1e-3  # of a column's size: dead bands leave as much of what is the same in motion
_AR_MM2 = 100.0


def made_of(term: ExtraTerm, terms: TermSet, machine: Machine) -> tuple[str, ...]:
    """Names of the terms that every column of `term` is a sum of; () where one is not, or where all are zero."""
    rows = _rows(machine)
    columns = np.asarray(term.columns(rows), float).reshape(len(rows), -1)
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    design = terms.design(rows, machine)
    design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    share = np.linalg.lstsq(design, columns, rcond=1e-10)[0]
    if not columns.size or np.linalg.norm(columns - design @ share, axis=0).max() > _LEFT:
        return ()
    used = np.abs(share).max(axis=1) > _LEFT
    return tuple(name for name, use in zip(terms.names, used, strict=True) if use)


def reach(term: ExtraTerm, machine: Machine) -> Float1D:
    """(k,) – the largest that each column of `term` can be on this machine, and at least 1: what a fit divides it by,
    as every term is divided by its range. The square of a spindle's speed in (deg/s)² is 2e9 beside friction's 1."""
    rows = _rows(machine)
    return np.maximum(np.abs(np.asarray(term.columns(rows), float).reshape(len(rows), -1)).max(axis=0), 1.0)


def _rows(machine: Machine) -> Samples:
    """Rows over all that the machine can reach, evenly on a logarithmic scale; a third of each axis at rest, with the
    direction of its last motion, and a third without a cut."""
    rng = np.random.default_rng(0)
    limits = [machine.axes[axis] for axis in LINEAR_AXES]
    most = [
        *(one.v_max for one in limits), *(one.a_max for one in limits), machine.spindle_max_deg_s,
        machine.spindle_acc_deg_s2, *[machine.force_max_n] * 3, machine.torque_max_nm, machine.mrr_max_mm3_s,
    ]  # fmt: skip
    size = 10.0 ** rng.uniform(-_DECADES, 0.0, (_ROWS, len(INPUTS)))
    inputs = size * rng.choice([-1.0, 1.0], size.shape) * most
    speeds = [INPUTS.index(f"v_{axis}") for axis in AXES]
    direction = np.sign(inputs[:, speeds])
    inputs[:, speeds] *= rng.random((_ROWS, len(AXES))) > 1 / 3
    cut = rng.random(_ROWS) > 1 / 3
    loads = [k for k, name in enumerate(INPUTS) if name.endswith("_sim")]
    inputs[:, loads] *= cut[:, None]
    inputs[:, INPUTS.index("mrr_sim")] = np.abs(inputs[:, INPUTS.index("mrr_sim")])
    area = cut * rng.uniform(0.0, _AR_MM2, _ROWS)
    return Samples.real(inputs, area, np.zeros((_ROWS, len(AXES))), direction, "", np.arange(_ROWS))
