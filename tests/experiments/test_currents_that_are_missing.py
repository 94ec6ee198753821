"""An axis without a current costs that axis, and no other; where nothing can be measured, it is said why."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from pido.cli.experiment import command
from pido.core.errors import PidoError
from pido.experiments import extended_equation
from pido.experiments.data import DataError, load_fleet
from pido.experiments.runner import run_experiment
from pido.recordings.folder import write_folder
from tests.experiments.test_experiments_run import Fleet, part
from tests.plain_parts import parts

ALL = ("curr_x", "curr_y", "curr_z", "curr_sp")


def written(folder, change):
    """Two parts of one machine with `change` done to their columns."""
    for recording in parts(2):
        columns = dict(recording.columns)
        change(columns)
        recording = type(recording)(recording.part, columns)
        write_folder(recording, folder / recording.part.part)
    return folder


def constant(*names):
    return lambda columns: columns.update({name: np.full(len(columns["time"]), 0.1) for name in names})


def missing(columns):
    columns["curr_z"] = np.full(len(columns["time"]), np.nan)


@pytest.mark.parametrize("change", [lambda columns: columns.pop("curr_z"), missing, constant("curr_z")])
def test_an_axis_without_a_current_is_left_out_with_a_note_and_the_others_are_measured(change, tmp_path):
    whole = load_fleet(str(written(tmp_path / "whole", lambda columns: None)), "design")
    fleet = load_fleet(str(written(tmp_path / "data", change)), "design")
    assert any("without a current of axis z" in note for note in fleet.notes)
    for name, samples in fleet.sets.items():
        np.testing.assert_array_equal(samples.currents[:, [0, 1, 3]], whole.sets[name].currents[:, [0, 1, 3]])
    table = run_experiment("importance", fleet, folder=tmp_path / "out", repeats=1, quick=True).table
    assert set(table.axis) == {"x", "y", "sp"}


def test_where_no_current_changes_it_is_said(tmp_path):
    data = written(tmp_path / "data", constant(*ALL))
    answer = CliRunner().invoke(command, ["importance", "--quick", "--data", str(data), "--out", str(tmp_path / "o")])
    assert isinstance(answer.exception, DataError)
    assert "no axis has a current that changes" in str(answer.exception)
    assert "'curr_x' is 0.1 throughout" in str(answer.exception)
    none = written(tmp_path / "none", lambda columns: [columns.pop(name) for name in ALL])
    with pytest.raises(DataError, match="no axis has a current that can be used"):
        load_fleet(str(none), "design")
    with pytest.raises(DataError, match="no linear axis that feeds has a current"):
        extended_equation.run(data)


def test_a_fault_of_an_input_is_named_and_is_no_missing_sample(tmp_path):
    data = written(tmp_path / "data", lambda columns: columns.update(v_x=np.full(len(columns["time"]), np.nan)))
    with pytest.raises(PidoError, match=r"'v_x' is missing in 100\.0% of the samples"):
        load_fleet(str(data), "design")


def test_sets_too_small_to_measure_anything_are_said_and_nothing_is_written(tmp_path):
    small = {f"p{k}": part(f"p{k}", k, 20) for k in range(2)}
    whole = load_fleet(str(written(tmp_path / "data", lambda columns: None)), "design")
    with pytest.raises(DataError, match=r"made: none of the \d+ units of 'importance' could be measured"):
        run_experiment("importance", Fleet("made", whole.machine, small), folder=tmp_path / "o", repeats=1)
    assert not (tmp_path / "o" / "results.parquet").exists()
    assert json.loads((tmp_path / "o" / "experiment.json").read_text())["data"] == "made"
