"""Process quantities of a part: what was recorded is learnt from; only what is missing is simulated or assumed."""

import numpy as np
import pytest

from pido.config import machine, material
from pido.core.columns import INPUTS, PROCESS
from pido.core.errors import RecordingError, SettingsError
from pido.core.machining import Job, Stock, Tool
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.preparation import prepare

MILL = machine("dmc60h")
NOTHING = Job(MILL, {})
CUT = Job(
    MILL, {"T10": Tool("T10", 10.0, 4)}, material=material("S235JR"), stock=Stock((0.0, 0.0, -30.0), (80.0, 60.0, 0.0))
)
LOADS = tuple(name for name in INPUTS if name in PROCESS)


def part(load=1.0, without=(), columns=LOADS):
    """A slot through CUT's raw part at 9.6 mm/s; loads that no simulation would find."""
    x = np.arange(-8, 70, 9.6 / 50)
    n = len(x)
    rest = dict.fromkeys(["v_y", "v_z", "a_x", "a_y", "a_z", "a_sp"], np.zeros(n))
    moves = {"pos_x": x, "pos_y": np.full(n, 30.03), "pos_z": np.full(n, -6.0), "v_x": np.full(n, 9.6)}
    moves |= {"v_sp": np.full(n, 19_200.0), "curr_x": np.ones(n), **rest}
    loads = {name: load * np.full(n, 10.0 + k) for k, name in enumerate(columns) if name not in without}
    return Recording(PartInfo(part="five", machine=MILL.id), {"time": np.arange(n) / 50.0, **moves, **loads})


def rows(samples, name):
    return samples.inputs[:, INPUTS.index(name)]


@pytest.mark.parametrize("job", [NOTHING, CUT], ids=["nothing known", "what was cut is known"])
@pytest.mark.parametrize("air_cut", [False, True])
def test_the_five_process_inputs_of_the_paper_are_taken_as_recorded_without_a_spindle_force(job, air_cut):
    samples, notes = prepare(part(), MILL, job, "d", air_cut=air_cut)
    for name in LOADS:
        assert set(rows(samples, name)) == {part()[name][0]}
    assert not notes


def test_only_what_was_not_recorded_is_simulated_and_the_note_says_which():
    given = part(without=("mrr_sim",), columns=(*LOADS, "f_sp_sim"))
    samples, notes = prepare(given, MILL, CUT, "d")
    assert np.median(rows(samples, "mrr_sim")) == pytest.approx(576.0, rel=1e-4)  # a_p 6 mm, a_e 10 mm, 9.6 mm/s
    assert set(rows(samples, "f_x_sim")) == {given["f_x_sim"][0]}
    (note,) = notes
    assert "mrr_sim alone; f_x_sim, f_y_sim, f_z_sim, f_sp_sim, m_sp_sim were recorded" in note


@pytest.mark.parametrize("air_cut", [False, True])
def test_a_load_that_was_recorded_is_no_air_cut_and_the_column_that_is_missing_is_named(air_cut):
    with pytest.raises(SettingsError) as refused:
        prepare(part(without=("mrr_sim",)), MILL, NOTHING, "d", air_cut=air_cut)
    said = str(refused.value)
    assert "mrr_sim was not recorded" in said
    assert "to simulate it material, tools, stock are not known" in said
    assert "set air_cut = true" not in said
    assert ("f_x_sim is up to 10 N" in said) == air_cut


def test_forces_without_any_removal_are_not_called_an_air_cut():
    """part() cuts with every load; here the removal alone says that nothing was removed."""
    given = part().with_columns(mrr_sim=np.zeros(len(part())))
    with pytest.raises(RecordingError) as refused:
        prepare(given, MILL, CUT, "d")
    said = str(refused.value)
    assert "f_x_sim is up to 10 N, but mrr_sim is 0 throughout" in said
    assert "air_cut = true" not in said
    samples, (note,) = prepare(given, MILL, CUT, "d", air_cut=True)
    assert set(rows(samples, "f_x_sim")) == {10.0}
    assert "f_x_sim is up to 10 N" in note
    with pytest.raises(RecordingError, match="air_cut = true"):
        prepare(part(load=0.0), MILL, CUT, "d")


def test_an_air_cut_may_have_recorded_that_nothing_pushed():
    given = part(load=0.0, without=("m_sp_sim", "mrr_sim"))
    samples, (note,) = prepare(given, MILL, NOTHING, "d", air_cut=True)
    assert not any(rows(samples, name).any() for name in LOADS)
    assert "m_sp_sim, mrr_sim alone; f_x_sim, f_y_sim, f_z_sim were recorded" in note
    with pytest.raises(SettingsError, match=r"m_sp_sim, mrr_sim were not recorded.*or set air_cut = true"):
        prepare(given, MILL, NOTHING, "d")


def test_a_column_without_a_single_value_was_not_recorded():
    empty = part().with_columns(f_z_sim=np.full(len(part()), np.nan))
    with pytest.raises(SettingsError, match="f_z_sim was not recorded"):
        prepare(empty, MILL, NOTHING, "d")
    samples, _ = prepare(empty, MILL, CUT, "d")
    assert np.isfinite(rows(samples, "f_z_sim")).all()


def test_a_part_without_any_is_refused_or_an_air_cut():
    with pytest.raises(SettingsError, match="no process quantities were recorded, and material, tools, stock are not"):
        prepare(part(columns=()), MILL, NOTHING, "d")
    _, notes = prepare(part(columns=()), MILL, NOTHING, "d", air_cut=True)
    assert notes == ("taken as an air cut: no forces, no removal",)
