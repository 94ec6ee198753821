"""The three additions of docs/extending.md, run as they stand there."""

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from pido import config
from pido.core.errors import SettingsError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis import contract, mechanisms
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.parts import machine_of
from pido.recordings import read_recording
from pido.workspace import Workspace

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"


def block(kind):
    """The one fenced block of this kind."""
    found = re.findall(rf"```\w+ {kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(found) == 1
    return found[0]


def run(kind):
    module = types.ModuleType(f"added_{kind}")
    exec(compile(block(kind), str(PAGE), "exec"), module.__dict__)
    return module


@pytest.mark.parametrize("kind", ["mechanism", "reader", "machine"])
def test_each_takes_less_than_40_lines(kind):
    assert len(block(kind).splitlines()) < 40


def stroke(name, seed, k=0.0004):
    """An axis at many feeds whose cover pumps air; its simulation knows plain friction only."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 80, 0.02)
    v = np.repeat(rng.choice([-60.0, -40.0, -20.0, -5.0, 5.0, 20.0, 40.0, 60.0], 80), 50)
    v = np.convolve(v, np.ones(15) / 15, mode="same")
    sim = 0.5 * np.sign(v)
    columns = {
        "time": t, "pos_x": np.cumsum(v) * 0.02, "v_x": v, "a_x": np.gradient(v, t), "curr_x_sim": sim,
        "curr_x": sim + k * v * np.abs(v) + rng.normal(0, 0.05, len(t)),
    }  # fmt: skip
    return Recording(PartInfo(part=name, machine="m", order=seed), columns)


def test_an_added_mechanism_is_found_by_its_name_and_corrects_an_unseen_part(monkeypatch, tmp_path):
    catalogue = mechanisms.CATALOGUE
    longer = (*catalogue, run("mechanism").CoverDrag())
    for module in list(sys.modules.values()):
        if vars(module).get("CATALOGUE") is catalogue:
            monkeypatch.setattr(module, "CATALOGUE", longer)
    result = diagnose([stroke(f"p{i}", i) for i in range(1, 4)])
    assert [f.mechanism for f in result.findings] == ["cover_drag"]
    found = result.findings[0].parameters["k"]
    assert found.ci95[0] <= 0.0004 <= found.ci95[1]
    contract.write(result, tmp_path)
    unseen = stroke("p4", 4)
    corrected = correct(contract.read_model(tmp_path), unseen).corrected["x"]
    assert np.std(unseen["curr_x"] - corrected) < 1.05 * 0.05


def test_an_added_reader_reads_its_files(monkeypatch, tmp_path):
    from pido import recordings

    monkeypatch.setattr(recordings, "READERS", (*recordings.READERS, run("reader").READER))
    path = tmp_path / "part7.csv"
    path.write_text("ms;X;Y;IX;IY\n100;0.0;5.0;1.2;0.1\n110;0.1;5.0;1.3;0.1\n120;0.2;5.0;;0.1\n")
    recording = read_recording(path, machine="cmx600v")
    assert recording.part.part == "part7"
    np.testing.assert_allclose(recording.time, [0, 0.01, 0.02])
    np.testing.assert_allclose(recording["v_x"], 10.0)
    assert np.isnan(recording["curr_x"][2])


def test_an_added_machine_can_be_used_by_its_name(tmp_path):
    path = tmp_path / "machines.toml"
    path.write_text(block("machine"))
    machine = config.machine("portal", path)
    assert machine.axes["x"].v_max == 1000.0
    assert machine.spindle_max_deg_s == 24_000 * 6
    assert config.machine_config("portal", path).channels() == {"x": "X1"}
    assert machine.current_max_a == {"x": 60.0, "sp": 45.0}


def test_a_machine_that_is_not_known_comes_with_the_line_that_makes_it_known(tmp_path):
    with pytest.raises(SettingsError, match=r"'portal' is not known.*docs/extending\.md") as error:
        machine_of(Workspace.open(tmp_path), "portal")
    (line,) = re.findall(r"workspace\.toml: (\w+ = \"machines\.toml\")", str(error.value))
    (tmp_path / "workspace.toml").write_text(line)
    (tmp_path / "machines.toml").write_text(block("machine"))
    place = Workspace.open(tmp_path)
    assert machine_of(place, "portal").id == "portal"
    with pytest.raises(SettingsError, match=r"Known: cmx600v, .*portal.*Define it in .*machines\.toml\."):
        machine_of(place, "gantry")
