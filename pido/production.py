"""Production at the edge: each stage of an iteration as load, call, save. `pido iterate`, watcher and flow share it.

In:  a workspace's folder, and digests or keys. Out: files in the workspace, facts in the ledger.

A stage writes its result whole or not at all and can be done again; nothing counts before `publish` has written it to
the ledger in one transaction. Whatever is killed, the next call takes up from there with the same result.

    ingest -> begin -> bins -> refit -> balance -> retrain -> evaluate -> publish -> log
"""

from __future__ import annotations

import io
import json
import logging
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pido import accepted, iteration
from pido.comparison import clock, making_of, models_in, verdict
from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.core.errors import PidoError, SettingsFileError, StoreError
from pido.core.files import write_atomically
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, Samples
from pido.files import equations as equation_files
from pido.files.samples import frame, load_samples, samples_digest, save_samples
from pido.iteration import VARIANTS, Recipe
from pido.models.axis_models import Trained
from pido.models.inputs import NAMES, InputKind, model_inputs
from pido.models.metrics import metrics
from pido.monitoring.standing import other_end
from pido.parts import entry_of, ingest, machine_of, recipe_of, samples_of, samples_path
from pido.rows import training_rows
from pido.sampling.method import Adaptation
from pido.store import Store
from pido.tracking import bundle, mirror, model_files, whereabouts
from pido.tracking.ledger import Ledger
from pido.tracking.report_files import OTHER_END, RunFiles
from pido.tracking.withdrawn import withdrawn
from pido.withdrawal import settle
from pido.workspace import Workspace, code_version, digest_of

__all__ = ["STAGES", "begin", "clear", "done", "every_machine", "ingest", "log", "machines", "models_in", "outcome"]
log_ = logging.getLogger(__name__)

BEFORE, ALL = "before", "all"
"""The two sets of an iteration: parts known before the arriving one, and all of them."""


class _Place:
    """One iteration on its way: its plan, its folder, and what every stage needs from the settings."""

    def __init__(self, root: str, key: str) -> None:
        self.folder = Workspace.open(root).work / key
        try:
            self.plan: dict[str, Any] = json.loads((self.folder / "plan.json").read_text(encoding="utf-8"))
        except OSError:
            raise StoreError(f"{self.folder}: no such iteration is on its way; begin it first.") from None
        workspace = Workspace.open(root, **self.plan.get("settings", {}))  # older plans have none
        self.workspace = workspace.excluding(self.plan["machine"], self.plan["excluded"])
        if self.workspace.run_key(self.plan["machine"], self.plan["parts"]) != key:
            raise SettingsFileError(
                f"{root}: a setting, a file that settings name (job, machines, materials), accepted physics or the "
                "program was changed while an iteration was on its way, which would be half of each. Nothing of it was "
                "published: run it again."
            )
        self.machine: Machine = machine_of(self.workspace, self.plan["machine"])
        self.accepted = accepted.terms(self.workspace, self.machine)
        recipe = recipe_of(self.workspace)
        self.recipe: Recipe = replace(recipe, extended=accepted.term_sets(self.accepted, recipe.method.adaptive))
        self.seed = self.workspace.settings.seed

    def parts(self, which: str) -> list[str]:
        """Digests in production order."""
        everything, arriving = self.plan["parts"], self.plan["part"]
        return everything if which == ALL else [d for d in everything if d != arriving]

    def sets(self) -> list[str]:
        """The sets that this iteration fits: the first part has nothing before it."""
        return [ALL] if len(self.plan["parts"]) == 1 else [BEFORE, ALL]

    def rows(self, which: str, count: int | None = None) -> Samples:
        """Real rows of a set, or of its first `count` parts in production order to choose equations on; crowded bins
        are thinned where there are more rows than the settings allow."""
        method = self.workspace.settings.method
        limit = method.rows_max if count is None else method.rows_max_choice
        return training_rows(self.workspace, self.plan["machine"], self.parts(which)[:count], limit)

    def path(self, which: str) -> Samples:
        """The path that rows are balanced for: the arriving part's, or the newest part's."""
        return samples_of(self.workspace, self.plan["part"] if which == BEFORE else self.plan["parts"][-1])

    def adaptation(self, which: str) -> Adaptation:
        return equation_files.load((self.folder / f"adaptation-{which}.npz").read_bytes(), self.machine, self.accepted)

    def weights(self, which: str) -> np.ndarray:
        """(n, 4): of the generated rows in the loss."""
        return np.load(self.folder / f"weights-{which}.npy", allow_pickle=False)

    def generated(self, which: str) -> Samples:
        return load_samples(self.folder / f"generated-{which}.parquet")

    def facts(self, name: str) -> dict[str, Any]:
        return json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))

    def write(self, name: str, facts: dict[str, Any]) -> None:
        write_atomically(self.folder / f"{name}.json", json.dumps(facts, sort_keys=True))


@lru_cache(maxsize=2)
def _trained(folder: Path, which: str) -> Trained:
    """Models that the stages of an iteration share while they run in one process; in another they are trained again."""
    return Trained()


Stage = Callable[[str, str], None]


def _stage(work: Callable[[_Place], None]) -> Stage:
    """A stage by folder and key; how long it took is written beside its result."""

    @wraps(work)
    def run(root: str, key: str) -> None:
        start = time.perf_counter()
        place = _Place(root, key)
        work(place)
        place.write(f"seconds-{work.__name__}", {"seconds": time.perf_counter() - start})
        log_.info("%s: %.2f s", work.__name__, time.perf_counter() - start)

    del run.__wrapped__  # its signature is (root, key), not that of the work
    return run


def begin(root: str, machine: str, part: str | None) -> str:
    """Plan an iteration and return its key. `part`: the arriving one; None, or one that went through an iteration
    before, retrains on what is known, and the newest part in production order is what the models are compared on.

    The parts are those that went through an iteration already, and the arriving one: a part that was only put into
    the store waits for its own turn, and one that was withdrawn is none of them. What people said not to learn from and
    the settings are fixed here, for all stages: an answer that comes meanwhile, or a change of `workspace.toml`, counts
    for the next iteration.
    """
    workspace = Workspace.open(root)
    excluded = workspace.excluded(machine)
    workspace = workspace.excluding(machine, excluded)
    settle(workspace, machine)
    ledger = Ledger(workspace.ledger)
    before = ledger.parts(machine)
    known = {*before, *([part] if part else [])}
    order = [e.digest for e in Store(workspace.store).entries() if e.digest in known]
    if not order:
        none = "only parts that are withdrawn" if known else "no parts yet"
        raise StoreError(f"{workspace.root}: machine '{machine}' has {none}. Bring one in with `pido iterate PART`.")
    key = workspace.run_key(machine, order)
    if ledger.iteration(key) is not None:
        return key
    for stale in workspace.work.glob("*") if workspace.work.exists() else ():
        plan = stale / "plan.json"
        if stale.name != key and plan.exists() and json.loads(plan.read_text())["machine"] == machine:
            shutil.rmtree(stale)  # the machine's lock is ours: nobody works there any more
    arriving = part if part in order and part not in before else order[-1]
    elsewhere = {"tracking_uri", "tracking_page", "approval_token_sha256"}  # decide nothing of what is found
    settings = workspace.settings.model_dump(mode="json", exclude=elsewhere)
    plan = {"machine": machine, "part": arriving, "parts": order, "excluded": excluded, "settings": settings}
    write_atomically(workspace.work / key / "plan.json", json.dumps(plan))
    return key


def done(root: str, key: str) -> bool:
    """Whether this state is known already."""
    return Ledger(Workspace.open(root).ledger).iteration(key) is not None


@_stage
def bins(place: _Place) -> None:
    """The bins that the arriving and the coming part need."""
    for which in place.sets():
        write_atomically(place.folder / f"bins-{which}.npy", _npy(iteration.relevant(place.path(which), place.recipe)))


@_stage
def refit(place: _Place) -> None:
    """Equations and share rules, judged on rows left out. What was found for a set of parts is kept."""
    for which in place.sets():
        count = iteration.rests_on(len(place.parts(which)))
        key = place.workspace.run_key(place.plan["machine"], place.parts(which)[:count])
        kept = place.workspace.derived / f"adaptation-{key}.npz"
        if not kept.exists():
            found = iteration.refit(place.rows(which, count), place.machine, place.recipe, place.seed)
            write_atomically(kept, equation_files.dump(found))
        write_atomically(place.folder / f"adaptation-{which}.npz", kept.read_bytes())


@_stage
def balance(place: _Place) -> None:
    """PiA and PiE rows, and the equations that they come from."""
    for which in place.sets():
        rows = place.rows(which)
        found = iteration.balance(
            rows, place.path(which), place.adaptation(which), place.machine, place.recipe, place.seed,
            _trained(place.folder, which),
        )  # fmt: skip
        save_samples(found.generated, place.folder / f"generated-{which}.parquet")
        write_atomically(place.folder / f"weights-{which}.npy", _npy(found.weights))
        write_atomically(place.folder / f"equations-{which}.npz", equation_files.dump(found.equations))
        centre, before, after = iteration.bins_before_and_after(found, rows, place.recipe.method.grid)
        table = pd.DataFrame(centre, columns=["v_x", "v_y", "ar"]).assign(before=before, after=after)
        table.to_parquet(place.folder / f"table-{which}.parquet", index=False)
        place.write(
            f"balance-{which}",
            {"before": found.before, "after": found.after, "relevant_bins": len(found.needed),
             "report": found.report.summary()},
        )  # fmt: skip


@_stage
def retrain(place: _Place) -> None:
    """Models of before say what they expect of the arriving part; the challenger is trained on all parts."""
    if BEFORE in place.sets():
        rows, generated, weights = place.rows(BEFORE), place.generated(BEFORE), place.weights(BEFORE)
        said, trained = {}, _trained(place.folder, BEFORE)
        for variant in VARIANTS if place.workspace.settings.compare else ("both",):
            models = iteration.retrain(rows, generated, weights, variant, place.recipe, place.seed, trained)
            said[variant] = models.predict(place.path(BEFORE))
        _save_predictions(place.folder / "said.parquet", said)
        inputs = model_inputs(place.path(BEFORE), models.inputs)  # `both` is the last of the variants
        end = other_end(models.by_axis, inputs, place.machine)
        _save_predictions(place.folder / "other_end.parquet", {OTHER_END: end})
    models = iteration.retrain(
        place.rows(ALL), place.generated(ALL), place.weights(ALL), "both", place.recipe, place.seed,
        _trained(place.folder, ALL),
    )  # fmt: skip
    _trained.cache_clear()
    for axis, model in models.models.items():
        write_atomically(place.folder / f"{axis}.skops", model_files.dump(model))
    place.write("models", {"digests": models.digests(), "inputs": models.inputs, "names": list(models.input_names)})


@_stage
def evaluate(place: _Place) -> None:
    """Metrics beside the trivial rivals, and the gate's verdict."""
    found: dict[str, Any] = {"metrics": {}, "champion": None}
    if BEFORE in place.sets():
        path = place.path(BEFORE)
        said = iteration.rivals(path, place.rows(BEFORE)) | _load_predictions(place.folder / "said.parquet")
        found["metrics"] = _by_axis({name: metrics(path.currents, values) for name, values in said.items()})
    plan = place.plan
    making = making_of(place.workspace, plan["machine"], [term.name for term, _ in place.accepted])
    measured = {plan["part"]: found["metrics"]}
    found["gate"] = verdict(place.workspace, plan["machine"], plan["parts"], making, measured)
    place.write("evaluation", found)


@_stage
def publish(place: _Place) -> None:
    """Bundle, files of the run, and the ledger: from here on it counts."""
    workspace, plan = place.workspace, place.plan
    found, models = place.facts("evaluation"), place.facts("models")
    rows, generated = place.rows(ALL), place.generated(ALL)
    training = Samples.concat([rows, generated])
    settings = {"method": workspace.settings.method.model_dump(mode="json"), "seed": place.seed,
                "rate_hz": workspace.settings.rate_hz,
                "equations": iteration.words(place.adaptation(ALL))}  # fmt: skip
    equation = (place.folder / f"equations-{ALL}.npz").read_bytes()
    limits = {"inputs": {n: [float(v.min()), float(v.max())] for n, v in zip(INPUTS, rows.inputs.T, strict=True)},
              "rows": len(rows), "parts": len(plan["parts"])}  # fmt: skip
    files = {f"{axis}.skops": (place.folder / f"{axis}.skops").read_bytes() for axis in models["digests"]}
    example = _example(rows, models["names"])
    files |= {f"{axis}.example.json": example for axis in models["digests"]}
    files |= {"equations.npz": equation, "limits.json": json.dumps(limits, sort_keys=True).encode()}
    made = bundle.save(
        workspace.bundles,
        {
            "machine": plan["machine"], "parts": sorted(plan["parts"]), "data": samples_digest(training),
            "models": models["digests"], "inputs": models["inputs"], "equation": digest_of(equation.hex()),
            "limits": digest_of(limits), "settings": workspace.settings_digest(plan["machine"]), "seed": place.seed,
            "code": code_version(),
        },
        files,
    )  # fmt: skip
    name = entry_of(workspace, plan["part"]).part
    summary = {
        "run_key": place.folder.name,
        "machine": plan["machine"],
        "part": {"digest": plan["part"], "name": name},
        "parts": plan["parts"],
        "withdrawn": [record.name for record in withdrawn(workspace, plan["machine"]).values()],
        "settings": settings,
        "seed": place.seed,
        "code": code_version(),
        "bundle": made.digest,
        "data": _data(place, rows, generated),
        "balance": place.facts(f"balance-{ALL}"),
        "metrics": found["metrics"],
        "gate": found["gate"],
        "physics": iteration.physics(place.adaptation(ALL).choice, [term for term, _ in place.accepted]),
        "seconds": {f.stem.removeprefix("seconds-"): json.loads(f.read_text())["seconds"]
                    for f in sorted(place.folder.glob("seconds-*.json"))},
    }  # fmt: skip
    table = pd.read_parquet(place.folder / f"table-{ALL}.parquet")
    RunFiles(summary, frame(generated), table, _trace(place)).save(workspace.runs)
    version = Ledger(workspace.ledger).finished(
        place.folder.name, plan["machine"], plan["part"], name, made.digest, found["gate"],
        {k: summary[k] for k in ("part", "metrics", "gate", "balance", "physics", "withdrawn")}
        | {"n_parts": len(plan["parts"])},
    )  # fmt: skip
    log_.info("%s: version %d, %d part(s)", name, version, len(plan["parts"]))


STAGES: tuple[Stage, ...] = (bins, refit, balance, retrain, evaluate, publish)
"""What is done between `begin` and `log`, in this order."""


def log(root: str) -> dict[str, Any]:
    """Bring MLflow up to the ledger. Where it cannot be reached, files are gone, or nobody says where it is now, the
    answer says so in a sentence, and the next call tries again."""
    workspace = Workspace.open(root)
    if fault := whereabouts.named_nowhere(workspace):
        log_.warning("%s", fault)
        return {"logged": 0, "fault": fault}
    if mirror.up_to_date(workspace):
        whereabouts.remember(workspace)
        return {"logged": 0, "fault": ""}
    from pido.tracking.log import try_log_pending

    logged, fault = try_log_pending(workspace)
    if fault:
        log_.warning("%s", fault)
    return {"logged": logged, "fault": fault}


def on_its_way(root: str, key: str) -> bool:
    """Whether an iteration was begun and not cleared away: what it found may be published, and not told yet."""
    return (Workspace.open(root).work / key).exists()


def clear(root: str, key: str) -> None:
    """Remove what an iteration needed on its way."""
    shutil.rmtree(Workspace.open(root).work / key, ignore_errors=True)


def outcome(root: str, key: str) -> dict[str, Any]:
    """What an iteration found: part, version, metrics, gate, balance, n_parts."""
    found = Ledger(Workspace.open(root).ledger).iteration(key)
    if found is None:
        raise StoreError(f"{root}: iteration {key[:12]} is not in the ledger.")
    return {**found.summary, "version": found.version, "run_key": key, "machine": found.machine}


def machines(root: str) -> list[str]:
    """Machines that have parts."""
    return Ledger(Workspace.open(root).ledger).machines()


def every_machine(root: str, work: Callable[[str], Any], log: Callable[[str], dict[str, Any]]) -> tuple[list[Any], str]:
    """(What `work` returns for each machine that has parts, why MLflow has not got all of it or ''). One machine that
    fails holds up neither the others nor what MLflow has missed.

    Raises PidoError at the end, with each machine that failed and why.
    """
    found, faults = [], []
    for machine in machines(root):
        try:
            found.append(work(machine))
        except Exception as error:  # a bug, too, costs one machine only; its traceback is kept here
            deliberate = isinstance(error, PidoError)
            log_.error("%s: %s", machine, error, exc_info=None if deliberate else error)
            faults.append(f"  {machine}: {error if deliberate else repr(error)}")
    fault = log(root)["fault"]
    if faults:
        raise PidoError(f"{root}: {len(faults)} machine(s) failed, and no other:\n" + "\n".join(faults))
    return found, fault


def _by_axis(found: dict[str, dict[str, Any]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """axis -> variant -> measures; axes without current are left out, a measure that is not defined is None."""
    result: dict[str, dict[str, dict[str, float | None]]] = {}
    for variant, axes in found.items():
        for axis, measured in axes.items():
            if measured.n:
                values = {k: (float(v) if np.isfinite(v) else None) for k, v in measured.as_dict().items()}
                result.setdefault(axis, {})[variant] = values
    return result


def _data(place: _Place, rows: Samples, generated: Samples) -> dict[str, Any]:
    files = [str(samples_path(place.workspace, d).relative_to(place.workspace.root)) for d in place.parts(ALL)]
    result: dict[str, Any] = {"real": {"digest": samples_digest(rows), "rows": len(rows), "files": files}}
    for name, origin in (("pia", PIA), ("pie", PIE)):
        part = generated.take(generated.origin == origin)
        result[name] = {"digest": samples_digest(part), "rows": len(part)}
    return result


def _trace(place: _Place) -> pd.DataFrame:
    if BEFORE not in place.sets():
        return pd.DataFrame({"time": []})
    path, said = place.path(BEFORE), _load_predictions(place.folder / "said.parquet")
    said |= _load_predictions(place.folder / "other_end.parquet")
    columns = {"time": clock(place.workspace, path)}
    for i, axis in enumerate(AXES):
        columns[f"measured_{axis}"] = path.currents[:, i]
        columns |= {f"{name}_{axis}": values[:, i] for name, values in said.items()}
    return pd.DataFrame(columns)


def _save_predictions(path: Path, said: dict[str, np.ndarray]) -> None:
    columns = {f"{name}|{axis}": values[:, i] for name, values in said.items() for i, axis in enumerate(AXES)}
    pd.DataFrame(columns).to_parquet(path, index=False)


def _load_predictions(path: Path) -> dict[str, np.ndarray]:
    table = pd.read_parquet(path)
    names = dict.fromkeys(column.split("|")[0] for column in table.columns)
    return {name: table[[f"{name}|{axis}" for axis in AXES]].to_numpy(float) for name in names}


def _example(rows: Samples, names: list[str]) -> bytes:
    kind: InputKind = next(k for k, known in NAMES.items() if list(known) == names)
    few = model_inputs(rows.take(slice(0, 5)), kind)
    return json.dumps({"columns": names, "index": list(range(len(few))), "data": few.tolist()}).encode()


def _npy(values: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=False)
    return buffer.getvalue()
