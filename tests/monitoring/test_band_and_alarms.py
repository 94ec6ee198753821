"""The band's promises, on residuals whose law is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.core.errors import FitError
from pido.monitoring.alarms import Watch, judge
from pido.monitoring.band import learn, standardise
from pido.monitoring.residuals import PartResiduals

RATE = 50.0


def _good(name: str, rng: np.random.Generator, seconds: float = 100.0, sd: float = 0.05) -> PartResiduals:
    """First-order autoregressive noise; three axes recorded, the fourth not; eight NC blocks with own small offsets."""
    n = int(RATE * seconds)
    noise = lfilter([np.sqrt(1 - 0.8**2)], [1, -0.8], rng.normal(size=(n, 3)), axis=0) * sd * np.exp(rng.normal() * 0.1)
    block = np.arange(n) * 8 // n
    residual = np.column_stack([noise + 0.02 * np.sin(block)[:, None], np.full(n, np.nan)])
    return PartResiduals(name, np.arange(n) / RATE, residual, np.ones((n, 4)), np.full(n, "T1", object), block)


def _with_step(part: PartResiduals, size: float, start: float, seconds: float) -> PartResiduals:
    residual = part.residual.copy()
    residual[(part.time >= start) & (part.time < start + seconds), 0] += size
    return PartResiduals(part.part, part.time, residual, part.predicted, part.tool, part.block)


@pytest.mark.thorough
@pytest.mark.parametrize(("known", "most"), [(1, 0.04), (3, 0.025), (10, 0.025)])
def test_false_alarms_stay_near_what_is_tolerated_from_the_first_part_on(known, most):
    rng = np.random.default_rng(known)
    alarmed = 0
    for _ in range(10):
        band = learn([_good("g", rng) for _ in range(known)], tolerate=1.0)
        alarmed += sum(bool(judge(_good("n", rng), band).alarms) for _ in range(20))
    assert alarmed / 200 <= most


def test_the_band_narrows_as_parts_are_added():
    rng = np.random.default_rng(0)

    def width(parts: int) -> float:
        band = learn([_good("g", rng) for _ in range(parts)])
        return float(np.mean([np.ptp(band.limits("x", "T1", block)) for block in range(8)]))

    assert np.mean([width(10) for _ in range(10)]) < np.mean([width(1) for _ in range(10)])


def test_a_change_is_found_where_and_when_it_was():
    rng = np.random.default_rng(1)
    band = learn([_good("g", rng) for _ in range(3)])
    found = 0
    for _ in range(40):
        verdict = judge(_with_step(_good("n", rng), 0.3, 40.0, 1.0), band)
        alarms = [a for a in verdict.alarms if a.axis == "x"]
        found += any(a.t_start <= 41.0 and a.t_end >= 40.0 and a.size_a > 0 and a.block == 3 for a in alarms)
    assert found >= 38


def test_watching_sample_by_sample_sees_what_judging_the_whole_part_sees():
    rng = np.random.default_rng(2)
    band = learn([_good("g", rng) for _ in range(3)])
    part = _with_step(_good("n", rng), -0.4, 20.0, 2.0)
    watch = Watch(band, RATE)
    times = [
        t
        for t, r, tool, block in zip(part.time, part.residual, part.tool, part.block, strict=True)
        if "x" in watch.push(dict(zip("xyz", r[:3], strict=True)), tool, int(block))
    ]
    verdict = judge(part, band)
    alarms = [a for a in verdict.alarms if a.axis == "x"]
    assert watch.verdict("n", verdict.alarms) == verdict
    assert alarms[-1].t_end == times[-1]
    assert times[0] == pytest.approx(alarms[0].t_start + band.window_s - 1 / RATE)


def _drawing(part: PartResiduals, amperes: float) -> PartResiduals:
    """The same deviations from an expected current of so much, on x, y and z."""
    return replace(part, predicted=part.predicted * amperes)


def test_silence_within_a_band_that_reaches_as_far_as_all_that_an_axis_draws_is_no_judgement():
    rng = np.random.default_rng(5)
    for draws, blind in ((2.0, ()), (0.05, ("x", "y", "z"))):
        band = learn([_drawing(_good("g", rng), draws) for _ in range(3)])
        part = _drawing(_good("n", rng), draws)
        verdict = judge(part, band)
        assert not verdict.alarms
        assert (verdict.blind, verdict.good) == (blind, not blind)
        assert verdict.judged + verdict.too_wide == pytest.approx(1.0)
        assert verdict.familiar
        watch = Watch(band, RATE)
        for r, tool, block in zip(part.residual, part.tool, part.block, strict=True):
            watch.push(dict(zip("xyz", r[:3], strict=True)), tool, int(block))
        assert watch.verdict("n", ()) == verdict
        beyond = judge(_with_step(part, 9.0, 40.0, 2.0), band)
        assert [a.axis for a in beyond.alarms] == ["x"]


def test_an_axis_without_recording_is_named_as_unwatched():
    rng = np.random.default_rng(3)
    assert judge(_good("n", rng), learn([_good("g", rng)])).unwatched == ("sp",)


def _lacking(part: PartResiduals, axis: int, where: np.ndarray) -> PartResiduals:
    """Without the values of one axis, as a channel that drops out leaves it."""
    residual = part.residual.copy()
    residual[where, axis] = np.nan
    due = np.ones(len(part.time), bool)
    return PartResiduals(part.part, part.time, residual, part.predicted, part.tool, part.block, due=due)


def _watched(part: PartResiduals, watch: Watch) -> None:
    for r, tool, block in zip(part.residual, part.tool, part.block, strict=True):
        watch.push(dict(zip("xyz", r[:3], strict=True)), tool, int(block), due=True)


def test_what_a_recording_lacks_is_no_time_that_was_judged():
    rng = np.random.default_rng(5)
    band = learn([_good("g", rng) for _ in range(3)])
    part = _good("n", rng)
    every_third, n = np.arange(len(part.time)) % 3 == 0, len(part.time)
    for axis in range(3):
        part = _lacking(part, axis, every_third & (part.time < 80.0))
    verdict = judge(part, band)
    assert (verdict.good, verdict.judged) == (False, pytest.approx(0.2, abs=0.01))
    assert verdict.judged + verdict.lost == pytest.approx(1.0)
    assert verdict.lacking == pytest.approx(dict.fromkeys("xyz", (every_third & (part.time < 80.0)).sum() / n))
    watch = Watch(band, RATE)
    _watched(part, watch)
    assert watch.verdict("n", verdict.alarms) == verdict


def test_a_window_that_lacks_a_few_values_is_judged_by_the_rest_and_one_axis_does_not_blind_another():
    rng = np.random.default_rng(6)
    band = learn([_good("g", rng) for _ in range(3)])
    sparse = lambda part: _lacking(part, 0, np.arange(len(part.time)) % 12 == 0)  # noqa: E731
    wrong = sparse(_with_step(_good("n", rng), 0.3, 40.0, 2.0))
    verdict = judge(wrong, band)
    assert (verdict.judged, verdict.lost) == (1.0, 0.0)
    assert any(a.axis == "x" and a.t_start <= 41.0 and a.t_end >= 40.0 for a in verdict.alarms)
    assert set(verdict.lacking) == {"x"}
    watch = Watch(band, RATE)
    _watched(wrong, watch)
    assert watch.verdict("n", verdict.alarms) == verdict
    assert sum(bool(judge(sparse(_good("n", rng)), band).alarms) for _ in range(100)) <= 2


def test_a_mean_of_fewer_values_has_a_band_wider_by_the_root_of_their_share():
    rng = np.random.default_rng(7)
    band = learn([_good("g", rng) for _ in range(3)])
    part = _good("n", rng)
    width = round(RATE * band.window_s)
    whole = standardise(part, "x", band)[1][width]
    fewer = standardise(_lacking(part, 0, np.arange(len(part.time)) % 5 == 0), "x", band)[1][width]
    assert fewer == pytest.approx(whole / np.sqrt(0.8))


def _shorter(part: PartResiduals, seconds: float) -> PartResiduals:
    n = int(seconds * RATE)
    return PartResiduals(part.part, part.time[:n], part.residual[:n], part.predicted[:n], part.tool[:n], part.block[:n])


def test_silence_about_a_part_without_a_whole_window_does_not_make_it_good():
    rng = np.random.default_rng(4)
    verdict = judge(_shorter(_with_step(_good("n", rng), 5.0, 0.0, 9.0), 0.4), learn([_good("g", rng)]))
    assert not verdict.alarms
    assert not verdict.good
    assert (verdict.windows, verdict.judged) == (0, 0.0)


def test_no_good_part_is_an_error_that_says_what_is_needed():
    with pytest.raises(FitError, match="at least one good part"):
        learn([])
