"""The first edition of the newcomer's cases stays what it was when it was drawn first."""

import hashlib

import numpy as np
import pytest

from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.parts import Length
from benchmarks.newcomer.planned import plan
from pido.core.axes import AXES

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
