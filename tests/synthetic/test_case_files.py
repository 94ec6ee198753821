"""Cases and the files that the virtual mill writes, read back by the readers of real recordings."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pido.core.errors import SettingsError
from pido.recordings import read_recording
from pido.synthetic.cases import KINDS, draw_case
from pido.synthetic.families import impellers
from pido.synthetic.machine import produce
from pido.synthetic.mills import newer_vertical
from pido.synthetic.published import write_published
from pido.synthetic.sinumerik import write_sinumerik
from pido.synthetic.write import write_case


@pytest.fixture(scope="module")
def part():
    mill = newer_vertical()
    return produce(mill, mill.plan(impellers(mill.machine, 1)), seed=2, rate_hz=500.0)[0]


def test_a_case_is_written_as_part_folders_and_a_sealed_truth_apart(tmp_path):
    case = draw_case("stribeck_friction", 2.0, seed=1, parts=3)
    places = write_case(case, tmp_path)
    truth = json.loads((tmp_path / "sealed" / "truth.json").read_text())
    assert [e["mechanism"] for e in truth["effects"]] == ["stribeck_friction"]
    assert {"time", "effect_x", "acts_x", "noise_sp", "effect_1"} <= set(
        pq.read_schema(tmp_path / "sealed" / f"{places[0].name}.parquet").names
    )
    for place, made in zip(places, case.parts, strict=True):
        assert "stribeck" not in (place / "part.json").read_text()
        again = read_recording(place)
        assert again.part == made.recording.part
        for name in ("time", "pos_x", "curr_x", "curr_x_sim", "f_y_sim", "nc_line"):
            np.testing.assert_array_equal(again[name], made.recording[name])


def test_the_same_draw_gives_the_same_case():
    one, two = (draw_case("sensor_offset", 1.0, seed=9, parts=3) for _ in range(2))
    assert one.truth() == two.truth()
    np.testing.assert_array_equal(one.parts[0].recording["curr_y"], two.parts[0].recording["curr_y"])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_case_can_be_drawn(kind):
    case = draw_case(kind, 2.0, seed=4, parts=3)
    assert len(case.parts) == 3
    assert (case.effects == ()) == (kind == "none")


def test_an_unknown_kind_lists_the_known_ones():
    with pytest.raises(SettingsError, match="stribeck_friction"):
        draw_case("flux_capacitor")


def test_a_clock_fault_moves_every_current_of_the_file_by_the_same_delay():
    case = draw_case("time_misalignment", 2.0, seed=3, parts=3)
    assert {e.effect.axis for e in case.effects} == {"x", "y", "z", "sp"}
    assert len({e.amplitude for e in case.effects}) == 1


def test_a_wrong_input_changes_the_simulation_only_around_its_interval():
    case = draw_case("input_fault", 1.0, seed=3, parts=3)
    (e,) = case.effects
    for p in case.parts:
        changed = np.abs(p.truth.effect[e.effect.axis]) > 1e-6
        at = p.recording.time + 0.04
        near = (at > e.shape["t_start"] - 0.5) & (at < e.shape["t_end"] + 0.5) & (p.job.name == e.shape["part"])
        assert not (changed & ~near).any()
        assert changed.any() == (p.job.name == e.shape["part"])


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_what_is_wrong_with_an_input_is_in_a_part_that_a_proof_shows(seed):
    case = draw_case("input_fault", 1.0, seed=seed, parts=2)  # of the two or more, the last is kept
    assert case.effects[0].shape["part"] != case.parts[-1].job.name


def test_a_capture_in_the_controls_format_reads_back(part, tmp_path):
    again = read_recording(write_sinumerik(part, tmp_path / "IMP-01.json"))
    for name in ("pos_x", "pos_z", "curr_y", "curr_sp"):
        np.testing.assert_allclose(again[name], part.recording[name], atol=1e-6)
    assert again.sample_rate_hz == pytest.approx(500.0)
    blocks_made = np.flatnonzero(np.diff(part.recording["nc_line"]))
    blocks_read = np.flatnonzero(np.diff(again["nc_line"]))
    assert set(blocks_read) <= set(blocks_made)
    assert again.part.machine == part.recording.part.machine


def test_the_published_layout_reads_back(part, tmp_path):
    (trial,) = write_published([part], tmp_path)
    again = read_recording(trial)
    for name in ("pos_y", "curr_x", "curr_z"):
        np.testing.assert_allclose(again[name], part.recording[name], atol=1e-6)
    assert (tmp_path / "nc_data" / "IMP-01.nc").read_text() == part.job.program
    assert "IMP-01" in (tmp_path / "DoE.csv").read_text()


def test_a_control_writes_no_smoothed_recording(tmp_path):
    mill = newer_vertical()
    smooth = produce(mill, mill.plan(impellers(mill.machine, 1)), seed=2)[0]
    with pytest.raises(SettingsError, match="500"):
        write_sinumerik(smooth, tmp_path / "a.json")
