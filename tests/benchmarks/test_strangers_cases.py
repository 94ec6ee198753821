"""The stranger's cases keep the contract, say the truth, and are the same for the same seed."""

import doctest
import importlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.sealed_truth import Case, Task
from benchmarks.stranger.cases import MENU, SHARES, Size, draw_case, plan
from benchmarks.stranger.fairness import acting
from benchmarks.stranger.files import write_case
from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.recordings import read_recording
from tests.benchmarks.written_cases import (
    assert_nothing_that_is_shown_names_the_case,
    assert_they_keep_the_contract_of_columns,
    assert_two_have_the_same_bytes,
)

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
    assert_they_keep_the_contract_of_columns(places)


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
    assert_nothing_that_is_shown_names_the_case(case, places)


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
    assert_two_have_the_same_bytes(lambda *where: write_case(draw_case(TASKS[0], SMALL), *where), tmp_path)


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
