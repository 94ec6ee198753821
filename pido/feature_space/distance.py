"""How far two data sets are from each other in the reduced space (paper, section IV-C and figure 33).

In:  two sets of points of M and a grid. Out: the Wasserstein distance between them, in mm/s.
The transport problem is solved by POT (Flamary et al., JMLR 2021) between the centroids of occupied bins.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float2D
from pido.core.errors import FitError
from pido.feature_space.density import occupancy
from pido.feature_space.grid import SAMPLING_GRID, Grid


def wasserstein(a: Float2D, b: Float2D, grid: Grid = SAMPLING_GRID, area_scale: float = 1.0) -> float:
    """First-order Wasserstein distance between two sets of points (n, 3) and (m, 3).

    area_scale : mm/s per mm² – how much one mm² of area removal counts beside one mm/s of speed. The paper gives one
        number per pair of data sets and no scale, so 1.
    The points of a bin are moved to its centroid first; the answer changes by less than one bin diagonal.

    >>> wasserstein(np.zeros((1, 3)), np.array([[3.0, 4.0, 0.0]]))
    5.0
    """
    import ot  # two seconds, and few need it

    if not len(a) or not len(b):
        raise FitError("a distance needs at least one sample on each side.")
    scale = np.array([1.0, 1.0, area_scale])
    left, right = occupancy(np.asarray(a, float), grid), occupancy(np.asarray(b, float), grid)
    cost = ot.dist(left.centroid * scale, right.centroid * scale, metric="euclidean")
    plan_cost = ot.emd2(left.count / left.count.sum(), right.count / right.count.sum(), cost)
    return float(plan_cost)  # type: ignore[arg-type]
