"""The mismatch finder on a plant's day beside sparse regression over the same library of mechanisms.

In:  nothing; parts of one machine with friction that the simulation leaves out on x. Out: rows {work, peer, ratio,
     goal, error}.

PySINDy (STLSQ) and LassoCV get the columns of the catalogue as `pido.diagnosis` builds them, one axis, on some rows;
their time is multiplied by rows and axes (said in the row). They are given the columns: that they would have to be
written by hand is not in their time. `error` says what each found.
"""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import psutil

from benchmarks.table import Row, row
from pido.config import machine
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.identify import candidates
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states

QUICK = {"parts": 3, "samples": 5_000, "rows": 1_500}
MACHINE, AXES, RATE_HZ = "dmc60h", ("x", "y", "z", "sp"), 500.0
MISSING = "stribeck_friction"


def recordings(parts: int, n: int) -> list[Recording]:
    """Smooth motion through standstill on all axes; on x a Stribeck bump of 0.6 A below 1.5 mm/s is missing."""
    made = []
    for number in range(parts):
        rng, t = np.random.default_rng(number), np.arange(n) / RATE_HZ
        columns: dict[str, Any] = {"time": t}
        for axis in AXES:
            scale = 3000.0 if axis == "sp" else 4.0
            v = sum(
                scale * rng.uniform(0.3, 1) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6))
                for f in rng.uniform(0.02, 0.4, 4)
            )
            columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) / RATE_HZ, f"a_{axis}": np.gradient(v, t)}
            simulated = 1.2 * np.sign(v) + 0.05 * v / scale + 1e-3 * columns[f"a_{axis}"] / scale
            noise = np.convolve(rng.normal(0, 0.05, n + 4), np.ones(5) / np.sqrt(5), mode="valid")
            bump = 0.6 * np.exp(-((np.abs(v) / 1.5) ** 2)) * np.sign(v) if axis == "x" else 0.0
            columns |= {f"curr_{axis}_sim": simulated, f"curr_{axis}": simulated + bump + noise}
        columns |= dict.fromkeys(("f_x_sim", "f_y_sim", "f_z_sim", "m_sp_sim", "mrr_sim"), np.zeros(n))
        made.append(Recording(PartInfo(machine=MACHINE, part=f"p{number:02d}", order=number + 1), columns))
    return made


def run(parts: int = 10, samples: int = 100_000, rows: int = 5_000) -> Iterator[Row]:
    """The product's time and memory, and the peers', each as soon as it is measured."""
    days = recordings(parts, samples)
    before, cpu = time.perf_counter(), time.process_time()
    with memory_of_all() as taken:
        result = diagnose(days, machine=machine(MACHINE))
    seconds, cpu = time.perf_counter() - before, time.process_time() - cpu
    found = ", ".join(f"{f.axis}: {f.mechanism}" for f in result.findings) or "nothing"
    work = f"diagnosis, {parts} parts x {samples} samples x {len(AXES)} axes"
    right = any(f.axis == "x" and f.mechanism == MISSING for f in result.findings)
    told = f"CPU {cpu:.1f} s of this process; found {found} (true: x: {MISSING})"
    yield row(f"{work}, s", "–", seconds, "<= 60", told) | {"within": right}
    yield row(f"{work}, GiB", "–", max(taken) / 2**30, "<= 2", "peak of all processes")
    columns, target, names = library(days, rows)
    share = parts * samples * len(AXES) / len(target)
    for name, fit in (("PySINDy", _pysindy), ("LassoCV", _lasso)):
        peer, said = fit(columns, target, names)
        words = f"{name}, {columns.shape[1]} columns, {len(target)} rows of x (extrapolated)"
        yield row(work, words, peer * share / seconds, ">= 1", f"it says for x: {said}")


@contextmanager
def memory_of_all() -> Iterator[list[int]]:
    """Bytes that this process and those that it starts hold together, every fifth of a second; what several of them
    share (mapped columns, libraries) is counted for each."""
    taken, done, this = [0], threading.Event(), psutil.Process()

    def watch() -> None:
        while not done.wait(0.2):
            held = 0
            for process in (this, *this.children(recursive=True)):
                with suppress(psutil.NoSuchProcess):
                    held += process.memory_info().rss
            taken.append(held)

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        yield taken
    finally:
        done.set()
        watching.join()


def library(days: list[Recording], rows: int) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Columns of the catalogue (n, k), the mismatch of x (n,), and which mechanism each column belongs to."""
    states = axis_states(days, "x", machine(MACHINE))
    targets = [r["curr_x"] - r["curr_x_sim"] for r in days]
    stride = max(1, sum(len(r) for r in days) // rows)
    mismatch = lay_out(states, targets, None, (), stride)
    grid = Library(mismatch, candidates(CATALOGUE, mismatch, {})[0])
    names = [term.name for term, (i, j) in zip(grid.terms, grid.spans, strict=True) for _ in range(j - i)]
    target = np.asarray(mismatch.target, float)
    good = np.isfinite(target) & np.isfinite(grid.rows).all(axis=0)
    columns = grid.rows[:, good].T.astype(float)
    columns /= np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-12)
    return columns, target[good], names


def _timed(call: Any) -> tuple[float, Any]:
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # LassoCV's and STLSQ's warnings of collinear columns are theirs to give
        result = call()
    return time.perf_counter() - start, result


def _pysindy(columns: np.ndarray, target: np.ndarray, names: list[str]) -> tuple[float, str]:
    from pysindy.optimizers import STLSQ

    seconds, model = _timed(lambda: STLSQ(threshold=0.05, alpha=1e-3).fit(columns, target[:, None]))
    return seconds, _said(np.ravel(model.coef_), names)


def _lasso(columns: np.ndarray, target: np.ndarray, names: list[str]) -> tuple[float, str]:
    from sklearn.linear_model import LassoCV

    seconds, model = _timed(lambda: LassoCV(cv=5, alphas=50).fit(columns, target))
    return seconds, _said(model.coef_, names)


def _said(coefficients: np.ndarray, names: list[str]) -> str:
    used = [name for name, c in zip(names, coefficients, strict=True) if c]
    return f"{len(used)} columns of {len(set(used))} mechanisms"
