"""The newcomer's cases keep the contract, say the truth, are fair, and are the same for the same seed."""

import doctest
import importlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.newcomer import fair
from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.editions import EDITIONS
from benchmarks.newcomer.fair import acting
from benchmarks.newcomer.folders import write_case
from benchmarks.newcomer.machines import draw_machine
from benchmarks.newcomer.parts import Length, draw_parts
from benchmarks.newcomer.planned import plan
from benchmarks.sealed_truth import Case, Task, UnfairError
from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.recordings import read_recording
from tests.benchmarks.written_cases import (
    assert_nothing_that_is_shown_names_the_case,
    assert_they_keep_the_contract_of_columns,
    assert_two_have_the_same_bytes,
)

MENU, SHARES = EDITIONS[1].menu, EDITIONS[1].shares
SMALL = Length(parts=(3, 3), seconds=(25.0, 40.0), rows=40_000, fine_rows=40_000)
TASKS = (
    Task("single", "coulomb_friction", 0.5, 3),
    Task("single", "tool_wear", 4.0, 3),
    Task("pair", "inertia and coolant_load", 2.0, 3),
    Task("wrong coefficient", "viscous_friction", 2.0, 3),
    Task("data fault", "sensor_gain", 2.0, 3),
    Task("data fault", "sensor_clipping", 2.0, 3),
    Task("data fault", "time_misalignment", 2.0, 3),
    Task("data fault", "input_fault", 2.0, 3),
    Task("confined to a region", "viscous_friction", 4.0, 3),
    *(Task("outside the vocabulary", name, 2.0, 3) for name in MENU["outside the vocabulary"][::6]),
    Task("confounded", "inertia", 2.0, 3),
    Task("clean", "", 1.0, 3),
)
FITTED = [t for t in TASKS if t.group not in ("clean", "data fault")]


@pytest.fixture(scope="module", params=TASKS, ids=lambda t: f"{t.group} {t.strength}")
def drawn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, list[Path], Path]:
    folder = tmp_path_factory.mktemp("case")
    case = draw_case(request.param, SMALL)
    return case, write_case(case, folder / "parts", folder / "truth"), folder / "truth"


def test_a_case_keeps_the_contract_of_columns_and_part_json(drawn):
    _, places, _ = drawn
    assert len(places) == 4
    assert_they_keep_the_contract_of_columns(places)


def test_the_truth_is_what_was_recorded_beside_the_simulation_in_the_unseen_part_too(drawn):
    case, places, sealed = drawn
    truth = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
    assert truth["unseen"] == places[-1].name
    assert (case.task.group == "clean") == (not truth["effects"])
    concealed = {e["axis"] for e in truth["effects"]}
    tables = [pd.read_parquet(sealed / f"{place.name}.parquet") for place in places]
    for place, secret in zip(places, tables, strict=True):
        recording = read_recording(place)
        assert len(secret) == len(recording)
        for a in AXES:
            assert secret[f"acts_{a}"].dtype == bool
            assert a in concealed or not secret[f"effect_{a}"].to_numpy().any()
            if truth["what"] != "sensor_clipping":
                rest = recording[CURRENT[a]] - recording[CURRENT_SIM[a]] - secret[f"effect_{a}"].to_numpy()
                # what is left is noise: it does not go with the simulation
                assert abs(np.corrcoef(rest, recording[CURRENT_SIM[a]])[0, 1]) < 0.35
    if truth["effects"]:
        assert tables[-1][f"acts_{truth['effects'][0]['axis']}"].any()


@pytest.mark.parametrize("task", FITTED, ids=lambda t: f"{t.group} {t.strength}")
def test_a_strength_is_rms_of_effect_over_rms_of_noise_where_it_acts(task):
    case = draw_case(task, SMALL)
    for one in case.effects if len({e.axis for e in case.effects}) == len(case.effects) else ():
        # by the same threshold as the truth's: over all parts, the unseen one too
        whole = acting(np.concatenate(list(case.effect[one.axis])))
        effect = np.concatenate(list(case.effect[one.axis])[:-1])
        acts = whole[: len(effect)]
        recorded, sim = (np.concatenate(list(c[one.axis])[:-1]) for c in (case.recorded, case.sim))
        rest = recorded - sim - effect
        ratio = np.sqrt(np.mean(effect[acts] ** 2) / np.mean(rest[acts] ** 2))
        assert ratio == pytest.approx(task.strength, rel=0.05)


def test_nothing_that_is_shown_names_the_case(drawn):
    case, places, _ = drawn
    assert_nothing_that_is_shown_names_the_case(case, places)


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    assert_two_have_the_same_bytes(lambda *where: write_case(draw_case(TASKS[1], SMALL), *where), tmp_path)


def test_a_plan_meets_every_group_by_its_share_and_every_mechanism_in_turn():
    tasks = plan(100, seed=1)
    counts = {g: sum(t.group == g for t in tasks) for g in SHARES}
    assert sum(SHARES.values()) == 50
    assert counts == {g: 2 * n for g, n in SHARES.items()}
    assert {t.what for t in tasks if t.group == "single"} == set(MENU["single"])
    assert {t.strength for t in tasks if t.group == "single"} == {0.5, 1.0, 2.0, 4.0}
    assert tasks[:30] == plan(30, seed=1)
    assert tasks[:30] != plan(30, seed=2)


@pytest.mark.parametrize("kind", [k for e in EDITIONS.values() for k in e.kinds], ids=lambda k: k.name)
def test_a_machine_stays_in_its_travel_and_its_columns_belong_to_one_motion(kind):
    rng = np.random.default_rng(5)
    for part in draw_parts(draw_machine(kind, rng), SMALL, straight=False, rng=rng):
        assert (part.pos > 0).all()
        assert (part.pos < part.machine.travel).all()
        np.testing.assert_allclose(np.diff(part.pos, axis=0), part.v[1:] * part.machine.dt, atol=1e-9)
        assert (np.abs(part.a) < 1.2 * part.machine.a_max).all()
        # power of the cut: torque times speed of the spindle is specific force times removal, up to chip thickness
        power = part.m * np.deg2rad(part.v_sp)
        specific = 1000 * power[part.engaged] / part.mrr[part.engaged]
        assert np.all(specific > 0.3 * part.machine.specific_n_mm2)
        assert np.all(specific < 5 * part.machine.specific_n_mm2)


def test_an_effect_that_a_plain_law_explains_is_not_outside_the_vocabulary():
    rng = np.random.default_rng(0)
    v = rng.normal(size=500)
    laws = {"coulomb_friction": np.sign(v)[:, None], "viscous_friction": v[:, None]}
    fair.require_foreign(v**2 - 1, laws)
    with pytest.raises(UnfairError, match="explains most"):
        fair.require_foreign(v + 0.2 * rng.normal(size=500), laws)


def test_an_effect_that_the_unseen_part_or_most_parts_do_not_show_is_unfair():
    here, gone = np.ones(300), np.zeros(300)
    fair.require_seen([here, here, here, here])
    with pytest.raises(UnfairError, match="unseen"):
        fair.require_seen([here, here, here, gone])
    with pytest.raises(UnfairError, match="too few parts"):
        fair.require_seen([here, here, gone, here])


def test_two_laws_that_differ_less_than_the_noise_are_unfair():
    v = np.linspace(1.0, 1.2, 400)
    laws = {"spindle_windage": (v**2)[:, None]}
    with pytest.raises(UnfairError, match="spindle_windage"):
        fair.require_told("spindle_viscous_drag", v, 1.0, 1.0, laws)
    fair.require_told("spindle_viscous_drag", v, 0.01, 1.0, laws)


def test_a_box_that_holds_hardly_any_motion_is_unfair():
    law, moving = np.ones(1000), np.ones(1000, bool)
    fair.require_confined(law, np.arange(1000) < 100, moving)
    with pytest.raises(UnfairError, match="too small"):
        fair.require_confined(law, np.arange(1000) < 10, moving)


@pytest.mark.parametrize("name", ["newcomer.fair", "newcomer.world", "newcomer.cutting", "sealed_truth"])
def test_worked_numbers_of_the_docstrings_are_right(name):
    found = doctest.testmod(importlib.import_module(f"benchmarks.{name}"))
    assert found.attempted > 0
    assert found.failed == 0
