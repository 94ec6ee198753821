"""The third edition of the newcomer's cases lies outside as well, and leaves the others as they were."""

import doctest
import hashlib
import importlib

import numpy as np
import pytest

from benchmarks.newcomer import fair, programs
from benchmarks.newcomer.assembly import logged
from benchmarks.newcomer.catalogue import CONCEALED
from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.editions import EDITIONS, OUTSIDE
from benchmarks.newcomer.folders import write_case
from benchmarks.newcomer.machines import draw_machine
from benchmarks.newcomer.parts import Length, Part, draw_parts
from benchmarks.newcomer.planned import plan
from benchmarks.newcomer.second.textbook import require_beyond
from benchmarks.newcomer.third import forms, regions, toolpaths
from benchmarks.newcomer.toolpaths import SAFE, Operation, Path
from benchmarks.newcomer.world import World, draw_terms, simulate
from benchmarks.sealed_truth import Task, UnfairError
from pido.core.arrays import Float2D
from pido.core.axes import AXES
from tests.benchmarks.newcomers_laws import books, likeness
from tests.benchmarks.written_cases import (
    assert_nothing_that_is_shown_names_the_case,
    assert_they_keep_the_contract_of_columns,
    assert_two_have_the_same_bytes,
)

SMALL = Length(parts=(3, 3), seconds=(25.0, 40.0), rows=40_000, fine_rows=40_000)
FIRST, SECOND, THIRD = EDITIONS[1], EDITIONS[2], EDITIONS[3]


@pytest.mark.parametrize(
    ("edition", "seed", "digest"),
    [
        (1, 1, "eabe6ce024c0d6d3"),
        (2, 1, "865c6711df8e10ef"),
        (2, 2, "5d834db72f0ba0ab"),
        (2, 63, "ce1a91bc3b5fa670"),
        (3, 1, "9465239333ac5129"),
        (3, 2, "7bc14b3d93f6dc7a"),
        (3, 63, "a248ab8b799939d0"),
    ],
)
def test_an_edition_plans_what_it_planned_when_it_was_new(edition, seed, digest):
    keys = "".join(t.key for t in plan(150, seed, edition))
    assert hashlib.sha256(keys.encode()).hexdigest()[:16] == digest


DRAWN = {  # edition, rows, and rms of the recorded current of x, y, z, sp, A
    "66c56311f734": (2, 15352, 3.0351839, 7.1431823, 5.334077, 4.3420467),
    "a0361a1333a9": (2, 16343, 3.4523739, 4.5934438, 9.1559093, 6.6296009),
    "28f22a6d177e": (2, 32742, 0.27662414, 0.27821849, 0.21459733, 0.14268895),
    "8836c96b4fc6": (2, 13801, 4.2010799, 2.9222595, 0.56157151, 2.8199263),
    "3ce64e502b18": (2, 39996, 5.6226919, 9.0006624, 7.3261617, 5.7339677),
    "eb61828ddb35": (2, 2984, 9.1977952, 4.8068428, 5.0057432, 4.100626),
    "3b50490be731": (2, 40000, 4.1146185, 7.7571758, 4.1227623, 3.466493),
    "8e8b48589adb": (2, 39996, 0.94839505, 1.3988281, 1.023502, 1.3799246),
    "971090117e87": (3, 39996, 9.1477076, 16.105054, 4.733846, 3.9431553),
    "1546be44b816": (3, 33411, 1.2957953, 0.9163958, 2.1776543, 1.4194395),
    "1d49a8647c81": (3, 25141, 4.5526989, 4.2412309, 6.5054356, 3.6011299),
    "ee6c1553d6f3": (3, 2701, 1.7201216, 0.88706058, 1.2170442, 0.72420961),
    "6c1cef98e405": (3, 5996, 18.940027, 23.619702, 22.355599, 25.636057),
    "d874e7385c3a": (3, 30115, 4.9816853, 5.2177523, 5.6730762, 8.1406227),
    "38c8c2d010c5": (3, 13175, 22.503698, 12.021729, 16.080643, 5.7531955),
    "5a30b5fd2652": (3, 2676, 4.7314523, 4.7543996, 9.1187234, 4.7498138),
}
"""By the key of the first case of each group of plan(60, 1, edition); those of the second by the code that knew two."""


@pytest.mark.parametrize("key", DRAWN)
def test_an_edition_draws_what_it_drew_when_it_was_new(key):
    edition, *expected = DRAWN[key]
    task = next(t for t in plan(60, 1, edition) if t.key == key)
    case = draw_case(task, SMALL)
    rms = [np.sqrt(np.mean(np.concatenate(list(case.recorded[a])) ** 2)) for a in AXES]
    assert [sum(len(p.t) for p in case.parts), *rms] == pytest.approx(expected, rel=1e-6)


def test_the_third_edition_has_machines_programs_and_laws_of_its_own():
    assert len(THIRD.kinds) >= 8
    assert not {k.name for k in THIRD.kinds} & {k.name for e in (FIRST, SECOND) for k in e.kinds}
    assert len(THIRD.outside) >= 24
    assert not set(THIRD.outside) & {*FIRST.outside, *SECOND.outside, *CONCEALED}
    assert len(toolpaths.JOBS) >= 6
    assert not set(toolpaths.JOBS) & {job for e in (FIRST, SECOND) for k in e.kinds for job in k.jobs}
    assert {job for k in THIRD.kinds for job in k.jobs} >= set(toolpaths.JOBS)
    assert {job for k in THIRD.kinds for job in k.jobs} <= set(programs.WORK)


def test_the_third_edition_has_the_shares_of_the_second_and_meets_every_law_in_turn():
    assert THIRD.shares == SECOND.shares
    tasks = plan(2 * sum(THIRD.shares.values()), 1, edition=3)
    assert {t.what for t in tasks if t.group == "outside the vocabulary"} == set(THIRD.outside)
    assert {t.what for t in tasks if t.group == "pair"} <= set(forms.PAIRS)
    assert not {t.key for t in tasks} & {t.key for n in (1, 2) for t in plan(200, 1, edition=n)}
    assert tasks[:30] == plan(30, 1, edition=3)


@pytest.fixture(scope="module")
def drawn() -> list[World]:
    """One of each kind of machine."""
    length, worlds = Length(parts=(4, 4), seconds=(50.0, 50.0), rows=40_000, fine_rows=80_000), []
    for k, kind in enumerate(THIRD.kinds):
        rng = np.random.default_rng([k, 8])
        parts = draw_parts(draw_machine(kind, rng), length, straight=False, rng=rng)
        worlds.append(simulate(parts, draw_terms(parts, rng)))
    return worlds


def test_no_law_outside_the_vocabulary_is_one_that_textbooks_always_explain(drawn, monkeypatch):
    monkeypatch.setattr(fair, "MOST_ROWS", 3_000)
    open_to_question = set(THIRD.outside)
    for world in drawn:
        said: dict[str, tuple[dict[str, Float2D], dict[str, Float2D]]] = {}
        for name in sorted(open_to_question):
            axis = THIRD.outside[name].axes(world.machine)[-1]
            if axis not in said:
                said[axis] = books(world, axis)
            try:
                law = THIRD.outside[name].law(world, axis, np.random.default_rng(3))
                current = logged(world.machine, law.columns)
                fair.require_seen(current)
                fair.require_foreign(np.concatenate(current), said[axis][0])
                require_beyond(np.concatenate(current), said[axis][1])
            except UnfairError:
                continue
            open_to_question.remove(name)
    assert not open_to_question


@pytest.mark.parametrize("on", ["plane", "sp"])
def test_a_law_of_the_third_edition_is_no_other_one_of_any(on, drawn):
    of = {n: law for n, law in OUTSIDE.items() if law.on == on}
    alike = []
    for world in drawn:
        axis = "sp" if on == "sp" else "xyz"[world.machine.kind.plane[0]]
        columns = []
        for law in of.values():
            try:
                made = law.law(world, axis, np.random.default_rng(3))
                columns.append(np.concatenate(logged(world.machine, made.columns)))
            except UnfairError:  # not on this machine
                columns.append(np.zeros(sum(len(p.t[:: world.machine.fine]) for p in world.parts)))
        alike.append(likeness(columns))
    usual = np.median(alike, axis=0)[[name in THIRD.outside for name in of]]
    assert usual.max() < 0.75


@pytest.mark.parametrize("name", [n for n in forms.CONCEALED if forms.CONCEALED[n].law is not CONCEALED[n].law])
def test_another_form_of_a_mechanism_is_another_current_and_finite(name, drawn):
    differ = []
    for world in drawn[:4]:
        axis = forms.CONCEALED[name].axes(world.machine)[0]
        one, two = (np.concatenate(list(of[name].law(world, axis, np.random.default_rng(5)).columns))
                    for of in (forms.CONCEALED, CONCEALED))  # fmt: skip
        assert np.isfinite(one).all()
        norm = np.linalg.norm(one) * np.linalg.norm(two)
        differ.append(norm > 0 and abs(one @ two) / norm < 1 - 1e-9)
    assert any(differ)


@pytest.mark.parametrize("shape", regions.SHAPES)
def test_a_region_has_samples_inside_and_outside_and_none_at_rest(shape, drawn):
    parts: list[Part] = list(drawn[1].parts)
    inside, said = regions.SHAPES[shape](parts, np.random.default_rng(2))
    here = np.concatenate(inside)
    assert 0 < here.mean() < 0.9
    assert not here[np.concatenate([p.speed for p in parts]) == 0].any()
    assert said


@pytest.mark.parametrize("job", toolpaths.JOBS)
def test_a_program_stays_on_its_workpiece_and_goes_on_from_where_it_was(job):
    rng = np.random.default_rng(4)
    machine, size = draw_machine(THIRD.kinds[0], rng), np.array([200.0, 160.0])
    path = Path([np.array([0.0, 0.0, SAFE * 200.0])])
    path.operations.append(Operation(next(iter(machine.cutters)), 20.0, 1500.0, 2.0, 10.0, False, job == "peck", True))
    for _ in range(3):
        toolpaths.JOBS[job](path, size, machine, rng)
    points = np.array(path.points)
    assert len(points) - 1 == len(path.feeds) == len(path.cuts) == len(path.rests)
    assert (np.abs(points[:, :2]) <= 0.6 * size).all()
    assert (points[:, 2] <= SAFE * 200.0 + 1e-9).all()
    assert min(path.feeds) > 0
    assert any(path.cuts) or job == "touch"


BARE = next(k for k, kind in enumerate(THIRD.kinds) if kind.bare)


@pytest.mark.parametrize(
    "task",
    [
        Task("outside the vocabulary", list(THIRD.outside)[3], 3.0, 1, edition=3),
        Task("confined to a region", "viscous_friction", 4.0, 1, edition=3),
        Task("wrong coefficient", "stribeck_friction", 4.0, 1, edition=3),
    ],
    ids=lambda t: t.group,
)
def test_a_case_of_the_third_edition_keeps_the_contract_and_says_no_more(task, tmp_path):
    case = draw_case(task, SMALL)
    places = write_case(case, tmp_path / "parts", tmp_path / "truth")
    assert_they_keep_the_contract_of_columns(places)
    assert_nothing_that_is_shown_names_the_case(case, places)
    assert case.effects[0].strength == task.strength


def test_the_same_seed_gives_the_same_bytes_of_the_third_edition(tmp_path):
    task = Task("single", "presliding_hysteresis", 2.0, 5, edition=3)
    assert_two_have_the_same_bytes(lambda *where: write_case(draw_case(task, SMALL), *where), tmp_path)


def test_a_plain_log_holds_no_more_than_it_must():
    tasks = [Task("clean", "", 1.0, seed, edition=3) for seed in range(40)]
    cases = [draw_case(t, Length(parts=(2, 2), seconds=(5.0, 5.0), rows=3_000, fine_rows=6_000)) for t in tasks]
    plain = [c for c in cases if c.parts[0].machine.kind is THIRD.kinds[BARE]]
    assert plain
    assert all(not c.rich and not c.columns for c in plain)


def test_worked_numbers_of_the_third_editions_docstrings_are_right():
    found = doctest.testmod(importlib.import_module("benchmarks.newcomer.third.memory"))
    assert found.attempted > 0
    assert found.failed == 0
