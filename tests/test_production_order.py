"""The state of a machine is a function of its set of parts: whatever the order, the interruptions, the repetitions."""

from __future__ import annotations

import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up

from pido import comparison, plain, production
from pido.approval import approve, refusal
from pido.cli import pido
from pido.core.errors import PidoError, SettingsFileError
from pido.core.samples import Samples
from pido.files.samples import load_samples, samples_digest, save_samples
from pido.iteration import iterate
from pido.parts import ingest, machine_of, recipe_of, samples_of, samples_path
from pido.recordings.folder import write_folder
from pido.supervision.book import Book
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

QUICK = {"adaptive": False, "leverage_quantile": None, "compare_with_model": False}


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> list[Path]:
    root = tmp_path_factory.mktemp("parts")
    short = [part.rows(slice(0, 700)) for part in made_up(3)]
    return [write_folder(part, root / part.part.part) for part in short]


@pytest.fixture
def without_mlflow(monkeypatch):
    monkeypatch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})


def workspace_at(root: Path) -> Workspace:
    place = root / "workspace.toml"
    root.mkdir(parents=True, exist_ok=True)
    lines = [f"{k} = {json.dumps(v)}" for k, v in QUICK.items() if v is not None]
    place.write_text("[method]\n" + "\n".join(lines) + "\n")
    return Workspace.open(root)


def run(workspace: Workspace, *paths: Path):
    answers = [plain.run(workspace, [path], None, lambda done, total, what: None) for path in paths]
    assert not [r for a in answers for r in a["rejected"]]
    return answers


def final_state(workspace: Workspace, machine: str = "cmx600v") -> dict:
    last = Ledger(workspace.ledger).versions(machine)[-1]
    return bundle.load(workspace.bundles, last.bundle).content


def test_parts_in_any_order_end_in_equal_training_sets_and_models(folders, tmp_path, without_mlflow):
    states = []
    for number, order in enumerate(itertools.islice(itertools.permutations(folders), 0, 6, 2)):
        workspace = workspace_at(tmp_path / str(number))
        run(workspace, *order)
        states.append(final_state(workspace))
    assert len(states[0]["parts"]) == 3
    assert len(states[0]["models"]) == 4
    assert states[1:] == states[:-1]


def test_stage_by_stage_over_files_is_the_same_iteration_as_one_plain_call(folders, tmp_path, without_mlflow):
    workspace = workspace_at(tmp_path / "plant")
    run(workspace, *folders[:2])
    state, order = final_state(workspace), Ledger(workspace.ledger).parts("cmx600v")
    samples = {digest: samples_of(workspace, digest) for digest in order}
    result = iterate(samples, order[-1], machine_of(workspace, "cmx600v"), recipe_of(workspace), seed=0)
    assert result.models.digests() == state["models"]
    assert samples_digest(Samples.concat([result.real, result.balanced.generated])) == state["data"]
    assert result.evaluation is not None
    measured = Ledger(workspace.ledger).iterations("cmx600v")[-1].summary["metrics"]
    for variant, axes in result.evaluation.metrics.items():
        for axis, found in axes.items():
            assert measured[axis][variant]["rmse"] == found.rmse


def test_a_version_judged_beside_another_champion_is_judged_again_beside_the_one_in_force(
    folders, tmp_path, without_mlflow
):
    workspace, who = workspace_at(tmp_path / "plant"), {"by": "A. Ito", "reason": "good parts"}
    run(workspace, *folders)
    _, second, third = Ledger(workspace.ledger).versions("cmx600v")
    for one in (second, third):  # both passed while nothing was in force
        Ledger(workspace.ledger).judged("cmx600v", one.version, {**one.gate, "passed": True, "champion": None})
    approve(workspace, "cmx600v", 2, **who)
    said = CliRunner().invoke(pido, ["status", "-w", str(workspace.root)]).stdout
    assert "not compared with the champion in force" in said
    assert refusal(workspace, Ledger(workspace.ledger).versions("cmx600v")[2]) == ""
    assert approve(workspace, "cmx600v", 3, **who).version == 3
    gate = Ledger(workspace.ledger).versions("cmx600v")[2].gate
    assert (gate["champion"], gate["parts"]) == (second.bundle, third.gate["parts"][-1:])
    assert "against the champion" in gate["words"]
    with pytest.raises(PidoError, match="Version 3 is in force now, and beside that one it does not pass: no") as no:
        approve(workspace, "cmx600v", 2, **who)
    assert refusal(workspace, Ledger(workspace.ledger).versions("cmx600v")[1]) == str(no.value)
    record = promotion.champion(workspace, "cmx600v")
    assert record is not None
    assert record.version == 3


def test_a_version_is_judged_by_errors_of_its_own_settings_alone(folders, tmp_path, without_mlflow):
    workspace, file = workspace_at(tmp_path / "plant"), tmp_path / "plant" / "workspace.toml"
    run(workspace, *folders)
    first, (*_, newest) = file.read_text(), Ledger(workspace.ledger).parts("cmx600v")
    for settings in (first + "rows_max = 300\n", first + "rows_max = 500\n", "seed = 3\n" + first):
        file.write_text(settings)
        plain.retrain_all(Workspace.open(workspace.root), lambda *about: None)
        gate = Ledger(workspace.ledger).versions("cmx600v")[-1].gate
        measured = Ledger(workspace.ledger).iterations("cmx600v")[-1].summary["metrics"]
        assert gate["parts"] == [newest]
        for axis, change in gate["change"].items():
            assert change == measured[axis]["both"]["rmse"] / measured[axis]["constant"]["rmse"] - 1
    versions = Ledger(workspace.ledger).versions("cmx600v")
    assert [len(one.gate.get("parts", [])) for one in versions] == [0, 1, 2, 1, 1, 1]


def test_challenger_and_champion_are_compared_on_the_same_rows_also_after_a_true_alarm(
    folders, tmp_path, without_mlflow
):
    workspace, machine = workspace_at(tmp_path / "plant"), "cmx600v"
    run(workspace, *folders)
    _, second, third = Ledger(workspace.ledger).parts(machine)
    Ledger(workspace.ledger).judged(machine, 1, {"passed": True, "words": "set by this test"})
    promotion.approve(workspace, machine, 1, by="ann", reason="a test")
    book = Book(workspace, machine)
    alarm = {"id": "a1", "part": "demo-02", "axis": "x", "t_start": 2.0, "t_end": 5.0, "tool": "", "block": 1,
             "size_a": 1.0, "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book.verdict({"part": "demo-02", "digest": second, "machine": machine, "good": False, "alarms": [alarm]})
    gates = []
    for answer in (None, True, False):
        if answer is not None:
            book.answer("a1", true=answer, by="ann", reason="a test")
            plain.retrain_all(workspace, lambda *about: None)
        # What is waiting is judged beside the champion, as approving does.
        waiting = promotion.current(workspace, machine)
        assert waiting is not None
        gates.append(comparison.judge_again(workspace, waiting)["parts"])
    assert gates == [[second, third], [third], [second, third]]


def test_no_number_about_a_part_comes_from_that_part(folders, tmp_path, without_mlflow):
    """What was predicted for the arriving part stays the same when its currents are others."""
    said = []
    for number, factor in enumerate((1.0, 3.0)):
        workspace = workspace_at(tmp_path / str(number))
        run(workspace, folders[0])
        arrived = ingest(str(workspace.root), str(folders[1]))
        key = production.begin(str(workspace.root), arrived["machine"], arrived["part"])
        real = samples_of(workspace, arrived["part"])
        save_samples(replace(real, currents=real.currents * factor), samples_path(workspace, arrived["part"]))
        for stage in production.STAGES[:4]:
            stage(str(workspace.root), key)
        said.append((workspace.work / key / "said.parquet").read_bytes())
    assert said[0] == said[1]


def test_a_stage_that_is_done_twice_and_a_run_that_was_cut_off_change_nothing(folders, tmp_path, without_mlflow):
    plainly, broken = workspace_at(tmp_path / "plain"), workspace_at(tmp_path / "broken")
    run(plainly, *folders[:2])
    run(broken, folders[0])
    root = str(broken.root)
    arrived = ingest(root, str(folders[1]))
    key = production.begin(root, arrived["machine"], arrived["part"])
    for stage in production.STAGES[:4]:
        stage(root, key)
        stage(root, key)
    run(broken, folders[1])  # the process died after retraining; the part is brought again
    assert final_state(broken) == final_state(plainly)
    assert len(Ledger(broken.ledger).iterations("cmx600v")) == 2
    assert not list(broken.work.iterdir())


def test_an_answer_to_an_alarm_during_an_iteration_counts_for_the_next_one(folders, tmp_path, without_mlflow):
    undisturbed, place = workspace_at(tmp_path / "undisturbed"), workspace_at(tmp_path / "plant")
    run(undisturbed, folders[0])
    root = str(place.root)
    arrived = ingest(root, str(folders[0]))
    book = Book(place, arrived["machine"])
    alarm = {"id": "a1", "part": "p", "axis": "x", "t_start": 2.0, "t_end": 5.0, "tool": "", "block": 1, "size_a": 1.0,
             "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book.verdict({"part": "p", "digest": arrived["part"], "machine": "cmx600v", "good": False, "alarms": [alarm]})
    key = production.begin(root, arrived["machine"], arrived["part"])
    for stage in production.STAGES:
        stage(root, key)
        book.answer("a1", true=True, by="ann", reason="insert was chipped")
    assert final_state(place) == final_state(undisturbed)
    assert production.begin(root, arrived["machine"], None) != key


def test_a_change_of_settings_during_an_iteration_counts_for_the_next_one(folders, tmp_path, without_mlflow):
    undisturbed, place = workspace_at(tmp_path / "undisturbed"), workspace_at(tmp_path / "plant")
    run(undisturbed, folders[0])
    root, file = str(place.root), place.root / "workspace.toml"
    arrived = ingest(root, str(folders[0]))
    key = production.begin(root, arrived["machine"], arrived["part"])
    text = file.read_text()
    for number, stage in enumerate(production.STAGES):
        stage(root, key)
        file.write_text(f"seed = {number + 1}\n{text}rows_max = {number + 10}\n")
    assert final_state(place) == final_state(undisturbed)
    assert production.begin(root, arrived["machine"], None) != key


def test_an_iteration_does_not_go_on_with_another_file_of_materials_than_it_began_with(
    folders, tmp_path, without_mlflow
):
    place = workspace_at(tmp_path / "plant")
    root, file, materials = str(place.root), place.root / "workspace.toml", place.root / "own.toml"
    file.write_text('materials_file = "own.toml"\n' + file.read_text())
    materials.write_text("")
    arrived = ingest(root, str(folders[0]))
    key = production.begin(root, arrived["machine"], arrived["part"])
    production.bins(root, key)
    materials.write_text("# another one\n")
    with pytest.raises(SettingsFileError, match=r"materials.* changed while an iteration was on its way.*run it again"):
        production.refit(root, key)
    assert Ledger(place.ledger).parts("cmx600v") == []
    run(place, folders[0])


UPGRADED = """
import multiprocessing, pathlib, sys
def report(queue):
    from pido import iteration, workspace
    queue.put((hasattr(iteration, "NEW"), workspace.code_version()))
if __name__ == "__main__":
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["pido.workspace", "pido.iteration"])
    queue = context.Queue()
    for _ in range(2):
        context.Process(target=report, args=(queue,)).start()
        print(*queue.get())
        with (pathlib.Path(sys.argv[1]) / "pido" / "iteration.py").open("a") as file:
            file.write("NEW = True\\n")
"""


def test_a_worker_that_runs_on_while_pido_is_upgraded_says_which_code_it_runs(tmp_path):
    shutil.copytree(Path(production.__file__).parent, tmp_path / "pido", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "worker.py").write_text(UPGRADED)
    call = [sys.executable, str(tmp_path / "worker.py"), str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    said = subprocess.run(call, check=True, capture_output=True, text=True, env=environment, timeout=120).stdout
    before, after = said.splitlines()
    assert before == after
    assert before.startswith("False ")


def test_the_same_part_again_or_under_another_name_counts_once(folders, tmp_path, without_mlflow):
    workspace = workspace_at(tmp_path / "plant")
    run(workspace, folders[0], folders[0])
    again = tmp_path / "copied elsewhere"
    shutil.copytree(folders[0], again)
    run(workspace, again)
    assert len(Ledger(workspace.ledger).parts("cmx600v")) == 1
    assert len(Ledger(workspace.ledger).versions("cmx600v")) == 1


def test_what_cannot_be_used_is_rejected_with_its_reason_and_the_others_go_on(folders, tmp_path, without_mlflow):
    workspace = workspace_at(tmp_path / "plant")
    broken = tmp_path / "broken.json"
    broken.write_text('{"Header": {')
    empty = tmp_path / "empty"
    empty.mkdir()
    answer = plain.run(workspace, [broken, empty, folders[0]], None, lambda *a: None)
    assert [one["part"]["name"] for one in answer["done"]] == ["demo-01"]
    assert {Path(r["path"]).name for r in answer["rejected"]} == {"broken.json", "empty"}
    reasons = sorted((workspace.store / "rejected").glob("*.reason.txt"))
    assert len(reasons) == 2
    assert broken.exists(), "a user's own file stays where it is"


def test_a_known_part_with_other_content_is_refused_and_nothing_changes(folders, tmp_path, without_mlflow):
    workspace = workspace_at(tmp_path / "plant")
    run(workspace, folders[0])
    before = final_state(workspace)
    other = next(made_up(1, seed=9)).rows(slice(0, 700))
    place = write_folder(other, tmp_path / "other")
    answer = plain.run(workspace, [place], None, lambda *a: None)
    assert "other content" in answer["rejected"][0]["reason"]
    assert final_state(workspace) == before


def test_a_file_that_changes_while_it_is_read_is_left_for_later(folders, tmp_path, monkeypatch):
    from pido import parts

    workspace = workspace_at(tmp_path / "plant")
    place = tmp_path / "arriving"
    shutil.copytree(folders[0], place)
    read = parts.read_recording

    def slowly(*args, **kwargs):
        result = read(*args, **kwargs)
        (place / "note.txt").write_text("still being copied")
        return result

    monkeypatch.setattr(parts, "read_recording", slowly)
    with pytest.raises(parts.Changed):
        ingest(str(workspace.root), str(place))
    assert Ledger(workspace.ledger).rejections() == []


def test_a_machine_that_fails_holds_up_neither_the_others_nor_mlflow(folders, tmp_path, monkeypatch):
    workspace = workspace_at(tmp_path / "plant")
    other = next(made_up(1, machine="dmc60h")).rows(slice(0, 700))
    with monkeypatch.context() as away:
        away.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})
        run(workspace, folders[0], write_folder(other, tmp_path / "other"))
    ledger, file = Ledger(workspace.ledger), workspace.root / "workspace.toml"
    method = file.read_text()
    assert len(ledger.not_logged(workspace.tracking_place)) == 2
    file.write_text('jobs = { cmx600v = "a.toml", dmc60h = "b.toml" }\n' + method)
    with pytest.raises(PidoError, match=r"(?s)2 machine.*cmx600v: .*a\.toml.*dmc60h: .*b\.toml"):
        plain.retrain_all(Workspace.open(workspace.root), lambda *about: None)
    assert ledger.not_logged(workspace.tracking_place) == []
    file.write_text('seed = 1\njobs = { cmx600v = "a.toml" }\n' + method)
    with pytest.raises(PidoError, match=r"1 machine.*\n  cmx600v: .*a\.toml"):
        plain.retrain_all(Workspace.open(workspace.root), lambda *about: None)
    assert [len(ledger.iterations(machine)) for machine in ("cmx600v", "dmc60h")] == [1, 2]


def test_samples_come_back_from_their_file_bit_for_bit(folders, tmp_path):
    workspace = workspace_at(tmp_path / "plant")
    arrived = ingest(str(workspace.root), str(folders[0]))
    samples = samples_of(workspace, arrived["part"])
    again = load_samples(save_samples(samples, tmp_path / "again.parquet"))
    assert samples_digest(again) == samples_digest(samples)
    np.testing.assert_array_equal(again.currents, samples.currents)


def test_a_workspace_does_not_silently_change_its_settings(tmp_path):
    Workspace.make(tmp_path / "plant", machine="cmx600v", seed=1)
    assert Workspace.make(tmp_path / "plant", seed=1).settings.seed == 1
    with pytest.raises(PidoError, match="seed is 1 in this workspace"):
        Workspace.make(tmp_path / "plant", seed=2)


def test_a_second_pass_over_known_parts_makes_no_new_run_and_takes_less_than_two_seconds(folders, tmp_path):
    workspace = workspace_at(tmp_path / "plant")
    call = [sys.executable, "-m", "pido.cli", "iterate", *map(str, folders[:2]), "--workspace", str(workspace.root)]
    subprocess.run(call, check=True, capture_output=True)
    runs = [i.logged for i in Ledger(workspace.ledger).iterations("cmx600v")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = subprocess.run(call, check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    # processor time, Python's own start included: what else runs on the machine is not this command's
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 2.0
    assert "2 part(s) known already" in said
    assert [i.logged for i in Ledger(workspace.ledger).iterations("cmx600v")] == runs
    assert all(runs)


def test_a_wrong_call_and_unusable_input_have_their_own_exit_codes(tmp_path):
    runner = CliRunner()
    assert runner.invoke(pido, ["iterate", "--nonsense"]).exit_code == 2
    missing = runner.invoke(pido, ["iterate", str(tmp_path / "nothing"), "--workspace", str(tmp_path / "w")])
    assert missing.exit_code == 1
    assert "no such file" in str(missing.exception)
