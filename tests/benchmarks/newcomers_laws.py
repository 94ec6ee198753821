"""What the newcomer's laws are held against in the tests of every edition."""

from collections.abc import Sequence

import numpy as np

from benchmarks.newcomer import fair
from benchmarks.newcomer.assembly import logged
from benchmarks.newcomer.faults import thinned
from benchmarks.newcomer.second.textbook import textbook
from benchmarks.newcomer.world import World
from pido.core.arrays import Float1D, Float2D


def books(world: World, axis: str) -> tuple[dict[str, Float2D], dict[str, Float2D]]:
    """What the vocabulary says on an axis: the rivals of the fairness check, and the textbooks' forms."""
    shown, sim = thinned(world.parts), {axis: logged(world.machine, world.sim[axis])}
    return fair.rivals(shown, sim, axis), textbook(shown, sim, axis)


def likeness(currents: Sequence[Float1D]) -> Float2D:
    """(k, k): of each two currents |cosine|, 0 with itself; a law may have nothing to act on here."""
    columns = np.column_stack(currents)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    return np.abs(columns.T @ columns) * (1 - np.eye(len(currents)))
