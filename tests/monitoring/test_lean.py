"""Residuals that follow a law: taken off where parts that were left out agree, left alone where they do not."""

import numpy as np
import pytest

from pido.monitoring.alarms import Watch, judge
from pido.monitoring.band import learn
from pido.monitoring.difficulty import state
from pido.monitoring.lean import LEAST_PARTS, fit_lean, worth_it
from pido.monitoring.residuals import PartResiduals

RATE = 50.0


def test_the_law_is_found_where_residuals_follow_one():
    rng = np.random.default_rng(0)
    means = rng.normal(size=(500, 3)) * [1.0, 100.0, 0.01] + [0.0, 50.0, 3.0]
    residual = 0.5 + means @ [2.0, -0.03, 40.0]
    said, wider = fit_lean([(means, residual)])(means)
    np.testing.assert_allclose(said, residual, atol=1e-3)
    assert wider.max() < 1.1, "500 windows leave next to nothing unsure"


def test_the_law_is_unsure_where_a_column_that_hardly_varied_takes_another_value():
    rng = np.random.default_rng(4)
    means = rng.normal(size=(500, 2)) * [1.0, 0.0] + [0.0, -1.0]
    means[:3, 1] = 1.0  # a direction that three windows had
    lean = fit_lean([(means, means[:, 0] + 0.05 * rng.normal(size=500))])
    _, (usual, other) = lean(np.array([[0.0, -1.0], [0.0, 1.0]]))
    # Ordinary least squares: the mean of three windows is known to a third of their variance.
    assert usual == pytest.approx(1.0, abs=0.01)
    assert 1.02 < other < np.sqrt(1 + 1 / 3) + 0.05


@pytest.mark.parametrize("follows", [True, False])
def test_parts_that_were_left_out_decide_whether_there_is_a_law(follows):
    rng = np.random.default_rng(1)
    parts = []
    for load in (1.0, 3.0, 6.0, 10.0):
        means = np.column_stack([load + 0.1 * rng.normal(size=200), rng.normal(size=200)])
        law = 0.2 * means[:, 0] if follows else rng.normal() * means[:, 0]
        parts.append((means, law + 0.01 * rng.normal(size=200)))
    assert worth_it(parts) == follows
    assert not worth_it(parts[: LEAST_PARTS - 1])


def _part(rng: np.random.Generator, load: float, jump: float = 0.0) -> PartResiduals:
    """A cut under one load that the model knows nothing of: 0.3 A per unit of it are missing."""
    n = int(60 * RATE)
    residual = np.full((n, 4), np.nan)
    residual[:, 3] = 0.3 * load + 0.02 * rng.normal(size=n)
    residual[1500:1550, 3] += jump
    inputs = np.column_stack([np.full(n, load) + 0.05 * rng.normal(size=n), rng.normal(size=n)])
    return PartResiduals("p", np.arange(n) / RATE, residual, np.ones((n, 4)), np.full(n, "1", object),
                         np.full(n, -1, np.int64), np.full(n, 0.1), inputs)  # fmt: skip


def test_a_part_under_another_load_is_good_and_a_change_far_below_that_load_is_seen_in_it():
    rng = np.random.default_rng(2)
    band = learn([_part(rng, load) for load in (1.0, 2.0, 3.0, 4.0)])
    assert band.axes["sp"].lean is not None
    assert judge(_part(rng, 2.6), band).good
    bad = _part(rng, 2.6, jump=0.15)  # half of what lies between two of the known parts
    (alarm,) = judge(bad, band).alarms
    assert alarm.t_start <= 31.0
    assert alarm.t_end >= 30.0
    assert alarm.size_a == pytest.approx(0.15, rel=0.2)


def test_sample_by_sample_the_same_is_expected_as_over_the_whole_part():
    rng = np.random.default_rng(3)
    band = learn([_part(rng, load) for load in (1.0, 2.0, 3.0, 4.0)])
    bad = _part(rng, 2.2, jump=0.3)
    (alarm,) = judge(bad, band).alarms
    watch = Watch(band, RATE)
    states = state(bad.doubt, bad.inputs, bad.predicted[:, 3])
    outside = [bool(watch.push({"sp": bad.residual[k, 3]}, "1", -1, {"sp": states[k]})) for k in range(len(bad.time))]
    seen = bad.time[np.array(outside)]
    assert seen[0] == pytest.approx(alarm.t_start + band.window_s, abs=0.03)
    assert seen[-1] == pytest.approx(alarm.t_end, abs=0.03)
