"""One iteration into MLflow: data sets, settings, metrics, figures, four models, a registered version.

In:  an iteration that is finished in the ledger, its files and its bundle.
Out: exactly one MLflow run with its run key as a tag, one version per axis model, alias `challenger`; the run's id.

Whatever was killed on the way, doing it again ends in the same state: a finished run with this key is kept, an
unfinished one is removed with what it registered and written anew.
"""

from __future__ import annotations

import json
import logging
import tempfile
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from pido.core.axes import AXES
from pido.core.columns import CURRENT
from pido.core.errors import PidoError, RegistryError, StoreError
from pido.reports.iteration import iteration_page
from pido.reports.page import write_page
from pido.tracking import descriptions, model_files, report_files
from pido.tracking.bundle import Bundle, load
from pido.tracking.fate import fate
from pido.tracking.figures import figures, table
from pido.tracking.ledger import Iteration, Ledger
from pido.tracking.mirror import behind, reconcile
from pido.tracking.mlflow_store import (
    BUNDLE,
    KEY,
    OWNER,
    VERSION,
    client,
    ending,
    experiment,
    model_names,
    not_installed,
)
from pido.tracking.report_files import RunFiles
from pido.tracking.whereabouts import remember
from pido.workspace import Workspace

if TYPE_CHECKING:
    from mlflow import MlflowClient

log = logging.getLogger(__name__)


def log_pending(workspace: Workspace) -> int:
    """Log every finished iteration that MLflow has not got yet, oldest first, and bring the aliases up to date. Where
    MLflow is at another address than before, that is all of them.

    Returns how many were logged. Raises whatever MLflow raises when it cannot be reached; nothing is lost by that. At
    the end, StoreError with the iterations whose files are gone: they hold up no other. What derives is made anew.
    """
    ledger, place = Ledger(workspace.ledger), workspace.tracking_place
    gone: list[str] = []
    # One at a time: a second one would take the first one's unfinished run for what a kill has left.
    with workspace.lock("log"):
        pending = ledger.not_logged(place)
        for iteration in pending:
            try:
                ledger.logged(iteration.run_key, log_iteration(workspace, iteration), place)
            except (StoreError, RegistryError, FileNotFoundError) as error:
                gone.append(f"version {iteration.version} of {iteration.machine}: {error}")
    machines = {iteration.machine for iteration in pending}
    for machine in ledger.machines():
        if machine in machines or behind(workspace, machine):
            reconcile(workspace, machine)
    remember(workspace)
    if gone:
        raise StoreError(f"{len(gone)} iteration(s) cannot be logged, {gone[0]}")
    return len(pending)


def try_log_pending(workspace: Workspace) -> tuple[int, str]:
    """`log_pending`; where MLflow cannot be reached, or files are gone: (0, why, a sentence), and what it has not got
    waits for the next call."""
    if missing := not_installed():
        return 0, f"{missing}; nothing is lost, it is logged later"
    from mlflow.exceptions import MlflowException

    try:
        return log_pending(workspace), ""
    except StoreError as error:
        return 0, str(error).splitlines()[0]
    except (MlflowException, OSError) as error:
        return 0, f"MLflow has not taken it ({str(error).splitlines()[0]}); nothing is lost, it is logged later"


def log_iteration(workspace: Workspace, iteration: Iteration) -> str:
    """The id of the MLflow run of this iteration, which is written if it is not there."""
    with client(workspace) as store, warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="mlflow")
        # MLflow tries the input example, which has names, on an estimator that was fitted on plain arrays
        warnings.filterwarnings("ignore", message="X has feature names")
        place = experiment(workspace, store, iteration.machine)
        if finished := _earlier(store, place, iteration):
            return finished
        files = report_files.load(workspace.runs, iteration.run_key)
        bundle = load(workspace.bundles, files.summary["bundle"])
        return _write(workspace, store, place, iteration, files, bundle)


def _earlier(store: MlflowClient, place: str, iteration: Iteration) -> str | None:
    """The finished run with this key, if there is one; unfinished ones are removed."""
    for run in store.search_runs([place], f"tags.`{KEY}` = '{iteration.run_key}'"):
        if run.info.status == "FINISHED":
            return run.info.run_id
        for version in store.search_model_versions(f"run_id = '{run.info.run_id}'"):
            store.delete_model_version(version.name, version.version)
        store.delete_run(run.info.run_id)
    return None


def _write(
    workspace: Workspace, store: MlflowClient, place: str, iteration: Iteration, files: RunFiles, bundle: Bundle
) -> str:
    import mlflow
    from mlflow.entities import Metric

    summary = files.summary
    tags = {
        KEY: iteration.run_key,
        VERSION: str(iteration.version),
        "pido.machine": iteration.machine,
        "pido.part": summary["part"]["name"],
        "pido.part_digest": summary["part"]["digest"],
        BUNDLE: summary["bundle"],
        OWNER: workspace.id,
        "pido.code": summary["code"],
        "pido.physics": ", ".join(summary.get("physics", {}).get("accepted", [])) or "none",
        **{f"pido.data.{name}": str(d["digest"]) for name, d in summary["data"].items()},
    }
    real, left_out = _real(workspace, summary)
    if left_out:
        tags["pido.left_out"] = left_out
        log.warning("version %d of %s: %s", iteration.version, iteration.machine, left_out)
    tags[descriptions.NOTE] = descriptions.of_run(summary, iteration.version) + (f"\n\n{left_out}" if left_out else "")
    run = store.create_run(place, run_name=f"{summary['part']['name']} -> v{iteration.version}", tags=tags)
    run_id = run.info.run_id
    with mlflow.start_run(run_id=run_id):
        mlflow.log_params({name: _param(value) for name, value in flat(summary["settings"]).items()})
        _log_data(workspace, files, real)
        with tempfile.TemporaryDirectory() as folder:
            for name, figure in figures(files).items():
                figure.savefig(Path(folder) / name, dpi=80)
            files.bins.to_csv(Path(folder) / "bins.csv", index=False)
            pd.DataFrame(table(summary["metrics"])).to_csv(Path(folder) / "errors.csv", index=False)
            (Path(folder) / "summary.json").write_text(json.dumps(summary, indent=1, sort_keys=True))
            mlflow.log_artifacts(folder, "iteration")
        with tempfile.TemporaryDirectory() as folder:
            done = Ledger(workspace.ledger).iterations(iteration.machine)
            earlier = [one.summary for one in done if one.version <= iteration.version]
            became = fate(workspace, iteration.machine, iteration.version)
            write_page(iteration_page(files, iteration.version, earlier, became), Path(folder) / "index.html")
            mlflow.log_artifacts(folder, "report")
        # Models before metrics: MLflow reads the history of every metric of the run again for each model it logs.
        _register(workspace, store, run_id, iteration, bundle)
        # Not `mlflow.log_metrics`: it would write each of them once more for each of the four models.
        now = int(time.time() * 1000)
        store.log_batch(run_id, [Metric(name, value, now, 0) for name, value in _metrics(summary).items()])
    log.info("logged %s as MLflow run %s, version %d", summary["part"]["name"], run_id, iteration.version)
    return run_id


def _real(workspace: Workspace, summary: dict[str, Any]) -> tuple[list[Path], str]:
    """(The files with the recorded rows, made anew where they are gone; why there are none, or '')."""
    from pido import parts

    files = [workspace.root / file for file in summary["data"]["real"]["files"]]
    gone = 0
    for file, part in zip(files, summary["parts"], strict=True):
        if file.exists():
            continue
        try:
            # Under today's settings and code it has a name of its own, and other rows.
            remade = parts.samples_path(workspace, part) == file and parts.rows_file(workspace, part).exists()
        except PidoError as error:
            log.warning("the rows of part %s cannot be made anew: %s", part[:12], error)
            remade = False
        gone += not remade
    if gone:
        return [], (
            f"Without its recorded rows, of which the digest is in the tag pido.data.real: {gone} of {len(files)} "
            f"files are gone from {workspace.derived}, and were made with other settings or another version."
        )
    return files, ""


def _log_data(workspace: Workspace, files: RunFiles, real: list[Path]) -> None:
    import mlflow

    from pido.files.samples import load_frame

    sets = dict(iter(files.generated.groupby("origin")))
    if real:
        sets["real"] = pd.concat([load_frame(path) for path in real], ignore_index=True)
    for name in ("real", "pia", "pie"):
        about = files.summary["data"][name]
        if name not in sets:
            continue  # nothing was generated, or it is gone: its digest and size stand in tags and metrics
        source = (
            workspace.runs / files.summary["run_key"] / "generated.parquet" if name != "real" else workspace.derived
        )
        frame = sets[name].select_dtypes("number").astype(float)
        data = mlflow.data.from_pandas(frame, source=source.as_uri(), name=name, digest=about["digest"][:36])  # type: ignore[attr-defined]
        mlflow.log_input(data, context="training", tags={"sha256": about["digest"], "rows": str(about["rows"])})


def _register(workspace: Workspace, store: MlflowClient, run_id: str, iteration: Iteration, bundle: Bundle) -> None:
    """Four models; a bundle that has its version already is not registered a second time."""
    import mlflow
    from mlflow.models import infer_signature

    own = {VERSION: str(iteration.version), BUNDLE: bundle.digest}
    tags = {**own, KEY: iteration.run_key, OWNER: workspace.id}
    for axis, name in model_names(iteration.machine, ending(workspace, store, iteration.machine)).items():
        if f"{axis}.skops" not in bundle.files or _registered(store, name, own):
            continue
        data = bundle.read(f"{axis}.skops")
        estimator = model_files.load(data)
        example = pd.read_json(bundle.folder / f"{axis}.example.json", orient="split").astype(float)
        answer = pd.DataFrame({CURRENT[axis]: estimator.predict(example.to_numpy())})
        with model_files.compressed():
            info = mlflow.sklearn.log_model(  # type: ignore[attr-defined]
                estimator,
                name=f"model_{axis}",
                signature=infer_signature(example, answer),
                input_example=example,
                serialization_format="skops",
                skops_trusted_types=list(model_files.trusted_types(data)),
                pip_requirements=model_files.requirements(),
            )
        if not store.search_registered_models(f"name = '{name}'"):
            store.create_registered_model(name, description=descriptions.of_model(axis, iteration.machine))
        store.create_model_version(
            name, source=info.model_uri, run_id=run_id, tags=tags, model_id=info.model_id,
            description=descriptions.of_version(axis, iteration.version, iteration.summary),
        )  # fmt: skip


def _registered(store: MlflowClient, name: str, tags: dict[str, str]) -> bool:
    """Whether a version with these tags is there."""
    return any(tags.items() <= v.tags.items() for v in store.search_model_versions(f"name = '{name}'"))


def _metrics(summary: dict[str, Any]) -> dict[str, float]:
    """`rmse_x/both` and the like: one group per measure and axis in MLflow's pages, one line per training set.

    RMSE of what was delivered comes first: MLflow shows metrics, and compares runs by the first, in this order.
    """
    values = {
        f"{measure}_{axis}/{name}": value
        for axis in AXES
        for name, measures in summary["metrics"].get(axis, {}).items()
        for measure, value in measures.items()
    }
    values |= {f"balance/{k}": summary["balance"][k] for k in ("before", "after", "relevant_bins")}
    values |= {f"rows/{name}": d["rows"] for name, d in summary["data"].items()}
    values |= {f"seconds/{name}": s for name, s in summary["seconds"].items()}
    for axis, error in summary.get("physics", {}).get("held_out", {}).items():
        values |= {f"accepted_physics_{axis}/{which}": rmse for which, rmse in error.items()}
    first = sorted(values, key=lambda name: (not name.startswith("rmse_"), not name.endswith("/both")))
    return {name: float(values[name]) for name in first if values[name] is not None}


def flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings with dotted names."""
    result: dict[str, Any] = {}
    for name, value in settings.items():
        result |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return result


def _param(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 500 else text[:480] + " … (in summary.json)"
