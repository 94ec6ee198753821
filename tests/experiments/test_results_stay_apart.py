"""Results of one run are never taken for those of another, and never replaced by them without a word."""

import json

import pandas as pd
import pytest
from click.testing import CliRunner

from pido.cli.experiment import command
from pido.config import machine
from pido.core.errors import SettingsError
from pido.experiments import concealed, extended_equation, runner
from pido.experiments.base import Outcome, Shown
from pido.experiments.data import DataError, Fleet, load_fleet
from pido.experiments.places import folder_names
from pido.experiments.runner import run_experiment
from pido.recordings.folder import write_folder
from tests.experiments.test_experiments_run import part
from tests.plain_parts import parts


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return Fleet("made", machine("dmc60h"), {f"p{k}": part(f"p{k}", k) for k in range(3)})


def test_folders_have_the_full_last_name_and_a_digest_where_two_places_share_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = folder_names(["worn", "a/mill.v1", "a/mill.v2", "a/parts", "b/parts", "b/../b/parts"])
    assert (names["worn"], names["a/mill.v1"], names["a/mill.v2"]) == ("worn", "mill.v1", "mill.v2")
    assert names["a/parts"] != names["b/parts"] == names["b/../b/parts"]
    assert all(names[s].startswith("parts-") for s in ("a/parts", "b/parts"))
    assert folder_names(["b/parts"]) == {"b/parts": "parts"}
    assert list(folder_names(["."]).values()) == [tmp_path.name]


@pytest.mark.thorough
def test_a_folder_that_holds_another_run_is_refused_and_stays_as_it_is(fleet, tmp_path):
    options = {"folder": tmp_path, "repeats": 2, "seed": 3}
    run_experiment("importance", fleet, quick=True, **options)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    other = Fleet("others", fleet.machine, {**fleet.sets, "p0": part("p0", 99)})
    for call, says in (
        ({"data": other, "quick": True}, r"its data \(made\) are not these \(others\)"),
        ({"data": fleet, "quick": True, "seed": 1}, "its seed is 3, not 1"),
        ({"data": fleet, "quick": False}, "its quick is True, not False"),
        ({"data": fleet, "quick": True, "repeats": 1}, "its repeats is 2, not 1"),
    ):
        with pytest.raises(SettingsError, match=says):
            run_experiment("importance", **options | call)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    assert run_experiment("importance", other, quick=True, resume=False, **options).found == 0


def test_a_run_that_was_stopped_keeps_its_folder(fleet, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr(runner, "measure", stopped)
        with pytest.raises(KeyboardInterrupt):
            run_experiment("importance", fleet, folder=tmp_path, repeats=3)
    with pytest.raises(SettingsError, match="its quick is False"):
        run_experiment("importance", fleet, folder=tmp_path, repeats=3, quick=True)


def test_a_folder_of_an_earlier_version_is_continued_and_one_that_says_nothing_is_not(fleet, tmp_path):
    run_experiment("importance", fleet, folder=tmp_path, repeats=1, quick=True)
    about = tmp_path / "experiment.json"
    held = json.loads(about.read_text())
    del held["options"]["delivered"], held["data_digest"]
    about.write_text(json.dumps(held))
    assert run_experiment("importance", fleet, folder=tmp_path, repeats=1, quick=True).found > 0
    about.write_text("[]")
    with pytest.raises(SettingsError, match="says of no run"):
        run_experiment("importance", fleet, folder=tmp_path, repeats=1, quick=True)


def done(words):
    return Outcome(words, (Shown("t", pd.DataFrame({"a": [1]})),), ())


def call(*words):
    answer = CliRunner().invoke(command, [str(w) for w in words])
    return answer.exit_code, answer.output, answer.exception


def test_proofs_on_two_machines_are_two_pages(tmp_path, monkeypatch):
    monkeypatch.setattr(extended_equation, "run", lambda path, **_: done(f"RESULT OF {path.parent.name}/{path.name}"))
    out = tmp_path / "out"
    for place in ("a/one", "a/two", "b/one"):
        (tmp_path / place).mkdir(parents=True)
    assert call("extended-equation", "--data", tmp_path / "a/one", "--out", out)[0] == 0
    assert call("extended-equation", "--data", tmp_path / "a/two", "--out", out)[0] == 0
    for name in ("one", "two"):
        page = (out / "extended-equation" / name / "report.html").read_text(encoding="utf-8")
        assert f"RESULT OF a/{name}" in page
    _, _, error = call("extended-equation", "--data", tmp_path / "b/one", "--out", out)
    assert isinstance(error, SettingsError)
    assert call("extended-equation", "--data", tmp_path / "b/one", "--out", out, "--fresh")[0] == 0


def test_more_sealed_cases_join_those_that_are_there_and_another_seed_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(concealed, "run", lambda *_, **__: pd.DataFrame())
    monkeypatch.setattr(concealed, "summarise", lambda table: done("done"))
    words = ("concealed", "--out", tmp_path, "--seed")
    assert call(*words, 1, "--cases", 5)[0] == 0
    assert call(*words, 1, "--cases", 9)[0] == 0
    for other in ((2, "--cases", 9), (1, "--cases", 5), (1, "--cases", 9, "--quick")):
        assert isinstance(call(*words, *other)[2], SettingsError)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("concealed --cases 1 --cluster tcp://127.0.0.1:1", "--cluster"),
        ("concealed --cases 1 --repeats 9", "--repeats"),
        ("concealed --cases 1 --data nowhere", "--data"),
        ("concealed --cases 1 --machine nosuch", "--machine"),
        ("extended-equation --data . --cluster local", "--cluster"),
        ("extended-equation --data . --estimators default", "--estimators"),
        ("extended-equation --data . --cases 3", "--cases"),
        ("real-mismatch --data . --machine dmc60h", "--machine"),
        ("real-mismatch --data . --workers 2", "--workers"),
        ("importance --cases 3", "--cases"),
        ("importance --estimators paper", "--estimators"),
        ("local-vs-global --repeats 3", "--repeats"),
        ("shares --percent 10", "--percent"),
        ("rivals --delivered", "--delivered"),
    ],
)
def test_an_option_that_means_nothing_for_an_experiment_is_a_wrong_call(words, option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said, _ = call(*words.split(), "--out", tmp_path / "out")
    assert code == 2
    assert f"{option} is an option of " in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("load", [lambda data: load_fleet(str(data), "impellers"), extended_equation.run])
def test_two_recordings_of_one_part_are_refused_and_both_are_named(load, tmp_path):
    first, second, third = parts(3)
    for folder, recording in (("a", first), ("b", second), ("c", third)):
        named = recording.part if folder != "c" else recording.part.model_copy(update={"part": first.part.part})
        write_folder(type(recording)(named, recording.columns), tmp_path / folder)
    with pytest.raises(DataError, match=rf"/a and .*/c: both are recordings of part '{first.part.part}'.*its own name"):
        load(tmp_path)
