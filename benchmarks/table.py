"""Rows of the benchmark table: how they are timed, judged, printed, and kept for the next run.

In:  rows {work, peer, ratio, goal, error} of the modules beside this one; more keys are carried along.
     `within` is False where a speed-up changed results beyond the stated bound: then the whole run fails.
Out: whether a goal is met, what changed since the last run on the same machine, the table as text or Markdown.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]
CALM = 1.5
"""Load average per machine above which a run says that its times were disturbed."""


def row(work: str, peer: str, ratio: float, goal: str, error: str) -> Row:
    """One line: `ratio` is the peer's time over ours where there is a peer, else the number that the goal is about."""
    return {"work": work, "peer": peer, "ratio": float(ratio), "goal": goal, "error": error}


def alternately(ways: Mapping[str, Callable[[], Any]], repeats: int = 5) -> dict[str, float]:
    """Median wall seconds of each way, taken in turn, so that a busy stretch of the machine meets all of them."""
    return {name: wall for name, (wall, _) in both_clocks(ways, repeats).items()}


def both_clocks(ways: Mapping[str, Callable[[], Any]], repeats: int = 5) -> dict[str, tuple[float, float]]:
    """Median wall and CPU seconds of each way, taken in turn. CPU time counts all threads."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            wall, cpu = time.perf_counter(), time.process_time()
            result = way()
            taken[name].append((time.perf_counter() - wall, time.process_time() - cpu))
            del result  # what a way made is freed on nobody's clock
    return {name: tuple(np.median(values, axis=0).tolist()) for name, values in taken.items()}


def met(found: Row) -> bool | None:
    """Whether a row reaches its goal; None where the goal is words. Never where its error is beyond its bound."""
    if not found.get("within", True):
        return False
    goal = found["goal"]
    if isinstance(goal, int | float):
        return bool(found["ratio"] >= goal)
    sign, _, rest = str(goal).partition(" ")
    if sign not in (">=", "<="):
        return None
    if rest.split(" ")[1:]:  # "<= 25 ms": the ratio is goal over measured already
        return bool(found["ratio"] >= 1.0)
    return bool(found["ratio"] >= float(rest) if sign == ">=" else found["ratio"] <= float(rest))


def goal_words(found: Row) -> str:
    goal = found["goal"]
    return f">= {goal:g}" if isinstance(goal, int | float) else str(goal)


def error_words(found: Row) -> str:
    error = found["error"]
    words = f"{error:.1e}" if isinstance(error, int | float) else str(error)
    return words if found.get("within", True) else f"{words}: BEYOND ITS BOUND"


def machine() -> dict[str, Any]:
    """What the times were measured on."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    return {
        "cpu": model,
        "cores": os.cpu_count(),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def load_words(load: float) -> str:
    """How calm the machine was."""
    return f"load {load:.1f}" + (": other work ran beside it, wall times are too long" if load > CALM else "")


def change(found: Row, before: Mapping[str, float]) -> str:
    """Ratio against the last run's, where it moved by more than a twentieth."""
    old = before.get(key(found))
    if not old or not np.isfinite(found["ratio"]):
        return ""
    moved = found["ratio"] / old - 1.0
    return f"{100 * moved:+.0f} %" if abs(moved) > 0.05 else "="


def key(found: Row) -> str:
    """What a row is known by in the results that are kept; numbers that change from run to run are no part of it."""
    return f"{found.get('module', '')} | {found['work'].split(', now ')[0]} | {found['peer']}"


def line(found: Row, before: Mapping[str, float]) -> str:
    """One row for a terminal."""
    mark = {True: "met", False: "MISSED", None: ""}[met(found)]
    return (
        f"{found['ratio']:>9.4g}  {goal_words(found):<10} {mark:<7}{change(found, before):>7}  "
        f"{found['work']}  |  {found['peer']}  |  {error_words(found)}  |  load {found.get('load', 0.0):.1f}"
    )


def markdown(rows: list[Row], about: Mapping[str, Any]) -> str:
    """The table for a document; goals that were missed are in bold."""
    lines = [
        f"{about['cpu']}, {about['cores']} cores, {about['memory_gib']} GiB, Python {about['python']}, "
        f"numpy {about['numpy']}.",
        "",
        "| work | peer | ratio | goal | error and sizes | load |",
        "|---|---|---|---|---|---|",
    ]
    for found in rows:
        ratio = f"{found['ratio']:.3g}" if np.isfinite(found["ratio"]) else ""
        ratio = f"**{ratio}** (missed)" if met(found) is False else ratio
        cells = (found["work"], found["peer"], ratio, goal_words(found), error_words(found), f"{found['load']:.1f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def read_kept(path: Path, about: Mapping[str, Any], quick: bool) -> dict[str, float]:
    """Ratios of the last run on the same machine with the same sizes, by `key`."""
    if not path.exists():
        return {}
    return json.loads(path.read_text(encoding="utf-8")).get(_place(about, quick), {}).get("ratios", {})


def keep(path: Path, about: Mapping[str, Any], quick: bool, rows: list[Row]) -> None:
    """Put the rows beside those of other machines and sizes; lines that were not run stay as they were."""
    everything = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    place = everything.setdefault(_place(about, quick), {"ratios": {}, "rows": {}})
    for found in rows:
        if np.isfinite(found["ratio"]):
            place["ratios"][key(found)] = found["ratio"]
            place["rows"][key(found)] = found
    place["machine"] = dict(about)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(everything, indent=1, default=str) + "\n", encoding="utf-8")


def _place(about: Mapping[str, Any], quick: bool) -> str:
    return f"{about['cpu']}, {about['cores']} cores" + (", quick" if quick else "")
