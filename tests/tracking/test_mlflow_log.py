"""Iterations in MLflow: everything an engineer asks for, once, whatever is repeated or was cut off."""

from __future__ import annotations

import shutil
import sqlite3
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up

from pido import plain
from pido.cli.iterate import command as iterate
from pido.cli.status import command as status
from pido.core.axes import AXES
from pido.recordings.folder import write_folder
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.tracking.log import log_pending
from pido.tracking.mirror import reconcile
from pido.tracking.mlflow_store import BUNDLE, KEY, OWNER, client, experiment, model_names
from pido.workspace import Workspace

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
MACHINE = "cmx600v"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Workspace:
    root: Path = tmp_path_factory.mktemp("plant")
    (root / "workspace.toml").write_text("[method]\nadaptive = false\ncompare_with_model = false\n")
    place = Workspace.open(root)
    for part in made_up(2):
        folder = write_folder(part.rows(slice(0, 600)), root / "given" / part.part.part)
        answer = plain.run(place, [folder], None, lambda done, total, what: None)
        assert answer["fault"] == ""
    return place


def finished_runs(workspace: Workspace) -> list:
    with client(workspace) as store:
        return store.search_runs([experiment(workspace, store, MACHINE)], "attributes.status = 'FINISHED'")


def forget_that_it_was_logged(workspace: Workspace) -> None:
    with sqlite3.connect(workspace.ledger) as db:
        db.execute("UPDATE iterations SET logged = ''")
    db.close()


def versions(workspace: Workspace) -> dict[str, list]:
    with client(workspace) as store:
        return {n: store.search_model_versions(f"name = '{n}'") for n in model_names(MACHINE).values()}


def test_a_run_holds_data_sets_parameters_metrics_figures_and_four_models(workspace):
    run = max(finished_runs(workspace), key=lambda r: int(r.data.tags["pido.version"]))
    for axis in ("x", "y", "z", "sp"):
        for trained_on in ("real", "pia", "pie", "both", "constant", "friction line", "nearest commands"):
            for measure in ("rmse", "r2", "mae", "error_99"):
                assert f"{measure}_{axis}/{trained_on}" in run.data.metrics
    assert {"balance/before", "balance/after", "rows/real", "rows/pia", "rows/pie"} <= set(run.data.metrics)
    assert run.data.params["seed"] == "0"
    assert "| constant | friction line | nearest commands | recorded rows |" in run.data.tags["mlflow.note.content"]
    logged = {i.dataset.name: i for i in run.inputs.dataset_inputs}
    assert "real" in logged
    assert len(run.data.tags["pido.data.real"]) == 64
    with client(workspace) as store:
        files = {Path(f.path).name for f in store.list_artifacts(run.info.run_id, "iteration")}
        # What is measured is a run's: the errors are those of models before the part, not of the ones logged here.
        assert not any(store.get_logged_model(o.model_id).metrics for o in run.outputs.model_outputs)
    assert {"balance.png", "errors.png", "part.png", "bins.csv", "summary.json"} <= files
    assert [len(v) for v in versions(workspace).values()] == [2, 2, 2, 2]


def test_a_registered_model_has_signature_and_example_and_predicts_as_the_bundle_does(workspace):
    from mlflow.models import get_model_info

    with client(workspace) as store:
        name = model_names(MACHINE)["x"]
        found = store.get_model_version_by_alias(name, "challenger")
        info = get_model_info(f"models:/{name}/{found.version}")
    assert info.signature.inputs.input_names()[0] == "v_x"
    assert info.saved_input_example_info is not None


def test_logging_again_makes_no_new_run_and_no_new_version(workspace):
    before = {r.info.run_id for r in finished_runs(workspace)}
    forget_that_it_was_logged(workspace)
    log_pending(workspace)
    assert {r.info.run_id for r in finished_runs(workspace)} == before
    assert [len(v) for v in versions(workspace).values()] == [2, 2, 2, 2]


def test_a_run_that_was_cut_off_is_replaced_by_a_whole_one(workspace):
    victim = finished_runs(workspace)[0]
    with client(workspace) as store:
        store.update_run(victim.info.run_id, status="RUNNING")
    forget_that_it_was_logged(workspace)
    log_pending(workspace)
    after = finished_runs(workspace)
    assert len(after) == 2
    assert len({r.data.tags[KEY] for r in after}) == 2
    assert victim.info.run_id not in {r.info.run_id for r in after}
    assert [len(v) for v in versions(workspace).values()] == [2, 2, 2, 2]


def test_two_workspaces_in_one_process_keep_their_own_runs(workspace, tmp_path):
    other = Workspace.open(tmp_path)
    with client(workspace), client(other) as store:
        assert other.tracking_uri != workspace.tracking_uri
        assert store.get_experiment_by_name(f"pido {MACHINE}") is None


def test_the_aliases_follow_what_is_in_force_in_the_workspace(workspace, monkeypatch):
    passed = Ledger(workspace.ledger).versions(MACHINE)
    with sqlite3.connect(workspace.ledger) as db:
        db.execute('UPDATE versions SET gate = \'{"passed": true, "words": "set by this test"}\'')
    db.close()
    promotion.approve(workspace, MACHINE, passed[0].version, by="A. Ito", reason="a test")
    for _ in range(2):
        reconcile(workspace, MACHINE)
        with client(workspace) as store:
            for name in model_names(MACHINE).values():
                number = {a: store.get_model_version_by_alias(name, a).tags["pido.version"] for a in
                          ("champion", "challenger")}  # fmt: skip
                assert number == {"champion": "1", "challenger": "2"}


def aliases(place: Workspace, name: str) -> dict[str, str]:
    """Alias -> the bundle that it points at."""
    with client(place) as store:
        (model,) = store.search_registered_models(f"name = '{name}'")
        return {a: store.get_model_version_by_alias(name, a).tags[BUNDLE] for a in model.aliases}


def copy_on(server: str, workspace: Workspace, root: Path, seed: int) -> Workspace:
    """Another workspace with the same parts and other models, that logs to a server with others."""
    skipped = shutil.ignore_patterns("mlflow.db", "mlartifacts", "workspace.id", "registry")
    shutil.copytree(workspace.root, root, ignore=skipped)
    settings = root / "workspace.toml"
    settings.write_text(f'seed = {seed}\ntracking_uri = "{server}"\n{settings.read_text()}')
    place = Workspace.open(root)
    with sqlite3.connect(place.ledger) as db:
        db.executescript("DELETE FROM iterations; DELETE FROM versions")
    db.close()
    assert plain.retrain_all(place, lambda *a: None)["fault"] == ""
    return place


@pytest.mark.thorough
@pytest.mark.parametrize("older", [False, True])
def test_workspaces_with_machines_of_one_name_on_one_server_have_models_and_aliases_of_their_own(
    workspace, tmp_path, older
):
    server = f"sqlite:///{tmp_path / 'shared.db'}"
    first = copy_on(server, workspace, tmp_path / "first", 1)
    if older:  # which did not write down whose an experiment is
        with sqlite3.connect(tmp_path / "shared.db") as db:
            db.execute("DELETE FROM experiment_tags WHERE key = ?", (OWNER,))
        db.close()
    second = copy_on(server, workspace, tmp_path / "second", 2)
    bundles = []
    for place, names in ((first, model_names(MACHINE)), (second, model_names(MACHINE, f"-{second.id}"))):
        (version,) = Ledger(place.ledger).versions(MACHINE)
        bundles.append(version.bundle)
        for name in names.values():
            assert aliases(place, name) == {"challenger": version.bundle}
        Ledger(place.ledger).judged(MACHINE, 1, {"passed": True, "words": "set by this test"})
        promotion.approve(place, MACHINE, 1, by="A. Ito", reason="a test")
        reconcile(place, MACHINE)
    for bundle, ending in zip(bundles, ("", f"-{second.id}"), strict=True):
        for name in model_names(MACHINE, ending).values():
            assert aliases(first, name) == {"champion": bundle}
    with client(first) as store:
        assert experiment(first, store, MACHINE) == store.get_experiment_by_name(f"pido {MACHINE}").experiment_id
    with client(second) as store:
        (run,) = store.search_runs([experiment(second, store, MACHINE)])
    assert run.data.tags[OWNER] == second.id


def test_a_server_that_is_named_later_gets_the_past_too_and_what_is_gone_holds_up_nothing(workspace, tmp_path):
    root = tmp_path / "moving"
    shutil.copytree(workspace.root, root)
    embedded, ask = (root / "workspace.toml").read_text(), ["--workspace", str(root)]
    for number, there in enumerate((2, 1)):  # iterations whose files are there
        place = Workspace.open(root)
        if there == 1:
            shutil.rmtree(place.runs / Ledger(place.ledger).iterations(MACHINE)[0].run_key)
        server = f"sqlite:///{tmp_path / str(number)}.db"
        (root / "workspace.toml").write_text(f'tracking_uri = "{server}"\n{embedded}')
        place = Workspace.open(root)
        assert "2 iteration(s) are not in MLflow where" in CliRunner().invoke(status, ask).output
        said = CliRunner().invoke(iterate, ask)
        assert said.exit_code == 0
        assert ("1 iteration(s) cannot be logged, version 1" in said.stderr) == (there == 1)
        assert len(finished_runs(place)) == there
        assert [len(v) for v in versions(place).values()] == [there] * 4
        assert len(Ledger(place.ledger).not_logged(place.tracking_place)) == 2 - there
        standing = {s.state: s.version.bundle for s in promotion.standings(place, MACHINE)}
        challenger = {"challenger": standing["challenger"]} if "challenger" in standing else {}
        assert challenger.items() <= aliases(place, model_names(MACHINE)["x"]).items()
    (root / "workspace.toml").write_text(embedded)
    assert CliRunner().invoke(iterate, ask).exit_code == 0
    assert len(finished_runs(Workspace.open(root))) == 2, "they were there already"


def test_a_ledger_of_an_older_version_does_not_say_where_and_nothing_is_logged_twice(workspace):
    before = {run.info.run_id for run in finished_runs(workspace)}
    with sqlite3.connect(workspace.ledger) as db:
        db.execute("ALTER TABLE iterations DROP COLUMN place")
    db.close()
    ledger = Ledger(workspace.ledger)
    assert len(ledger.not_logged(workspace.tracking_place)) == 2
    log_pending(workspace)
    assert ledger.not_logged(workspace.tracking_place) == []
    assert {run.info.run_id for run in finished_runs(workspace)} == before
    assert {one.logged for one in ledger.iterations(MACHINE)} == before


def test_a_server_that_is_away_holds_no_iteration_up(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    (tmp_path / "workspace.toml").write_text(
        'tracking_uri = "http://127.0.0.1:9"\n[method]\nadaptive = false\ncompare_with_model = false\n'
    )
    place = Workspace.open(tmp_path)
    part = next(made_up(1)).rows(slice(0, 600))
    answer = plain.run(place, [write_folder(part, tmp_path / "given" / "p")], None, lambda *a: None)
    assert [one["version"] for one in answer["done"]] == [1]
    assert "127.0.0.1" in answer["fault"]
    assert len(Ledger(place.ledger).not_logged(place.tracking_place)) == 1


def test_who_does_not_know_pido_reads_on_mlflows_pages_what_is_what(workspace):
    run = finished_runs(workspace)[0]
    with client(workspace) as store:
        about = store.get_experiment(experiment(workspace, store, MACHINE)).tags["mlflow.note.content"]
        models = {axis: store.get_registered_model(name) for axis, name in model_names(MACHINE).items()}
        newest = store.search_model_versions(f"name = '{model_names(MACHINE)['sp']}'")[0]
    words = run.data.tags["mlflow.note.content"]
    for name in run.data.metrics:
        group, _, which = name.partition("/")
        measure = group.rsplit("_", 1)[0] if group.rsplit("_", 1)[-1] in AXES else group
        assert measure in words or group == "rows", f"{name} is not explained"
        assert group in ("balance", "seconds", "rows") or which in words, f"{name} is not explained"
        assert measure in about or group == "rows"
    assert all(f"{each.dataset.name}" in words for each in run.inputs.dataset_inputs)
    assert MACHINE in about
    assert "pido approve" in about
    assert "Motor current of the spindle of machine cmx600v in A" in models["sp"].description
    assert "Motor current of axis x of" in models["x"].description
    assert newest.description.startswith("Version 2, the spindle after part demo-02. Gate, over all axes: ")


def test_models_and_equations_are_compressed_on_disk_in_the_bundle_and_in_mlflow(workspace):
    """Uncompressed they were three times as large, and most of what an iteration leaves."""
    bundles = [*workspace.bundles.rglob("*.skops"), *workspace.bundles.rglob("equations.npz")]
    logged = list((workspace.root / "mlartifacts").rglob("*.skops"))
    assert bundles
    assert logged
    for file in [*bundles, *logged]:
        with zipfile.ZipFile(file) as archive:
            inside = archive.infolist()
        assert sum(one.compress_size for one in inside) < 0.6 * sum(one.file_size for one in inside), file
