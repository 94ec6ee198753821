"""Proof on concealed effects: cases are drawn and sealed, the tool is run blind, and only then the truth is opened.

In:  seed, number of cases. Out: one row per case and solver in `cases.parquet`, and the tables of the proof.

The tool is what a user runs: `pido diagnose` on part folders and `pido correct` on a part it was not shown, in a
process of their own, in a folder that the sealed truth is not in. Rivals see the same parts.
"""

# pandas annotates what an index or a group gives as a table, a column or a number at once: pyright objects to each
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.errors import PidoError
from pido.experiments.base import Outcome, Shown
from pido.experiments.judged import Answer, Claim, Interval, judge
from pido.synthetic.cases import KINDS, MECHANISMS, draw_case
from pido.synthetic.write import write_case

STRENGTHS = (0.5, 1.0, 2.0, 4.0)
TOOL = "pido"
T = TypeVar("T")


@dataclass(frozen=True)
class Task:
    """What to draw. The key names its files; it says nothing that the tool could read."""

    kind: str
    strength: float
    seed: int

    @property
    def key(self) -> str:
        return hashlib.sha256(f"{self.kind}|{self.strength}|{self.seed}".encode()).hexdigest()[:12]


Solver = Callable[[Sequence[Path], Path, Path], Answer]
"""(folders of the parts to diagnose, folder of the unseen part, folder to work in) -> answer."""


def plan(cases: int, seed: int) -> list[Task]:
    """`cases` tasks that go evenly through the kinds and, for each, through the strengths; order and seeds drawn.

    Clean cases, single mechanisms and pairs come more often than the rest: rates of 5 % need many of them.
    """
    rng = np.random.default_rng(seed)
    weighted = [*KINDS, *["none"] * 9, *["pair"] * 5, *["unknown"] * 3]
    tasks: list[Task] = []
    turn = 0
    while len(tasks) < cases:
        for kind in rng.permutation(weighted):
            # a rotating start: every kind meets every strength, whatever the number of cases
            at = (int(hashlib.sha256(str(kind).encode()).hexdigest(), 16) + turn) % len(STRENGTHS)
            tasks.append(Task(str(kind), STRENGTHS[at], int(rng.integers(2**31))))
        turn += 1
    return tasks[:cases]


def run(
    tasks: Sequence[Task],
    folder: Path,
    *,
    solvers: Mapping[str, Solver],
    workers: int = 1,
    on_progress: Callable[[int, int, str], None] = lambda done, of, what: None,
) -> pd.DataFrame:
    """One row per case and solver. What `folder` holds from an earlier run, by the same code, is not computed again."""
    kept = folder / "rows"
    kept.mkdir(parents=True, exist_ok=True)
    under = code_digest()
    files = {t: kept / f"{t.key}-{under}-{'-'.join(solvers)}.json" for t in tasks}

    def ask(task: Task) -> list[dict[str, Any]]:
        said = json.dumps([task.kind, task.strength, task.seed])
        about = f"case {task.kind}, strength {task.strength}, seed {task.seed}"
        return in_a_process(about, "pido.experiments.concealed", said, str(folder), ",".join(solvers))

    answers = each_once(files, ask, workers, lambda done, of, task: on_progress(done, of, task.kind if task else ""))
    table = pd.DataFrame([row for rows in answers for row in rows])
    table.to_parquet(folder / "cases.parquet", index=False)
    return table


def each_once(
    files: Mapping[T, Path], ask: Callable[[T], Any], workers: int, on_progress: Callable[[int, int, T | None], None]
) -> list[Any]:
    """What `ask` answers to each task, as JSON data; kept in its file, and not asked again where that is there.

    on_progress : (answers so far, of how many, the task that was answered last; None at the start)
    """
    left = [t for t in files if not files[t].exists()]
    on_progress(len(files) - len(left), len(files), None)
    with ThreadPoolExecutor(workers) as pool:  # the work is done in processes of their own
        waiting = {pool.submit(ask, task): task for task in left}
        for done, future in enumerate(as_completed(waiting), start=len(files) - len(left) + 1):
            files[waiting[future]].write_text(json.dumps(future.result()), encoding="utf-8")
            on_progress(done, len(files), waiting[future])
    return [json.loads(file.read_text(encoding="utf-8")) for file in files.values()]


def in_a_process(about: str, module: str, *arguments: str, place: Path | None = None) -> Any:
    """What a module prints last, as JSON data: one thread, run from `place`. PidoError `about` it where it crashes."""
    call = [sys.executable, "-m", module, *arguments]
    ended = subprocess.run(call, capture_output=True, text=True, env=_one_thread(), cwd=place, check=False)
    if ended.returncode:
        raise PidoError(f"{about}: {ended.stderr[-800:]}")
    return json.loads(ended.stdout.splitlines()[-1])


def _one_thread() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def solve_case(task: Task, folder: Path, solvers: Mapping[str, Solver]) -> list[dict[str, Any]]:
    """Draw, seal, ask every solver, open. The last part is not shown to the solvers before they have answered."""
    case, sealed = folder / "work" / task.key, folder / "sealed" / task.key
    shutil.rmtree(case, ignore_errors=True)
    parts = write_case(draw_case(task.kind, task.strength, task.seed), case, sealed)
    rows = []
    for name, solver in solvers.items():
        about = {"case": task.key, **task.__dict__, "solver": name, "error": ""}
        try:
            answer = solver(parts[:-1], parts[-1], case)
        except PidoError as error:
            rows.append({**about, "error": str(error)[-500:]})
            continue
        truth = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
        rows.append(about | judge(answer, truth, sealed, parts[-1].name))
    shutil.rmtree(case)
    shutil.rmtree(sealed)
    return rows


def tool(parts: Sequence[Path], unseen: Path, place: Path) -> Answer:
    """`pido diagnose` and `pido correct`, read back from the files of the contract."""
    out, corrected = place / "diagnosis", place / "unseen.parquet"
    start = time.perf_counter()
    _pido("diagnose", *map(str, parts), "--out", str(out))
    seconds = time.perf_counter() - start
    _pido("correct", str(out), str(unseen), "--out", str(corrected))
    said = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    claims = tuple(
        Claim(
            f["axis"], f["mechanism"], f["kind"], tuple(a["mechanism"] for a in f["alternatives"]),
            {k: Interval(*p["ci95"], p["unit"]) for k, p in f["parameters"].items() if None not in p["ci95"]},
        )
        for f in said["findings"]
    )  # fmt: skip
    scores = {p.name: _series(out / "parts" / f"{p.name}.parquet", "mismatch_score_") for p in parts}
    return Answer(claims, scores, _series(corrected, "mismatch_"), seconds)


def _pido(*arguments: str) -> None:
    call = [sys.executable, "-m", "pido.cli", *arguments]
    ended = subprocess.run(call, capture_output=True, text=True, env=_one_thread(), check=False)
    if ended.returncode:
        raise PidoError(f"pido {arguments[0]}: {ended.stderr[-800:]}")


def _series(path: Path, prefix: str) -> dict[str, Float1D]:
    table = pd.read_parquet(path)
    return {a: table[prefix + a].to_numpy(float) for a in AXES if prefix + a in table}


def group_of(kind: str) -> str:
    """The lines of the table.

    >>> group_of("miscalibrated:inertia"), group_of("stribeck_friction"), group_of("sensor_gain")
    ('wrong coefficient', 'single', 'data fault')
    """
    named = {"none": "clean", "pair": "pair", "unknown": "outside the vocabulary"}
    form = {"miscalibrated": "wrong coefficient", "region": "confined to a region", "confounded": "confounded"}
    if kind in named:
        return named[kind]
    if ":" in kind:
        return form[kind.partition(":")[0]]
    return "single" if kind in MECHANISMS else "data fault"


def summarise(table: pd.DataFrame) -> Outcome:
    """By kind, singles by strength, solvers beside one another, and each mechanism."""
    failed = table[table["error"] != ""]
    good = table[table["error"] == ""].assign(group=lambda t: t["kind"].map(group_of))
    for name in ("auc", "removed"):
        good[name] = pd.to_numeric(good.get(name, pd.Series(np.nan, good.index)))
    own = good[good["solver"] == TOOL]
    single = own[own["group"] == "single"]
    by_kind = pd.DataFrame([{"kind": g, **rates(rows)} for g, rows in own.groupby("group")])
    by_strength = pd.DataFrame([{"strength": s, **rates(rows)} for s, rows in single.groupby("strength")])
    solvers = pd.DataFrame([{"solver": s, **_versus(good[good["solver"] == s])} for s in good["solver"].unique()])
    each = pd.DataFrame([{"what": k, **rates(rows)} for k, rows in own.groupby("kind")])
    columns = ["kind", "strength", "seed", "truth", "said"]
    wrong = own.loc[(own["first"].isin([False])) | (own["false"] > 0), columns]
    strong = single[single["strength"] >= 1]
    clean = own[own["group"] == "clean"]
    verdict = (
        f"Named right first: {_share(strong['first'])} of single effects at least as strong as the noise. "
        f"Any finding on clean parts: {_share(clean['claims'] > 0)}. "
        f"False findings per case: {own['false'].mean():.2f} ({len(own)} cases)."
    )
    differs = [f"{row.solver}, {row.kind}, seed {row.seed}: {row.error}" for row in failed.itertuples()]
    return Outcome(
        verdict,
        (
            Shown("By kind", by_kind, ("Intervals in brackets are 95 % (Clopper and Pearson).",)),
            Shown("Single effects by strength", by_strength, ("Strength: effect over noise, rms, where it acts.",)),
            Shown("Beside rivals", solvers, ("All on the same parts; a rival without names has no rate of names.",)),
            Shown("Each mechanism", each),
            Shown("Where it was wrong", wrong),
        ),
        tuple(differs),
    )


def rates(rows: pd.DataFrame) -> dict[str, Any]:
    """Figures of some judged rows: shares with their intervals, medians, counts."""
    return {
        "cases": len(rows),
        "right first": _share(rows["first"]),
        "all found": _share(rows["found"]),
        "first or its alternative": _share(rows["listed"]),
        "kind right": _share(rows["kind_right"]),
        "any finding": _share(rows["claims"] > 0),
        "false per case": round(float(rows["false"].mean()), 2),
        "auc": _median(rows["auc"]),
        "removed": _median(rows["removed"]),
        "covered": _count(int(rows["covered"].sum()), int(rows["of"].sum())),
        "seconds": round(float(rows["seconds"].median()), 1),
    }


def _versus(rows: pd.DataFrame) -> dict[str, Any]:
    physics = rows[rows["group"].isin(["single", "pair", "confined to a region", "outside the vocabulary"])]
    clean = rows[rows["group"] == "clean"]
    strong = rows[(rows["group"] == "single") & (rows["strength"] >= 1)]
    return {
        "single first, strength >= 1": _share(strong["first"]),
        "right first": _share(rows["first"]),
        "all found": _share(rows["found"]),
        "clean with a finding": _share(clean["claims"] > 0),
        "false per case": round(float(rows["false"].mean()), 2),
        "auc": _median(physics["auc"]),
        "removed": _median(physics["removed"]),
        "covered": _count(int(rows["covered"].sum()), int(rows["of"].sum())),
        "seconds": round(float(rows["seconds"].median()), 1),
    }


def _share(values: pd.Series) -> str:
    known = values.dropna()
    return _count(int(known.astype(bool).sum()), len(known))


def _count(hits: int, of: int) -> str:
    """'0.90 [0.55-1.00] of 10'."""
    if not of:
        return "–"
    low, high = binomtest(hits, of).proportion_ci()
    return f"{hits / of:.2f} [{low:.2f}-{high:.2f}] of {of}"


def _median(values: pd.Series) -> float | None:
    known = values.dropna()
    return round(float(known.median()), 3) if len(known) else None


def code_digest() -> str:
    """Digest of everything that decides a row."""
    package, text = Path(__file__).parents[1], hashlib.sha256()
    for folder in ("core", "physics", "process", "feature_space", "equations", "recordings", "synthetic", "diagnosis"):
        for path in sorted((package / folder).rglob("*.py")):
            text.update(path.read_bytes())
    for name in ("concealed.py", "concealed_rivals.py", "judged.py"):
        text.update(Path(__file__).with_name(name).read_bytes())
    return text.hexdigest()[:10]


def solvers_named(names: Sequence[str]) -> dict[str, Solver]:
    """The tool and the rivals, by name."""
    from pido.experiments.concealed_rivals import RIVALS

    return {name: tool if name == TOOL else RIVALS[name] for name in names}


if __name__ == "__main__":
    kind, strength, seed = json.loads(sys.argv[1])
    print(json.dumps(solve_case(Task(kind, strength, seed), Path(sys.argv[2]), solvers_named(sys.argv[3].split(",")))))
