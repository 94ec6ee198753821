"""The stranger's cases keep the contract, say the truth, and are the same for the same seed."""

import doctest
import importlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.sealed_truth import Task
from benchmarks.stranger.cases import MENU, SHARES, Size, draw_case, plan
from benchmarks.stranger.fairness import acting
from benchmarks.stranger.files import write_case
from benchmarks.stranger.sealed import Case
from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM, MOTION, PROCESS, TIME, UNITS
from pido.recordings import read_recording

SMALL = Size(parts=(3, 3), seconds=(25.0, 30.0))
TASKS = (
    Task("single", "viscous_friction", 2.0, 1),
    Task("single", "tool_wear", 4.0, 1),
    Task("pair", "", 4.0, 1),
    Task("clean", "", 1.0, 1),
    Task("wrong coefficient", "coulomb_friction", 2.0, 1),
    Task("data fault", "time_misalignment", 2.0, 1),
    Task("data fault", "input_fault", 2.0, 1),
    Task("data fault", "sensor_clipping", 2.0, 1),
    Task("data fault", "sensor_offset", 2.0, 1),
    Task("confined to a region", "viscous_friction", 4.0, 1),
    *(Task("outside the vocabulary", name, 4.0, 1) for name in MENU["outside the vocabulary"][:2]),
    Task("confounded", "inertia", 2.0, 1),
)


@pytest.fixture(scope="module", params=TASKS, ids=lambda t: t.group)
def drawn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, list[Path], Path]:
    folder = tmp_path_factory.mktemp("case")
    case = draw_case(request.param, SMALL)
    return case, write_case(case, folder / "parts", folder / "truth"), folder / "truth"


def test_a_case_keeps_the_contract_of_columns_and_part_json(drawn):
    _, places, _ = drawn
    for place in places:
        recording = read_recording(place)
        assert {TIME, *MOTION, *PROCESS, *CURRENT.values(), *CURRENT_SIM.values()} <= set(recording.columns)
        assert set(recording.columns) <= set(UNITS)
        assert np.all(np.diff(recording.time) > 0)
        assert all(np.isfinite(values).all() for values in recording.columns.values())


def test_the_truth_has_a_row_for_every_sample_and_is_what_was_recorded_beside_the_simulation(drawn):
    case, places, sealed = drawn
    truth = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
    assert truth["unseen"] == places[-1].name
    for place in places:
        recording, secret = read_recording(place), pd.read_parquet(sealed / f"{place.name}.parquet")
        assert len(secret) == len(recording)
        concealed = {e["axis"] for e in truth["effects"]}
        for a in AXES:
            assert secret[f"acts_{a}"].dtype == bool
            assert a in concealed or not secret[f"effect_{a}"].to_numpy().any()
            if truth["what"] != "sensor_clipping":
                rest = recording[CURRENT[a]] - recording[CURRENT_SIM[a]] - secret[f"effect_{a}"].to_numpy()
                # what is left is noise: it does not go with the simulation
                simulated = recording[CURRENT_SIM[a]]
                assert abs(np.corrcoef(rest, simulated)[0, 1]) < 0.35
                assert np.std(rest) < np.std(simulated)
    assert (case.task.group == "clean") == (not truth["effects"])


def test_nothing_that_is_shown_names_the_case(drawn):
    case, places, _ = drawn
    for place in places:
        assert sorted(p.name for p in place.iterdir()) == ["part.json", "recording.parquet"]
        text = (place / "part.json").read_text(encoding="utf-8")
        assert not any(word and word in text for word in (case.task.what, case.task.group, case.task.key))


@pytest.mark.parametrize(
    "task", [t for t in TASKS if t.group not in ("clean", "pair", "data fault")], ids=lambda t: t.group
)
def test_a_strength_is_rms_of_effect_over_rms_of_noise_where_it_acts(task):
    case = draw_case(task, SMALL)
    axis = case.effects[0].axis
    effect = np.concatenate(case.effect[axis][:-1])
    rest = np.concatenate(case.recorded[axis][:-1]) - np.concatenate(case.sim[axis][:-1]) - effect
    acts = acting(effect)
    ratio = np.sqrt(np.mean(effect[acts] ** 2) / np.mean(rest[acts] ** 2))
    assert ratio == pytest.approx(case.task.strength, rel=0.05)


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    written = [
        write_case(draw_case(TASKS[0], SMALL), tmp_path / name, tmp_path / f"truth {name}") for name in ("one", "two")
    ]
    for one, two in zip(*written, strict=True):
        assert all((one / n).read_bytes() == (two / n).read_bytes() for n in ("recording.parquet", "part.json"))
    truths = [(tmp_path / f"truth {name}" / "truth.json").read_bytes() for name in ("one", "two")]
    assert truths[0] == truths[1]


def test_a_plan_meets_every_group_by_its_share_and_every_mechanism_in_turn():
    tasks = plan(100, seed=1)
    counts = {g: sum(t.group == g for t in tasks) for g in SHARES}
    assert counts == {g: 2 * n for g, n in SHARES.items()}
    assert {t.what for t in tasks if t.group == "single"} == set(MENU["single"])
    assert tasks[:30] == plan(30, seed=1)


@pytest.mark.parametrize("name", ["friction", "fairness"])
def test_worked_numbers_of_the_docstrings_are_right(name):
    found = doctest.testmod(importlib.import_module(f"benchmarks.stranger.{name}"))
    assert found.attempted > 0
    assert found.failed == 0
