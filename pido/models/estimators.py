"""Which regressor serves which axis. The method does not depend on it: any scikit-learn regressor can stand here.

`paper`    extra trees for x, y, z and gradient boosting for the spindle, with the settings of section IV-A
`default`  extra trees for all four: on parts that neither has seen, the paper's boosting (6 000 leaves, no depth limit)
           is no better and takes several times as long, see `python -m benchmarks models`
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sklearn.ensemble import ExtraTreesRegressor, GradientBoostingRegressor

from pido.core.errors import FitError

EstimatorFactory = Callable[[int], Any]
"""A new, unfitted regressor from a seed."""


def extra_trees(seed: int) -> ExtraTreesRegressor:
    """30 trees, depth 100, 5 samples per leaf, 1 000 leaves (paper, section IV-A)."""
    return ExtraTreesRegressor(30, max_depth=100, min_samples_leaf=5, max_leaf_nodes=1000, random_state=seed)


def paper_boosting(seed: int) -> GradientBoostingRegressor:
    """100 trees of up to 6 000 leaves (paper, section IV-A); no depth is stated, so none is set."""
    model = GradientBoostingRegressor(n_estimators=100, max_leaf_nodes=6000, random_state=seed)
    return model.set_params(max_depth=None)


ESTIMATORS: dict[str, dict[str, EstimatorFactory]] = {
    "paper": {"x": extra_trees, "y": extra_trees, "z": extra_trees, "sp": paper_boosting},
    "default": dict.fromkeys(("x", "y", "z", "sp"), extra_trees),
}


def estimators(choice: str | Mapping[str, EstimatorFactory]) -> Mapping[str, EstimatorFactory]:
    """A named set, or the mapping itself."""
    if not isinstance(choice, str):
        return choice
    if choice not in ESTIMATORS:
        raise FitError(f"no estimators named '{choice}'; there are {', '.join(ESTIMATORS)}.")
    return ESTIMATORS[choice]
