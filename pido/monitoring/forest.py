"""The same predictions as a fitted forest gives, a row at a time in microseconds: a stream cannot wait for batches.

In:  a fitted model. Out: a function from rows (n, d) to predictions (n,).

A forest of decision trees is flattened into arrays once and walked by compiled code: the trees' own splits in their own
precision (inputs as 32-bit floats, thresholds as 64-bit). Anything else keeps its own `predict`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from pido.core.arrays import Float1D, Float2D

Predict = Callable[[Float2D], Float1D]


def quick(model: Any) -> Predict:
    """`model.predict`, compiled where the model is a forest whose prediction is the mean of its trees."""
    trees = getattr(model, "estimators_", None)
    # boosting has `init_` and adds up what its trees say; several outputs have several values per leaf
    if not isinstance(trees, list) or hasattr(model, "init_") or not all(_plain(tree) for tree in trees):
        return model.predict
    inner = [tree.tree_ for tree in trees]
    start = np.cumsum([0, *(t.node_count for t in inner)])
    left = np.concatenate([t.children_left + s * (t.children_left >= 0) for t, s in zip(inner, start, strict=False)])
    right = np.concatenate([t.children_right + s * (t.children_right >= 0) for t, s in zip(inner, start, strict=False)])
    feature = np.concatenate([t.feature for t in inner])
    threshold = np.concatenate([t.threshold for t in inner])
    value = np.concatenate([t.value[:, 0, 0] for t in inner])

    def predict(rows: Float2D) -> Float1D:
        return _walk(np.asarray(rows, np.float32), start[:-1], left, right, feature, threshold, value)

    return predict


def _plain(tree: Any) -> bool:
    inner = getattr(tree, "tree_", None)
    return inner is not None and inner.value.shape[1:] == (1, 1)


@njit(cache=True, error_model="numpy")
def _walk(rows, roots, left, right, feature, threshold, value):  # pragma: no cover - compiled
    out = np.empty(len(rows))
    for i in range(len(rows)):
        total = 0.0
        for root in roots:
            node = root
            while left[node] >= 0:
                node = left[node] if rows[i, feature[node]] <= threshold[node] else right[node]
            total += value[node]
        out[i] = total / len(roots)
    return out
