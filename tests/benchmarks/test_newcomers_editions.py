"""The first edition of the newcomer's cases stays what it was when it was drawn first; the second lies outside."""

import doctest
import hashlib
import importlib

import numpy as np
import pytest

from benchmarks.newcomer import fair
from benchmarks.newcomer.assembly import logged
from benchmarks.newcomer.catalogue import CONCEALED
from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.editions import EDITIONS, OUTSIDE
from benchmarks.newcomer.folders import write_case
from benchmarks.newcomer.machines import draw_machine
from benchmarks.newcomer.parts import Length, draw_parts
from benchmarks.newcomer.planned import plan
from benchmarks.newcomer.second.textbook import require_beyond
from benchmarks.newcomer.world import Concealed, World, draw_terms, simulate
from benchmarks.sealed_truth import Task, UnfairError
from pido.core.arrays import Float1D
from pido.core.axes import AXES
from tests.benchmarks.newcomers_laws import books, likeness
from tests.benchmarks.written_cases import (
    assert_nothing_that_is_shown_names_the_case,
    assert_they_keep_the_contract_of_columns,
)

SMALL = Length(parts=(3, 3), seconds=(25.0, 40.0), rows=40_000, fine_rows=40_000)


@pytest.mark.parametrize(
    ("seed", "digest"), [(1, "eabe6ce024c0d6d3"), (2, "b36557e6d1bba37d"), (63, "efdea9ea28cf8dbc")]
)
def test_the_first_edition_plans_what_it_planned_before_there_was_another(seed, digest):
    keys = "".join(t.key for t in plan(150, seed))
    assert hashlib.sha256(keys.encode()).hexdigest()[:16] == digest


DRAWN = {  # rows, and rms of the recorded current of x, y, z, sp, A
    "bedeb5c31d2e": (31354, 4.0459171, 2.4529874, 2.4672771, 2.7970483),
    "81920cb5884e": (2805, 0.4319202, 0.60691561, 1.3473056, 0.24661763),
    "e17e4f580b24": (31713, 2.3639817, 4.810558, 6.6612669, 2.784801),
    "f9740b12e362": (40000, 2.0565798, 2.1495704, 3.5917055, 4.1195507),
    "1039c5ed52fc": (30685, 2.8638976, 3.3230005, 6.129364, 2.3358621),
    "05901805e2bd": (39996, 3.9079275, 4.7849381, 4.1056858, 3.6411229),
    "334c3b47af3c": (40000, 1.7204377, 2.0127047, 1.5139312, 2.8465876),
    "4cc209667109": (11987, 1.617128, 3.5853119, 6.7525838, 3.3172787),
}
"""By the key of the first case of each group of plan(50, 1), as drawn by the code that knew one edition only."""


@pytest.mark.parametrize("key", DRAWN)
def test_the_first_edition_draws_what_it_drew_before_there_was_another(key):
    task = next(t for t in plan(50, 1) if t.key == key)
    case = draw_case(task, SMALL)
    rms = [np.sqrt(np.mean(np.concatenate(list(case.recorded[a])) ** 2)) for a in AXES]
    # not a digest of bytes: another processor's sine may differ in its last digit, and a converter's step with it
    assert [sum(len(p.t) for p in case.parts), *rms] == pytest.approx(DRAWN[key], rel=1e-6)


FIRST, SECOND = EDITIONS[1], EDITIONS[2]


def test_the_second_edition_has_machines_and_laws_of_its_own():
    assert len(SECOND.kinds) >= 6
    assert not {k.name for k in SECOND.kinds} & {k.name for k in FIRST.kinds}
    assert len(SECOND.outside) >= 20
    assert not set(SECOND.outside) & {*FIRST.outside, *CONCEALED}


def test_a_third_of_the_second_edition_is_outside_the_vocabulary():
    hand = sum(SECOND.shares.values())
    tasks = plan(2 * hand, 1, edition=2)
    outside = [t for t in tasks if t.group == "outside the vocabulary"]
    assert len(outside) == 2 * hand / 3
    assert {t.what for t in outside} == set(SECOND.outside)  # each in turn
    assert all(1 <= t.strength <= 5 for t in outside)
    boxes = [e.shares["confined to a region"] / sum(e.shares.values()) for e in (FIRST, SECOND)]
    assert boxes[1] > boxes[0]
    assert not {t.key for t in tasks} & {t.key for t in plan(2 * hand, 1)}
    assert tasks[:30] == plan(30, 1, edition=2)


WORLDS = ((1, 2), (6, 4), (4, 1), (5, 3), (0, 5))
"""Kinds of the second edition, and seeds."""


@pytest.fixture(scope="module")
def drawn() -> list[World]:
    length, worlds = Length(parts=(5, 5), seconds=(60.0, 60.0), rows=60_000, fine_rows=120_000), []
    for kind, seed in WORLDS:
        rng = np.random.default_rng(seed)
        parts = draw_parts(draw_machine(SECOND.kinds[kind], rng), length, straight=False, rng=rng)
        worlds.append(simulate(parts, draw_terms(parts, rng)))
    return worlds


def _current(world: World, law: Concealed, axis: str) -> list[Float1D]:
    """Per part, A, at the logged samples."""
    return logged(world.machine, law.law(world, axis, np.random.default_rng(3)).columns)


@pytest.mark.parametrize("on", ["plane", "sp"])
def test_a_law_of_the_second_edition_is_no_other_one_of_either(on, drawn):
    of = {n: law for n, law in OUTSIDE.items() if law.on == on}
    alike = []
    for world in drawn:
        axis = "sp" if on == "sp" else "xyz"[world.machine.kind.plane[0]]
        alike.append(likeness([np.concatenate(_current(world, law, axis)) for law in of.values()]))
    # in one motion (always the same way, say) two laws may be one; in most of them they are not
    usual = np.median(alike, axis=0)[[name in SECOND.outside for name in of]]
    assert usual.max() < 0.75


def test_no_law_outside_the_vocabulary_is_one_that_textbooks_always_explain(drawn, monkeypatch):
    monkeypatch.setattr(fair, "MOST_ROWS", 3_000)
    open_to_question = set(SECOND.outside)
    for world in drawn:
        axes = {"plane": "xyz"[world.machine.kind.plane[0]], "sp": "sp"}
        said = {axis: books(world, axis) for axis in axes.values()}
        for name in sorted(open_to_question):
            axis = axes[SECOND.outside[name].on]
            plain, whole = said[axis]
            try:
                current = _current(world, SECOND.outside[name], axis)
                fair.require_seen(current)
                fair.require_foreign(np.concatenate(current), plain)
                require_beyond(np.concatenate(current), whole)
            except UnfairError:
                continue
            open_to_question.remove(name)
    assert not open_to_question


@pytest.mark.parametrize(
    "name",
    ["coulomb_friction", "viscous_friction", "stribeck_friction", "friction_asymmetry", "load_dependent_friction",
     "inertia", "axis_coupling", "torque_ripple", "cutting_force", "edge_force", "tool_wear", "coolant_load"],
)  # fmt: skip
def test_what_the_vocabulary_says_is_not_outside_of_it(name, drawn, monkeypatch):
    monkeypatch.setattr(fair, "MOST_ROWS", 3_000)
    world = drawn[0]
    axis = "xyz"[world.machine.kind.plane[0]]
    with pytest.raises(UnfairError, match="explains it"):
        require_beyond(np.concatenate(_current(world, CONCEALED[name], axis)), books(world, axis)[1])


def test_the_draw_of_an_effect_outside_the_vocabulary_has_its_strength_and_says_no_more(tmp_path):
    task = Task("outside the vocabulary", list(SECOND.outside)[-3], 3.0, 1, edition=2)
    case = draw_case(task, SMALL)
    places = write_case(case, tmp_path / "parts", tmp_path / "truth")
    assert_they_keep_the_contract_of_columns(places)
    assert_nothing_that_is_shown_names_the_case(case, places)
    (one,) = case.effects
    assert (one.mechanism, one.kind, one.strength) == ("unknown", "unexplained", task.strength)


@pytest.mark.parametrize("name", ["shaped", "remembered"])
def test_worked_numbers_of_the_second_editions_docstrings_are_right(name):
    found = doctest.testmod(importlib.import_module(f"benchmarks.newcomer.second.{name}"))
    assert found.attempted > 0
    assert found.failed == 0
