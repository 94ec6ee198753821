"""Inputs for samples that were never measured: PiE (paper, section III-F.2).

In:  bins, how many samples each gets, rows to take everything from that the bin does not fix, the machine.
Out: complete input vectors, all inside the machine's limits.

A bin fixes v_x, v_y and AR: they are drawn uniformly from it. v_z, the accelerations and the spindle are not fixed:
  joint   they come together from one row of the nearest bins that hold any (rows of the coming part's planned path
          where it is known): on an arc a_x belongs to v_y, and an axis that rests goes on resting
  planned rows of the coming part's planned path are taken as they are, v_x, v_y and AR too: samples lie where the
          model will be asked, not anywhere in the bin
  paper   each is drawn on its own, v_z and a from a normal with the mean and variance of the rows between the 5 % and
          the 95 % quantile, a_sp with mean 0; the spindle speed comes from a row (the NC program)
Forces and torque follow from the same row by how the chip changes (`ChipScaling`), since AR alone does not tell a_e
from a_p and eq. 1 needs both; a caller who knows them passes a `ForceModel`. MRR = AR ||v||.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import INPUTS
from pido.core.machining import Machine
from pido.core.samples import PIE, Samples
from pido.feature_space.grid import Grid

_AT = {name: k for k, name in enumerate(INPUTS)}
V, A = [_AT[f"v_{a}"] for a in LINEAR_AXES], [_AT[f"a_{a}"] for a in LINEAR_AXES]
V_SP, A_SP, M_SP, MRR = (_AT[n] for n in ("v_sp", "a_sp", "m_sp_sim", "mrr_sim"))
F = [_AT[f"f_{a}_sim"] for a in LINEAR_AXES]


class ForceModel(Protocol):
    """Forces and torque of new inputs. Fills f_*_sim and m_sp_sim; all other columns of `inputs` are final."""

    def __call__(self, inputs: Float2D, ar: Float1D, source: Samples) -> Float2D:
        """(n, 4): F_x, F_y, F_z in N and M_sp in N·m, for n new rows and the n rows they were drawn from."""
        ...


@dataclass(frozen=True)
class ChipScaling:
    """Kienzle's force at another chip: F ~ AR f_z^(1-z), since F ~ b h_m^(1-z), b ~ a_p ~ AR and h_m ~ f_z.

    z : –, chip thickness exponent of the material; 0.25 is usual where it is not known (steels 0.2 to 0.3)
    The force turns with the direction of feed in the plane of v_x and v_y (eq. 1); the torque does not.
    Where either row cuts nothing there is no force. How wide the cut is stays that of the source row (a_e).
    """

    z: float = 0.25

    def __call__(self, inputs: Float2D, ar: Float1D, source: Samples) -> Float2D:
        old, new = source.inputs, inputs
        feed_old, feed_new = (np.hypot(rows[:, V[0]], rows[:, V[1]]) for rows in (old, new))
        tooth_old, tooth_new = (
            f / np.maximum(np.abs(rows[:, V_SP]), 1e-9) for f, rows in ((feed_old, old), (feed_new, new))
        )
        cut = (source.ar > 0) & (ar > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            area = np.where(cut, ar / source.ar, 0.0)
            thickness = np.where((tooth_old > 0) & (tooth_new > 0), tooth_new / tooth_old, 1.0)
        factor = area * np.clip(thickness, 0.1, 10.0) ** (1.0 - self.z)
        moving = (feed_old > 0) & (feed_new > 0)
        turn = np.where(
            moving,
            np.arctan2(new[:, V[1]], new[:, V[0]]) - np.arctan2(old[:, V[1]], old[:, V[0]]),
            0.0,
        )
        c, s = np.cos(turn), np.sin(turn)
        f_x, f_y = old[:, F[0]], old[:, F[1]]
        return np.column_stack([c * f_x - s * f_y, s * f_x + c * f_y, old[:, F[2]], old[:, M_SP]]) * factor[:, None]


def draw_inputs(
    bins: Int1D,
    number: Int1D,
    grid: Grid,
    source: Samples,
    machine: Machine,
    rng: np.random.Generator,
    *,
    nuisance: Literal["joint", "paper", "planned"] = "joint",
    forces: ForceModel | None = None,
    nearest: int = 4,
) -> tuple[Samples, Int1D]:
    """`number` samples in each of `bins`, without currents (NaN), and the row of `source` that each was drawn from.

    nearest : a row comes from one of this many bins of `source` that are nearest to the target; its own if it has any
    Fewer samples come back where a bin lies beyond the machine's speed, or where no draw is in motion.
    """
    target = np.repeat(bins, number)
    chosen = _source_rows(bins, number, grid, source, machine, rng, nearest)
    rows = source.take(chosen)
    inputs, dead = rows.inputs.copy(), np.array([machine.dead_band(a) for a in LINEAR_AXES])
    low, high = grid.low(target), grid.high(target)
    low[:, 2] = np.maximum(low[:, 2], 0.0)
    points = low + rng.random(low.shape) * np.maximum(np.nextafter(high, -np.inf) - low, 0.0)
    own = rows.reduced
    rests, untold = np.zeros((len(target), 2), bool), np.zeros(len(target), bool)
    if nuisance == "planned":
        inside = grid.ids(own) == target
        points, rests = np.where(inside[:, None], own, points), np.repeat(inside[:, None], 2, axis=1)
        untold = ~inside
    elif nuisance == "joint":
        # at rest, or cutting nothing: states of their own, that a uniform draw would never hit
        rests = (np.abs(own[:, :2]) <= dead[:2]) & (own[:, :2] >= low[:, :2]) & (own[:, :2] < high[:, :2])
        points[:, :2] = np.where(rests, own[:, :2], points[:, :2])
        idle = (own[:, 2] == 0) & (low[:, 2] == 0)
        points[:, 2] = np.where(idle, 0.0, points[:, 2])
        # a row that cuts nothing cannot tell the forces of one that does
        untold = (own[:, 2] == 0) & ~idle & (forces is None)
    else:
        for column in (V[2], *A):
            inputs[:, column] = rng.normal(*_middle(source.inputs[:, column]), len(target))
        inputs[:, A_SP] = rng.normal(0.0, _middle(source.inputs[:, A_SP])[1], len(target))
    inputs[:, V[:2]], ar = points[:, :2], points[:, 2]
    for d, axis in enumerate(LINEAR_AXES):
        limits = machine.axes[axis]
        inputs[:, A[d]] = np.clip(inputs[:, A[d]], -limits.a_max, limits.a_max)
    inputs[:, V[2]] = np.clip(inputs[:, V[2]], -machine.axes["z"].v_max, machine.axes["z"].v_max)
    inputs[:, V_SP] = np.clip(inputs[:, V_SP], -machine.spindle_max_deg_s, machine.spindle_max_deg_s)
    inputs[:, A_SP] = np.clip(inputs[:, A_SP], -machine.spindle_acc_deg_s2, machine.spindle_acc_deg_s2)
    speed = np.linalg.norm(inputs[:, V], axis=1)
    load = (forces or ChipScaling())(inputs, ar, rows)
    inputs[:, F] = np.clip(load[:, :3], -machine.force_max_n, machine.force_max_n)
    inputs[:, M_SP] = np.clip(load[:, 3], -machine.torque_max_nm, machine.torque_max_nm)
    inputs[:, MRR] = ar * speed
    moves = np.abs(inputs[:, V]) > dead
    direction = rows.direction.copy()
    direction[:, :3] = np.where(moves, np.sign(inputs[:, V]), direction[:, :3])
    fast = np.abs(inputs[:, V[:2]]) <= [machine.axes[a].v_max for a in ("x", "y")]
    # between rest and the dead band the sign of a velocity is noise
    vague = (~moves[:, :2] & ~rests).any(axis=1)
    good = fast.all(axis=1) & (inputs[:, MRR] <= machine.mrr_max_mm3_s) & ~vague & ~untold & moves.any(axis=1)
    n = int(good.sum())
    samples = Samples(
        inputs=inputs[good], ar=ar[good], currents=np.full((n, 4), np.nan), direction=direction[good],
        part=np.full(n, "", object), row=np.full(n, -1, np.int64), origin=np.full(n, PIE, np.int64),
        voxel=target[good], expected_error=np.zeros((n, 4)),
    )  # fmt: skip
    return samples, chosen[good]


def _source_rows(
    bins: Int1D, number: Int1D, grid: Grid, source: Samples, machine: Machine, rng: np.random.Generator, nearest: int
) -> Int1D:
    """A row of `source` for each new sample: from its own bin where that holds any, else from the nearest bins."""
    ids = grid.ids(source.reduced)
    order = np.argsort(ids, kind="stable")
    held, start, count = np.unique(ids[order], return_index=True, return_counts=True)
    metric = np.array([1.0, 1.0, 0.1])  # one mm/s weighs as much as ten mm² (alpha of table 2)
    k = min(nearest, len(held))
    distance, near = KDTree(grid.centres(held) * metric).query(grid.centres(bins) * metric, k=k)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    allowed = np.where(distance[:, :1] == 0.0, distance == 0.0, True)
    share = np.cumsum(count[near] * allowed, axis=1)
    which = np.repeat(np.arange(len(bins)), number)
    u = rng.random(len(which)) * share[which, -1]
    slot = (u[:, None] >= share[which]).sum(axis=1)
    before = np.where(slot > 0, share[which, np.maximum(slot - 1, 0)], 0)
    cell = near[which, slot]
    return order[start[cell] + np.minimum((u - before).astype(np.int64), count[cell] - 1)]


def _middle(values: Float1D) -> tuple[float, float]:
    """Mean and standard deviation of the values between their 5 % and 95 % quantiles."""
    low, high = np.quantile(values, [0.05, 0.95])
    inside = values[(values >= low) & (values <= high)]
    return float(inside.mean()), float(inside.std(ddof=1)) if len(inside) > 1 else 0.0
