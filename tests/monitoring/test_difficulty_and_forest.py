"""Distances, compiled forests, and a band that knows where a model is usually wrong."""

import numpy as np
import pytest
from sklearn.ensemble import ExtraTreesRegressor, GradientBoostingRegressor

from pido.monitoring.alarms import Watch, judge
from pido.monitoring.band import corridor, learn
from pido.monitoring.difficulty import state
from pido.monitoring.doubt import Support
from pido.monitoring.forest import quick
from pido.monitoring.residuals import PartResiduals

RATE = 50.0


def test_a_training_row_seen_often_is_at_no_distance_and_distance_grows_in_a_straight_line_away_from_it():
    rows = np.vstack([np.zeros((10, 2)), np.ones((10, 2))])
    near = Support(rows)
    assert near.distance(rows).max() == 0.0
    away = near.distance(np.array([[-1.0, -1.0], [-2.0, -2.0]]))
    assert away[1] == pytest.approx(2 * away[0])


def test_a_change_in_an_input_that_never_varied_is_far_but_not_infinitely_far():
    rows = np.column_stack([np.linspace(0, 1, 50), np.full(50, 20.0)])
    same, other = Support(rows).distance(np.array([[0.5, 20.0], [0.5, 25.0]]))
    assert np.isfinite(other)
    assert other > 1.0 > same


@pytest.mark.parametrize("model", [ExtraTreesRegressor(8, random_state=0), GradientBoostingRegressor(random_state=0)])
def test_quick_predictions_are_those_of_the_model(model):
    rng = np.random.default_rng(0)
    rows, target = rng.normal(size=(300, 5)), rng.normal(size=300)
    model.fit(rows, target)
    new = rng.normal(size=(200, 5))
    np.testing.assert_allclose(quick(model)(new), model.predict(new), rtol=1e-12, atol=1e-12)


def _part(rng: np.random.Generator, seconds: float = 100.0, jump: float = 0.0) -> PartResiduals:
    """Noise that is ten times as large while the axis accelerates, which is a fifth of the time."""
    n = int(seconds * RATE)
    busy = (np.arange(n) // 50) % 5 == 0
    noise = np.convolve(rng.normal(size=n + 4), np.ones(5) / np.sqrt(5), "valid") * np.where(busy, 0.5, 0.05)
    residual = np.full((n, 4), np.nan)
    residual[:, 0] = noise
    residual[2075:2150, 0] += jump  # samples 2050 to 2250 are steady
    inputs = np.column_stack([np.where(busy, 100.0, 0.0) + rng.normal(size=n), rng.normal(size=n)])
    predicted = np.zeros((n, 4))
    return PartResiduals(
        "p", np.arange(n) / RATE, residual, predicted, np.full(n, "1", object), np.full(n, -1, np.int64),
        np.full(n, 0.1), inputs,
    )  # fmt: skip


def test_the_band_is_wide_where_the_model_is_usually_wrong_and_narrow_elsewhere():
    rng = np.random.default_rng(1)
    band = learn([_part(rng) for _ in range(4)])
    part = _part(rng)
    low, high = corridor(part, "x", band)
    busy = (np.arange(len(part.time)) // 50) % 5 == 0
    width = high - low
    inside_busy, inside_calm = width[49::50][busy[49::50]], width[49::50][~busy[49::50]]
    assert np.nanmedian(inside_busy) > 4 * np.nanmedian(inside_calm)


def test_a_jump_in_a_calm_stretch_is_found_although_it_is_smaller_than_the_noise_elsewhere_and_good_parts_pass():
    rng = np.random.default_rng(2)
    band = learn([_part(rng) for _ in range(4)])
    assert sum(not judge(_part(rng), band).good for _ in range(40)) <= 2
    found = [judge(_part(rng, jump=0.4), band).alarms for _ in range(10)]
    assert sum(any(a.t_start <= 43.0 and a.t_end >= 41.5 for a in alarms) for alarms in found) >= 9


def test_what_is_farther_from_the_training_rows_than_anything_tried_is_not_judged():
    rng = np.random.default_rng(3)
    band = learn([_part(rng) for _ in range(4)])
    strange = _part(rng, jump=50.0)
    far = PartResiduals(
        "f", strange.time, strange.residual, strange.predicted, strange.tool, strange.block,
        np.full(len(strange.time), 10.0), strange.inputs,
    )  # fmt: skip
    verdict = judge(far, band)
    assert not verdict.alarms
    assert verdict.judged == 0.0
    assert not verdict.good


def test_a_stream_with_states_sees_the_same_alarm_as_the_whole_part():
    rng = np.random.default_rng(4)
    band = learn([_part(rng) for _ in range(4)])
    part = _part(rng, jump=0.6)
    assert part.doubt is not None
    assert part.inputs is not None
    rows = state(part.doubt, part.inputs, part.predicted[:, 0])
    watch = Watch(band, RATE)
    seen = [t for k, t in enumerate(part.time) if watch.push({"x": part.residual[k, 0]}, "1", -1, {"x": rows[k]})]
    (alarm,) = [a for a in judge(part, band).alarms if a.t_end >= 41.5]
    assert seen[0] == pytest.approx(alarm.t_start + band.window_s - 1 / RATE)
    assert seen[-1] == pytest.approx(alarm.t_end)
