"""Experiments as units of work: the same table however they are spread, stopped or continued."""

import json
from dataclasses import replace

import joblib
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from pido.config import machine
from pido.core.columns import INPUTS
from pido.core.errors import PidoError
from pido.core.samples import Samples
from pido.experiments import runner
from pido.experiments.base import MODULES, Unit, experiment
from pido.experiments.cells import FILES, RANDOM, TIME, cells, reduced
from pido.experiments.data import Fleet, load_fleet, runs
from pido.experiments.local_vs_global import CHOSEN
from pido.experiments.runner import measure, run_experiment
from pido.experiments.score import changes
from pido.experiments.variants import BASELINE, DELIVERED, OTHERS
from pido.feature_space.density import occupancy
from pido.feature_space.grid import SAMPLING_GRID
from pido.reports.experiment import _strokes


def part(name: str, seed: int, n: int = 360) -> Samples:
    """Rows whose x current is Coulomb friction and whose spindle current follows the torque; y and z are noise."""
    rng = np.random.default_rng(seed)
    phi = np.cumsum(rng.normal(0.0, 0.1, n))
    inputs = np.zeros((n, len(INPUTS)))
    inputs[:, 0], inputs[:, 1] = 6 * np.cos(phi), 6 * np.sin(phi)
    inputs[:, 6], inputs[:, 11] = 19_200.0, 2.0 + np.sin(np.arange(n) / 20)
    ar = np.full(n, 12.0) + rng.normal(0, 0.5, n)
    inputs[:, 12] = ar * 6
    direction = np.zeros((n, 4))
    direction[:, :2], direction[:, 3] = np.sign(inputs[:, :2]), 1.0
    currents = rng.normal(0, 0.02, (n, 4))
    currents[:, 0] += 0.5 * direction[:, 0]
    currents[:, 3] += 0.3 * inputs[:, 11]
    return Samples.real(inputs, ar, currents, direction, name, np.arange(n))


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return Fleet("made", machine("dmc60h"), {f"p{k}": part(f"p{k}", k) for k in range(4)})


@pytest.mark.thorough
def test_the_table_does_not_depend_on_the_number_of_workers(fleet, tmp_path):
    options = {"repeats": 2, "quick": True, "seed": 3}
    one = run_experiment("importance", fleet, folder=tmp_path / "one", **options).table
    four = run_experiment("importance", fleet, folder=tmp_path / "four", workers=4, **options).table
    pd.testing.assert_frame_equal(one, four, check_exact=True)


def test_a_worker_is_one_core_and_leaves_the_others_as_they_were(fleet, monkeypatch):
    counted = []
    monkeypatch.delenv("LOKY_MAX_CPU_COUNT", raising=False)
    before = joblib.cpu_count()
    asked = replace(experiment("importance"), measure=lambda *_: counted.append(joblib.cpu_count()) or [])
    monkeypatch.setattr(runner, "experiment", lambda name: asked)
    measure("importance", fleet, 0, Unit("one", {}))
    assert counted == [1]
    assert joblib.cpu_count() == before


@pytest.mark.slow
def test_the_table_is_the_same_on_a_dask_cluster(fleet, tmp_path):
    options = {"repeats": 2, "quick": True}
    here = run_experiment("importance", fleet, folder=tmp_path / "here", **options).table
    there = run_experiment("importance", fleet, folder=tmp_path / "there", workers=2, cluster="local", **options).table
    pd.testing.assert_frame_equal(here, there, check_exact=True)


@pytest.mark.slow
def test_all_rivals_are_measured_in_the_same_cells(fleet, tmp_path):
    table = run_experiment("rivals", fleet, folder=tmp_path, repeats=1, quick=True).table
    assert set(table.variant) == {"real", "PiA+PiE", *DELIVERED, *OTHERS}
    assert table.groupby("variant").size().nunique() == 1
    assert np.isfinite(table.rmse).all()


def test_a_run_that_was_stopped_continues_with_what_is_left(fleet, tmp_path, monkeypatch):
    whole = run_experiment("importance", fleet, folder=tmp_path / "whole", repeats=3, quick=True).table
    calls = []

    def failing(name, data, seed, unit):
        if len(calls) == 1:
            raise KeyboardInterrupt
        calls.append(unit.key)
        return measure(name, data, seed, unit)

    with monkeypatch.context() as m:
        m.setattr(runner, "measure", failing)
        with pytest.raises(KeyboardInterrupt):
            run_experiment("importance", fleet, folder=tmp_path / "cut", repeats=3, quick=True)
    left = []
    again = run_experiment(
        "importance", fleet, folder=tmp_path / "cut", repeats=3, quick=True,
        on_progress=lambda done, of, what: left.append(of - done),
    )  # fmt: skip
    assert again.found == 1
    assert left == [2, 1, 0]
    pd.testing.assert_frame_equal(again.table, whole, check_exact=True)


def test_more_repeats_add_to_those_that_are_there(fleet, tmp_path):
    few = run_experiment("importance", fleet, folder=tmp_path, repeats=1, quick=True)
    more = run_experiment("importance", fleet, folder=tmp_path, repeats=2, quick=True)
    assert more.found == few.units
    pd.testing.assert_frame_equal(more.table[more.table.repeat == 0].reset_index(drop=True), few.table)


def test_forests_find_the_inputs_that_the_currents_were_made_of(fleet, tmp_path):
    table = run_experiment("importance", fleet, folder=tmp_path, repeats=1, quick=True).table
    first = {a: g.loc[g.permutation.idxmax(), "input"] for a, g in table.groupby("axis") if a in ("x", "sp")}
    assert first == {"x": "v_x", "sp": "m_sp_sim"}


@pytest.mark.parametrize("name", [n for n in MODULES if n != "concealed"])
def test_every_experiment_plans_each_unit_once_with_values_that_json_can_hold(name, fleet):
    from pido.experiments.base import Options

    what = experiment(name)
    units = list(what.plan(fleet, Options(repeats=2)))
    assert units
    assert len({u.key for u in units}) == len(units)
    for unit in units:
        assert json.loads(json.dumps(dict(unit.params))) == dict(unit.params)
    assert what.id == name


def test_an_ablation_of_chosen_percents_measures_those_and_nothing_else(fleet, tmp_path):
    result = run_experiment(
        "ablation", fleet, folder=tmp_path, repeats=1, quick=True, percents=(40, 20), delivered=True
    )
    assert set(result.table.step) == {20, 40}
    assert set(result.table.scenario) == {TIME, RANDOM}
    assert set(result.table.variant) == set(DELIVERED)
    assert "at 20, 40 % of a file" in result.outcome.verdict
    most = experiment("ablation").summarise(result.table.assign(step=result.table.step + 50)).verdict
    assert "at 70, 90 % of a file" in most
    assert "nan" not in most
    said = " ".join(result.outcome.differs)
    assert "between a recorded row and a similar one (as in SMOGN)" in said
    assert "outside the coming part's bins" in said
    with pytest.raises(PidoError, match="1 to 100"):
        run_experiment("ablation", fleet, folder=tmp_path, repeats=1, quick=True, percents=(0,))


def test_the_verdict_of_an_ablation_names_both_baselines_and_does_not_hide_the_worse_one():
    errors = {"real": 1.0, "PiA+PiE": 1.1, "real + direction": 2.0, "PiDO": 1.5}
    table = pd.DataFrame(
        [{"scenario": TIME, "repeat": k, "step": 10, "space": "C", "axis": axis, "variant": v, "baseline": BASELINE[v],
          "rmse": rmse + k / 100, "mae": 1.0, "error_99": 1.0, "peak": 1.0, "at_changes": 1.0, "even": 1.0,
          "generated": 1}
         for k in range(12) for axis in ("x", "y") for v, rmse in errors.items()]
    )  # fmt: skip
    told = experiment("ablation").summarise(table)
    without, real = told.verdict.split(" PiDO as delivered ")
    assert "against `real + direction` (the same models without its rows)" in without
    assert "0 significant deterioration(s) and 2 significant improvement(s) in 2 cells" in without
    assert "+24.3 %" in without  # 0.5 of 2.055 A
    assert "against `real` (models as printed, on real rows): 2 significant deterioration(s)" in real
    assert "in the worst cell -47.4 % (axis x, first rows, 10 %, space C)" in real  # 0.5 of 1.055 A


@pytest.mark.thorough
def test_pages_say_how_many_sets_were_left_out_and_fit_no_order_that_shares_do_not_determine():
    left = pd.DataFrame(
        {
            "split": "one left out", "where": "all", "train": "a, b", "test": ["c", "c", "d", "d"], "axis": "x",
            "model": ["constant", CHOSEN] * 2, "rmse": 1.0, "r2": 0.5, "hidden": "", "terms": "held",
        }
    )  # fmt: skip
    told = experiment("local-vs-global").summarise(left)
    assert "here it is 2 of 4 sets left out, each once" in told.differs[-1]
    rows = [
        {"train": t, "distance": d, "real": r, "repeat": 0, "axis": "x", "pia": a, "pie": e,
         "rmse": 1 - a * r / 1e4 + e}
        for t, d in (("a", 1.0), ("b", 2.0)) for r in (0, 30, 60, 100) for a in (0, 8) for e in (0, 5)
    ]  # fmt: skip
    orders, functions, *_ = experiment("shares").summarise(pd.DataFrame(rows)).tables
    assert orders.table["order"].tolist() == [1, 2, 3]
    assert "ours of order 3" in functions.text[0]
    assert "pie, ours" in functions.table


def test_lines_of_a_plot_are_told_apart_however_many_there_are():
    strokes = _strokes(20)
    assert len(set(strokes)) == 20


def test_an_unknown_experiment_names_the_known_ones(fleet, tmp_path):
    with pytest.raises(PidoError, match="importance, weighting"):
        run_experiment("nothing", fleet, folder=tmp_path)


def test_first_rows_grow_in_time_and_random_rows_are_nested(fleet):
    for scenario in (TIME, RANDOM):
        steps = list(cells(fleet, scenario, 0, 0, (10, 50, 100)))
        assert [len(c.train) for c in steps] == [36, 180, 360]
        assert set(steps[0].train.row) < set(steps[1].train.row)
        assert steps[0].trained_on != steps[0].tested_on
    assert next(iter(cells(fleet, TIME, 0, 0, (10,)))).train.row.tolist() == list(range(36))


def test_files_are_added_one_by_one_and_the_next_one_tests(fleet):
    steps = list(cells(fleet, FILES, 0, 5, (1, 2, 3)))
    assert [len(c.train) for c in steps] == [360, 720, 1080]
    for cell in steps:
        assert cell.tested_on not in set(cell.train.part)
    first = next(cells(fleet, TIME, 0, 5, (100,)))
    assert (first.trained_on, first.tested_on) == (steps[0].trained_on, steps[0].tested_on)


def test_no_bin_keeps_more_rows_than_the_limit_and_small_bins_keep_all(fleet):
    samples = fleet.sets["p1"]
    before = occupancy(samples.reduced, SAMPLING_GRID)
    after = occupancy(reduced(samples, 7, np.random.default_rng(0)).reduced, SAMPLING_GRID)
    np.testing.assert_array_equal(after.count, np.minimum(before.count, 7))


def test_the_load_changes_at_a_step_of_the_current():
    samples = part("p", 0, 200)
    samples.currents[:] = 0.0
    samples.currents[120:, 0] = 1.0
    where = np.flatnonzero(changes(samples)[:, 0])
    assert 120 in where
    assert (np.abs(where - 120) <= 5).all()


def test_a_program_that_was_run_three_times_is_cut_into_its_runs(real_data):
    path = real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv"
    if not path.is_file():
        pytest.skip(f"{path} is missing")
    fleet = load_fleet(str(path), "impellers")
    assert list(fleet.sets) == ["run 1", "run 2", "run 3"]
    begin = np.array([s.row[0] for s in fleet.sets.values()]) / 50.0
    assert (np.abs(begin - [2.3, 84.3, 164.9]) < 0.3).all()  # where the cuts start, as published with the data


def test_motion_that_does_not_repeat_is_one_run():
    from pido.core.part import PartInfo
    from pido.core.recording import Recording

    rng, t = np.random.default_rng(0), np.arange(0, 60, 0.02)
    columns = {"time": t} | {f"v_{a}": np.repeat(rng.normal(0, 5, 30), 100) for a in "xyz"}
    assert len(runs(Recording(PartInfo(part="p", machine="dmc60h"), columns))) == 1


def test_the_command_runs_an_experiment_and_leaves_a_page(tmp_path, monkeypatch, fleet):
    from pido.cli.experiment import command

    monkeypatch.setattr(runner, "load_fleet", lambda *a, **k: fleet)
    call = [
        "importance",
        "--data",
        "made",
        "--quick",
        "--repeats",
        "1",
        "--workers",
        "1",
        "--out",
        str(tmp_path),
        "--json",
    ]
    answer = CliRunner().invoke(command, call)
    assert answer.exit_code == 0, answer.output
    told = json.loads(answer.stdout)
    assert told[0]["experiment"] == "importance"
    page = (tmp_path / "importance" / "made" / "report.html").read_text(encoding="utf-8")
    assert "What differs from the paper" in page
