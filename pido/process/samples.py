"""A recording with its process quantities becomes the rows that equations and models learn from.

In:  `Recording` with motion and process columns, machine (dead bands), digest of the part.
Out: `Samples`: the 13 inputs, AR, currents, and the held direction of each axis.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, INPUTS, POSITION, PROCESS, UNITS, VELOCITY
from pido.core.errors import RecordingError
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.physics.friction import held_direction
from pido.process.quantities import area_removal

logger = logging.getLogger(__name__)

AR_MAX_MM2 = 200.0
"""Upper bound of AR for a sample with the tool engaged (paper, section IV-A)."""
AR_NOISE_MM2 = 0.05
"""Lower bound: a path recorded to a few micrometres "removes" this much at a wall that was already cut."""
GAP_STEPS = 2.5
"""A time step longer than this many median steps is a gap: the direction of an axis is unknown after it."""


def to_samples(recording: Recording, machine: Machine, part_digest: str, *, engaged_only: bool = True) -> Samples:
    """Rows of one part, in time order.

    A row is kept where all 13 inputs are there; with `engaged_only` also where 0 < AR < 200 mm² and the tool moves
    (paper, section IV-A). A measured speed or AR is never exactly 0: ||v|| != 0 means faster than the dead band on at
    least one axis, and AR > 0 means beyond the noise of a recorded path. The held direction is found before rows are
    left out. An axis whose current was not recorded has NaN.

    Raises RecordingError for missing columns, or where no row is left.
    """
    missing = [name for name in INPUTS if name not in recording]
    if missing:
        what, advice = ", ".join(missing), " ".join(_ways(recording, missing))
        raise RecordingError(f"part {recording.part.part}: {what} missing, and every row needs them. {advice}")
    inputs = np.column_stack([np.asarray(recording[name], float) for name in INPUTS])
    ar = area_removal(recording)
    keep = np.isfinite(inputs).all(axis=1)
    incomplete = int((~keep).sum())
    if engaged_only:
        keep &= engaged(recording, machine)
        if not keep.any():
            raise RecordingError(
                f"part {recording.part.part}: no sample has the tool engaged (0 < AR < {AR_MAX_MM2:g} mm², and "
                f"motion in x, y or z). {not_engaged(recording)}"
            )
    elif not keep.any():
        raise RecordingError(f"part {recording.part.part}: no sample has all 13 inputs.")
    n = len(recording)
    currents = np.column_stack(
        [np.asarray(recording[CURRENT[a]], float) if CURRENT[a] in recording else np.full(n, np.nan) for a in AXES]
    )
    row = np.flatnonzero(keep)
    logger.info("part %s: %d of %d samples kept, %d incomplete", recording.part.part, len(row), n, incomplete)
    return Samples.real(inputs[row], ar[row], currents[row], directions(recording, machine)[row], part_digest, row)


def engaged(recording: Recording, machine: Machine) -> Bool1D:
    """(n,): 0 < AR < 200 mm², beyond the noise of a recorded path, and at least one linear axis moves."""
    ar = area_removal(recording)
    moves = np.any([np.abs(recording[VELOCITY[a]]) > machine.dead_band(a) for a in LINEAR_AXES], axis=0)
    return (ar > AR_NOISE_MM2) & (ar < AR_MAX_MM2) & moves


def may_be_engaged(recording: Recording) -> Bool1D:
    """(n,): samples of which the recording does not say that nothing was removed."""
    if "mrr_sim" not in recording:
        return np.ones(len(recording), bool)
    return np.asarray(~(recording["mrr_sim"] <= 0.0))


def load_in(columns: Mapping[str, Array1D]) -> str:
    """The first process quantity that is not 0 throughout, in words; '' where there is none. With one it is no
    air cut.

    >>> load_in({"f_x_sim": np.array([0.0, -264.9]), "mrr_sim": np.zeros(2)})
    'f_x_sim is up to 264.9 N'
    """
    for name in PROCESS:
        largest = np.nanmax(np.abs(columns[name]), initial=0.0) if name in columns else 0.0
        if largest > 0:
            return f"{name} is up to {largest:.4g} {UNITS[name]}"
    return ""


def not_engaged(recording: Recording) -> str:
    """What to do where no sample has the tool engaged: it depends on what the recording says of forces and removal.

    >>> from pido.core.part import PartInfo
    >>> force = {"time": np.array([0.0, 0.02]), "f_x_sim": np.array([0.0, 264.9]), "mrr_sim": np.zeros(2)}
    >>> not_engaged(Recording(PartInfo(part="p01", machine="m"), force)).partition(":")[0]
    'f_x_sim is up to 264.9 N, but mrr_sim is 0 throughout'
    """
    load = load_in(recording.columns)
    if not load:
        return "Check raw part, tool and zero offset, or say that this is an air cut (air_cut = true)."
    if not np.nanmax(recording.columns.get("mrr_sim", np.zeros(1)), initial=0.0) > 0:
        return (
            f"{load}, but mrr_sim is 0 throughout: so this is no air cut, and its removal is missing. Export mrr_sim "
            "as it was simulated, or bring the recording without this column and say what was cut (material, tools, "
            "stock)."
        )
    return f"{load}, so this is no air cut: look at mrr_sim, and at raw part, tool and zero offset of its simulation."


def _ways(recording: Recording, missing: Collection[str]) -> Iterator[str]:
    """How to get the columns that are missing, a sentence per way."""
    for axis in AXES:
        motion = (POSITION[axis], VELOCITY[axis], ACCELERATION[axis])
        if not set(missing) & set(motion):
            continue
        name = "the spindle" if axis == "sp" else f"axis {axis}"
        if any(column in recording for column in motion):
            yield f"Derive the motion of {name} first (`pido.recordings.derive.with_motion`)."
        else:
            need = (VELOCITY["sp"] if axis == "sp" else POSITION[axis], CURRENT[axis])
            units = " and ".join(f"{column} in {UNITS[column]}" for column in need)
            yield f"Nothing of {name} was recorded: export {units} with the others, also where it stood."
    if set(missing) & set(PROCESS):
        yield "Simulate the process quantities along the path first (`pido.process.quantities.process_quantities`)."


def directions(recording: Recording, machine: Machine) -> Float2D:
    """(n, 4): sign of each axis' last real motion; 0 until it is known, at the start and after every gap in time."""
    step = np.diff(recording.time)
    gaps = np.flatnonzero(step > GAP_STEPS * np.median(step)) + 1 if len(step) else np.array([], int)
    held: list[Float1D] = [
        np.concatenate([held_direction(v, machine.dead_band(axis)) for v in np.split(recording[VELOCITY[axis]], gaps)])
        for axis in AXES
    ]
    return np.column_stack(held)
