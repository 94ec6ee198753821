"""How every verb behaves: help, exit codes, streams, JSON, completion, and what a user's mistake looks like."""

import importlib.util
import json
import re
import shlex
import shutil
import subprocess
import sys

import click
import numpy as np
import orjson
import pytest

from pido.cli import EXTRAS, VERBS, main, pido
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder


def commands(command=pido, path=()):
    """Every verb and subcommand with its words."""
    for name in command.list_commands(click.Context(command)):
        if command is pido and not importlib.util.find_spec(f"pido.cli.{name.replace('-', '_')}"):
            continue  # the test of the verbs' modules says so
        found = command.get_command(click.Context(command), name)
        yield (*path, name), found
        if isinstance(found, click.Group):
            yield from commands(found, (*path, name))


def examples(text):
    """Calls in a help text, continuation lines joined."""
    return [
        line.strip() for line in re.sub(r"\\\n\s*", "", text or "").splitlines() if line.strip().startswith("pido ")
    ]


ALL = list(commands())


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_a_module_of_its_name(verb):
    assert importlib.import_module(f"pido.cli.{verb.replace('-', '_')}").command


@pytest.mark.parametrize(("words", "command"), ALL, ids=[" ".join(w) for w, _ in ALL])
def test_help_shows_a_real_call_of_the_verb(words, command):
    assert any(line.split()[1 : 1 + len(words[:1])] == list(words[:1]) for line in examples(command.help))


@pytest.mark.parametrize("line", sorted({line for _, command in [((), pido), *ALL] for line in examples(command.help)}))
def test_every_call_in_a_help_is_understood(line, tmp_path, monkeypatch):
    """Parsed as the verb parses it; files that an example names are put there first."""
    monkeypatch.chdir(tmp_path)
    words = [word.replace("*", "p01") for word in shlex.split(line)[1:]]
    (tmp_path / "diagnosis").mkdir()  # the one folder that examples name without a slash
    for word in words:
        if "/" in word or "." in word:
            place = tmp_path / word
            if re.search(r"\.\w+$", word):
                place.parent.mkdir(parents=True, exist_ok=True)
                place.touch()
            else:
                place.mkdir(parents=True, exist_ok=True)
    command, name = pido, "pido"
    context = click.Context(command, info_name=name)
    while isinstance(command, click.Group):
        # a group of a verb may choose its subcommand itself while it parses
        own = command.make_context(name, list(words), parent=context, resilient_parsing=False)
        rest = [*own._protected_args, *own.args]
        name, command, words = command.resolve_command(own, rest)
        context = own
    command.make_context(name, words, parent=context)


@pytest.mark.parametrize(("words", "command"), ALL, ids=[" ".join(w) for w, _ in ALL])
def test_every_option_says_what_it_is(words, command):
    mute = [p.name for p in command.params if isinstance(p, click.Option) and not p.help]
    assert not mute


@pytest.mark.parametrize("verb", VERBS)
def test_an_unknown_option_is_a_wrong_call(verb, call):
    code, out, err = call(verb, "--no-such-option")
    assert code == 2
    assert not out
    assert "no-such-option" in err


@pytest.mark.parametrize("verb", ["diagnose", "experiment", "plan", "iterate"])
def test_a_seed_below_zero_is_a_wrong_call(verb, call):
    code, out, err = call(verb, "--seed", "-1")
    assert (code, out) == (2, "")
    assert "'--seed': -1 is not in the range x>=0" in err


def test_an_unknown_verb_is_a_wrong_call_that_names_the_near_one(call):
    code, _, err = call("diagnos")
    assert code == 2
    assert "diagnose" in err


def part(folder, name="p1", order=1, rows=1500, axis="x", **more):
    """A feed axis that goes to and fro; its simulation lacks what grows with speed."""
    rng = np.random.default_rng(order)
    t = np.arange(rows) * 0.02
    v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
    sim = 0.5 * np.sign(v)
    columns = {
        "time": t,
        f"pos_{axis}": np.cumsum(v) * 0.02,
        f"v_{axis}": v,
        f"curr_{axis}": sim + 0.03 * v + rng.normal(0, 0.03, rows),
        f"curr_{axis}_sim": sim,
        **more,
    }
    return write_folder(Recording(PartInfo(part=name, machine="cmx600v", order=order), columns), folder / name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("parts")
    for k in range(1, 4):
        part(place, f"p{k}", k)
    (place / "empty.csv").touch()
    (place / "text.csv").write_text("Dear colleague,\nthe recording follows.\n")
    (place / "cut.parquet").write_bytes((place / "p1" / "recording.parquet").read_bytes()[:2000])
    part(place, "misspelt")
    (place / "misspelt" / "part.json").write_text('{"part": "m", "machine": "cmx600v", "oder": 3}')
    part(place, "short", rows=50)
    for name, content in {
        "number": {"part": "x", "bins": 3},
        "words": {"part": "x", "bins": [{"v_x": "fast"}]},
        "list": [],
    }.items():
        (place / f"{name}.json").write_text(json.dumps(content))
    (place / "bad.toml").write_text("machine = \n")
    (place / "job.toml").write_text('machine = "cmx600v"\n[tools.T1]\ndiameter_mm = 10.0\nteeth = 2\n')
    (place / "no_machine.toml").write_text('machine = "no such mill"\n[tools.T1]\ndiameter_mm = 10.0\nteeth = 2\n')
    (place / "good.mpf").write_text("G90 G0 X0 Y0 Z5\nG1 X10 F600\nM30\n")
    (place / "bad.mpf").write_text("G90 G0 X0 Y0 Z5\nG1 X10 QQ7 F600\nM30\n")
    return place


MISTAKES = {
    "a part that is not there": "diagnose nothing --out o",
    "an empty file": "diagnose empty.csv --out o",
    "a letter": "diagnose text.csv --out o",
    "half a file": "diagnose cut.parquet --out o",
    "a misspelt key": "diagnose misspelt --out o",
    "too few samples": "diagnose short --out o",
    "a part twice": "diagnose p1 p1 --out o",
    "a machine nobody knows": "diagnose p1 p2 p3 --machine nobody --out o",
    "a column that is not there": "diagnose p1 p2 p3 --pair f_q:f_x_sim --out o",
    "a diagnosis that is not there": "correct nothing p1 --out o.parquet",
    "a word the control does not know": "simulate bad.mpf --job job.toml --out o.parquet",
    "settings that are no TOML": "simulate good.mpf --job bad.toml --out o.parquet",
    "a job for an unknown machine": "simulate good.mpf --job no_machine.toml --out o.parquet",
    "a workspace that is not there": "status -w nowhere",
    "approval without a workspace": "approve 1 --by me --reason r -w nowhere",
    "refusal without a workspace": "reject 1 --by me --reason r -w nowhere",
    "rollback without a workspace": "rollback --by me --reason r -w nowhere",
    "a plan whose bins are a number": "report plan number.json --out o.parquet",
    "a plan whose bins are words": "report plan words.json --out o.parquet",
    "a plan that is a list": "report plan list.json --out o.parquet",
    "a plan without parts": "plan good.mpf --job job.toml -w nowhere",
    "monitoring without a workspace": "monitor p1 -w nowhere",
    "an iteration of a letter": "iterate text.csv -w plant --machine cmx600v",
    "an unknown machine's store": "ingest p1 --store s --machine nobody",
    "a letter for the store": "ingest text.csv --store s --keep",
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_message_with_exit_code_1_and_no_traceback(mistake, call, folder, tmp_path, monkeypatch):
    words = shlex.split(MISTAKES[mistake])
    words = [str(folder / word) if (folder / word).exists() else word for word in words]
    monkeypatch.chdir(tmp_path)
    code, out, err = call(*words)
    assert code == 1
    assert "Traceback" not in out + err
    assert len(err) > 30
    assert "Error(" not in err
    # an answer that a machine would read is not half written
    assert not (tmp_path / "o.parquet").exists()
    assert not (tmp_path / "o" / "diagnosis.json").exists()


READS = {
    "ingest": "ingest NOTHING --store s",
    "ingest, settings": "ingest p1 --store s --machine m --settings NOTHING",
    "iterate": "iterate NOTHING -w w --machine cmx600v",
    "iterate, job": "iterate p1 --job NOTHING -w w",
    "watch": "watch NOTHING -w w --once",
    "plan": "plan NOTHING --job job.toml -w w",
    "plan, job": "plan good.mpf --job NOTHING -w w",
    "simulate": "simulate NOTHING --job job.toml --out o.parquet",
    "simulate, job": "simulate good.mpf --job NOTHING --out o.parquet",
    "diagnose": "diagnose p1 NOTHING --out o",
    "correct": "correct NOTHING p1 --out o.parquet",
    "correct, part": "correct p1 NOTHING --out o.parquet",
    "accept-physics": "accept-physics NOTHING --finding 1 --by me --reason r -w w",
    "monitor": "monitor NOTHING -w w",
    "monitor, follow": "monitor --follow NOTHING -w w",
    "status": "status -w NOTHING",
    "approve": "approve 1 --by me --reason r -w NOTHING",
    "reject": "reject 1 --by me --reason r -w NOTHING",
    "rollback": "rollback --by me --reason r -w NOTHING",
    "withdraw": "withdraw p1 --by me --reason r -w NOTHING",
    "experiment": "experiment local-vs-global --data NOTHING --out e",
    "experiment, job": "experiment local-vs-global --job NOTHING --out e",
    "experiment, machine": "experiment extended-equation --data NOTHING --out e",
    "experiment, machines": "experiment real-mismatch --data NOTHING --out e",
    "report, plan": "report plan NOTHING --out o.html",
    "report, experiment": "report experiment NOTHING --out o.html",
    "report, iteration": "report iteration -w NOTHING --out o.html",
}


def test_every_verb_that_reads_something_is_asked_for_what_is_not_there():
    assert {words.split()[0] for words in READS.values()} == set(VERBS)


@pytest.mark.parametrize("verb", READS)
def test_what_is_not_there_is_named_with_exit_code_1_in_every_verb(verb, call, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = [str(folder / word) if (folder / word).exists() else word for word in shlex.split(READS[verb])]
    code, _, err = call(*words)
    assert code == 1
    assert ("w: no workspace" if "monitor" in verb else "NOTHING") in err
    assert "Usage:" not in err


def test_settings_of_machines_without_a_machine_are_not_passed_over(call, folder, tmp_path):
    code, _, err = call("ingest", folder / "p1", "--store", tmp_path / "s", "--settings", folder / "bad.toml")
    assert code == 2
    assert "--machine" in err


def test_a_folder_where_a_file_is_wanted_says_so(call, folder, tmp_path):
    code, _, err = call("simulate", folder / "p1", "--job", folder / "job.toml", "--out", tmp_path / "o.parquet")
    assert code == 1
    assert "p1: this is a folder; give a file." in err


@pytest.mark.parametrize("other", ["diagnosis.json", "plan.json"])
def test_the_page_of_something_else_is_not_taken_for_an_experiments(other, call, tmp_path):
    (tmp_path / "d").mkdir()
    for name in ("report.html", other):
        (tmp_path / "d" / name).write_text("{}")
    code, _, err = call("report", "experiment", tmp_path, "--out", tmp_path / "o.html")
    assert code == 1
    assert "must hold the page of one experiment" in err
    (tmp_path / "d" / other).unlink()
    assert call("report", "experiment", tmp_path, "--out", tmp_path / "o.html")[0] == 0


def test_an_error_inside_pido_keeps_its_traceback(monkeypatch, folder):
    monkeypatch.setattr("pido.recordings.read_recording", lambda path: 1 / 0)
    monkeypatch.setattr(sys, "argv", ["pido", "diagnose", str(folder / "p1"), "--out", "o"])
    with pytest.raises(ZeroDivisionError):
        main()


@pytest.mark.parametrize("library", ["mlflow", "prefect"])
def test_a_library_that_is_not_installed_names_the_extra_that_brings_it(library, call, monkeypatch, folder, tmp_path):
    def missing(*args, **kwargs):
        raise ModuleNotFoundError(f"No module named '{library}'", name=library)

    monkeypatch.setattr("pido.recordings.read_recording", missing)
    code, _, err = call("diagnose", folder / "p1", "--out", tmp_path / "o")
    assert code == 1
    assert f"pido[{EXTRAS[library]}]" in err


@pytest.fixture(scope="module")
def diagnosed(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("diagnosed")
    done = subprocess.run(
        [sys.executable, "-m", "pido.cli", "diagnose", *[folder / f"p{k}" for k in (1, 2, 3)], "--out", out, "--json"],
        capture_output=True,
        text=True,
        timeout=300,
    )
    return out, done


def test_json_goes_to_stdout_whole_and_progress_is_silent_when_piped(diagnosed):
    out, done = diagnosed
    assert done.returncode == 0
    assert json.loads(done.stdout) == json.loads((out / "diagnosis.json").read_text())
    assert "%|" not in done.stderr
    assert "\r" not in done.stderr


def test_a_diagnosis_keeps_the_machine_that_its_parts_name(diagnosed):
    assert json.loads((diagnosed[0] / "model.json").read_text())["machine"] == "cmx600v"


def test_the_summary_names_axis_mechanism_and_gain(diagnosed, call, folder, tmp_path):
    code, out, _ = call("diagnose", *[folder / f"p{k}" for k in (1, 2, 3)], "--out", tmp_path / "d")
    assert code == 0
    assert re.search(r"^x\s+viscous_friction\s.*RMSE 0\.\d+ -> 0\.03\d*", out, re.MULTILINE)


def test_correct_prints_the_file_it_wrote(diagnosed, call, folder, tmp_path):
    code, out, _ = call("correct", diagnosed[0], folder / "p3", "--out", tmp_path / "c.parquet")
    assert code == 0
    assert out.strip() == str(tmp_path / "c.parquet")
    assert (tmp_path / "c.parquet").exists()


def test_correct_says_which_parts_it_was_not_told_of(diagnosed, call, folder, tmp_path):
    model = json.loads((diagnosed[0] / "model.json").read_text())
    again = shutil.copytree(diagnosed[0], tmp_path / "d")
    model["axes"]["x"]["terms"].append(
        {"mechanism": {"id": "thermal_drift"}, "name": "thermal_drift", "gates": [], "amplitudes": [0.1],
         "shape": {"tau": 100.0, "clock": 1.0, "along": 0.0, "rises": 0.0}}
    )  # fmt: skip
    model["axes"]["x"]["largest"].append(0.1)
    model["orders"] = [1, 2]
    (again / "model.json").write_text(json.dumps(model))
    late = shutil.copytree(folder / "p3", tmp_path / "late")
    (late / "part.json").write_text(json.dumps(json.loads((late / "part.json").read_text()) | {"order": 5}))
    code, _, err = call("correct", again, late, "--out", tmp_path / "c.parquet")
    assert code == 0
    assert "number 3, 4 in production order is not known" in err


def test_ingest_says_one_json_object_per_recording(call, folder, tmp_path):
    code, out, _ = call("ingest", folder / "p1", folder / "text.csv", "--store", tmp_path / "s", "--keep", "--json")
    rows = [orjson.loads(line) for line in out.splitlines()]
    assert code == 1
    assert [row["state"] for row in rows] == ["stored", "rejected"]
    assert rows[0]["part"] == "p1"
    assert rows[1]["reason"]


def test_simulate_says_its_figures_as_json(call, folder, tmp_path):
    code, out, _ = call(
        "simulate", folder / "good.mpf", "--job", folder / "job.toml", "--out", tmp_path / "s.parquet", "--json"
    )
    assert code == 0
    assert json.loads(out)["part"] == "good"


def test_status_of_a_new_workspace_as_json(call, folder, tmp_path):
    from pido.tracking.ledger import Ledger
    from pido.workspace import Workspace

    Ledger(Workspace.open(tmp_path).ledger).machines()
    code, out, _ = call("status", "-w", tmp_path, "--json")
    assert code == 0
    assert json.loads(out)["machines"] == {}


def test_help_and_version_import_nothing_heavy():
    code = (
        "import sys\nfrom pido.cli import VERBS, pido\nimport click\n"
        "pido.get_help(click.Context(pido))\n"
        "[pido.get_command(click.Context(pido), v).get_help(click.Context(pido)) for v in VERBS]\n"
        "print([m for m in ('prefect', 'mlflow', 'sklearn', 'pandas', 'numba', 'bokeh', 'scipy') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_its_completion_script(shell):
    import os

    done = subprocess.run(
        [sys.executable, "-m", "pido.cli"],
        env={**os.environ, "_PIDO_COMPLETE": f"{shell}_source"},
        capture_output=True,
        text=True,
    )
    assert "_PIDO_COMPLETE" in done.stdout


def test_completion_knows_verbs_and_options():
    from click.shell_completion import ShellComplete

    completed = ShellComplete(pido, {}, "pido", "_PIDO_COMPLETE")
    assert "diagnose" in {c.value for c in completed.get_completions([], "dia")}
    assert "--pair" in {c.value for c in completed.get_completions(["diagnose"], "--p")}


def test_the_package_is_the_command_line_where_its_script_is_not_on_the_path():
    done = subprocess.run([sys.executable, "-m", "pido", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stdout[:5]) == (0, "pido,")
