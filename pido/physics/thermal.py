"""First-order warming of a machine that runs and pauses.

In:  times. Out: how cold the machine still is, 1 cold .. 0 at its steady temperature.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D


def coldness(running_s: Float1D, tau: float, at_start: float = 1.0) -> Float1D:
    """What is left of the way to the steady temperature after some time of running.

        c = c_0 * exp(-t / tau)

    running_s : (n,), s since the start; tau : scalar > 0, s; at_start : c_0, – . Returns (n,), –.

    >>> round(float(coldness(np.array([60.0]), tau=60.0)[0]), 6)
    0.367879
    """
    return at_start * np.exp(-np.asarray(running_s, float) / tau)


def coldness_after(
    runs: Sequence[tuple[float, float]], start: float, tau: float, tau_in_pauses: float | None = None
) -> float:
    """How cold a machine is at `start` after earlier runs, cooling in the pauses between them.

    runs : (start, end) of each earlier run, s on the machine's clock, in order; cold before the first of them
    tau, tau_in_pauses : scalars > 0, s, while it runs and while it pauses; None: it cools as it warms

    >>> coldness_after([], 100.0, 60.0), round(coldness_after([(0.0, 1e6)], 1e6, 60.0), 6)
    (1.0, 0.0)
    >>> round(coldness_after([(0.0, 1e6)], 1e6 + 120.0, 60.0, 120.0), 6)
    0.632121
    """
    cooling = tau if tau_in_pauses is None else tau_in_pauses
    cold, end = 1.0, None
    for begin, stop in (*runs, (start, start)):
        if end is not None:
            cold = 1.0 - (1.0 - cold) * float(np.exp(-max(begin - end, 0.0) / cooling))
        cold *= float(np.exp(-max(stop - begin, 0.0) / tau))
        end = stop
    return cold
