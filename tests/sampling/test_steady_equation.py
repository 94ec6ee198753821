"""Who is followed on a path unlike all that was recorded: whoever wavers less."""

from dataclasses import replace

import numpy as np

from pido.config import MethodSettings
from pido.core.samples import PIE, Samples
from pido.equations.choose import PAPER_CHOICE
from pido.models.axis_models import AxisModels, quick_trainer
from pido.sampling.method import Adaptation, Method, adapt, balance_for
from pido.sampling.shares import ShareRule
from pido.sampling.steady import steadier
from pido.sampling.trust import SHIPPED, Trust
from tests.sampling.test_sampling import MILL, milling

SPINDLE = 3


def run_up(n: int = 400, seed: int = 1, part: str = "p") -> Samples:
    """A part at one spindle speed, 18 000 deg/s, that begins with the end of a run-up: 6 A per 10 000 deg/s²."""
    made = milling(n, seed, part)
    inputs, currents = made.inputs.copy(), made.currents.copy()
    a_sp = np.r_[np.full(9, 36_000.0), 31_000, 23_000, 13_000, 6_000, 2_500, 800, 200]
    inputs[: len(a_sp), 7] = a_sp
    inputs[: len(a_sp), 6] = 18_000 - 0.02 * np.cumsum(a_sp[::-1])[::-1]  # at 50 Hz
    currents[:, SPINDLE] += 6e-4 * inputs[:, 7]
    return replace(made, inputs=inputs, currents=currents)


def slower(n: int = 300, seed: int = 5) -> Samples:
    """A coming part at a speed that the run-up only passed. It draws what it would at 18 000 deg/s."""
    path = milling(n, seed)
    inputs, currents = path.inputs.copy(), path.currents.copy()
    inputs[:, 6] -= 4_000
    currents[:, SPINDLE] += 6e-4 * inputs[:, 7]
    return replace(path, inputs=inputs, currents=currents)


def test_an_equation_is_followed_at_a_speed_that_was_only_passed_in_a_run_up():
    real, path = run_up(), slower()
    said, error, own = steadier(path, real, MILL, SHIPPED, quick_trainer())
    follow = np.isfinite(said[:, SPINDLE])
    assert follow.mean() > 0.5
    miss = (said - path.currents)[follow, SPINDLE]
    alone = (AxisModels.fit(real).predict(path) - path.currents)[follow, SPINDLE]
    assert np.sqrt(np.mean(miss**2)) < 0.3 * np.sqrt(np.mean(alone**2))
    assert (error[follow, SPINDLE] > 0).all()
    np.testing.assert_array_equal(np.isfinite(error), np.isfinite(said))
    assert np.median(own[follow, SPINDLE]) > 3 * np.median(error[follow, SPINDLE])


def test_a_model_that_does_not_waver_is_left_alone():
    real, path = run_up(), slower()

    def sure(samples, weights):
        return lambda rows: np.zeros((len(rows), 4))

    assert np.isnan(steadier(path, real, MILL, SHIPPED, sure)[0]).all()


def test_an_equation_that_was_worse_on_what_was_left_out_is_not_followed_however_steady():
    def truth(rows):
        return np.sin(3 * rows.inputs[:, [0, 1, 0, 1]])  # no equation has such a term

    def wavering(samples, weights):
        """Right at the speed that was recorded; at another, whatever comes of the rows it learned from."""
        off = 50.0 * np.sin(1e3 * samples.inputs.sum())
        return lambda rows: np.where(rows.inputs[:, [6]] > 17_000, truth(rows), off)

    real = milling(400)
    assert np.isnan(steadier(slower(), replace(real, currents=truth(real)), MILL, SHIPPED, wavering)[0]).all()
    assert np.isfinite(steadier(slower(), real, MILL, SHIPPED, wavering)[0]).any(axis=0).all()


def test_an_axis_that_was_not_recorded_and_a_handful_of_rows_say_nothing():
    real, path = run_up(), slower()
    currents = real.currents.copy()
    currents[:, SPINDLE] = np.nan
    assert np.isnan(
        steadier(path, replace(real, currents=currents), MILL, SHIPPED, quick_trainer())[0][:, SPINDLE]
    ).all()
    assert np.isnan(steadier(path, real.take(slice(0, 60)), MILL, SHIPPED, quick_trainer())[0]).all()
    assert steadier(path.take(slice(0, 0)), real, MILL, SHIPPED, quick_trainer())[0].shape == (0, 4)


def test_the_order_of_parts_does_not_matter():
    a, b = run_up(300, 1, "a"), run_up(300, 2, "b")
    one, two = (steadier(slower(), Samples.concat(parts), MILL, SHIPPED, quick_trainer()) for parts in ([a, b], [b, a]))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])


def test_models_learn_the_new_speed_from_rows_of_the_path():
    method, real, truth = MethodSettings().build(), run_up(), slower()
    found = adapt(real, MILL, method, train=quick_trainer(), choice=PAPER_CHOICE)
    path = replace(truth, currents=np.full_like(truth.currents, np.nan))
    made = balance_for(path, real, MILL, method, found, rng=np.random.default_rng(2), train=quick_trainer())
    assert np.isfinite(made.generated.currents[made.generated.origin == PIE, SPINDLE]).any()
    weights = np.vstack([np.ones((len(real), 4)), made.weights])

    def rmse(models):
        return np.sqrt(np.mean((models.predict(truth) - truth.currents)[:, SPINDLE] ** 2))

    helped = AxisModels.fit(Samples.concat([real, made.generated]), weights)
    assert rmse(helped) < 0.5 * rmse(AxisModels.fit(real))


def test_rows_that_follow_an_equation_do_not_speak_for_the_whole_path():
    """Trees that learn of a new place from these alone take all of it for such: the others go with the model's word."""
    real, part_slow = run_up(), slower()
    inputs = part_slow.inputs.copy()
    inputs[80:, 6] += 4_000  # the speed that was recorded
    path = replace(part_slow, inputs=inputs, currents=np.full_like(part_slow.currents, np.nan))
    train, none = quick_trainer(), np.zeros((4, 5))
    trust = Trust((None,) * 4, none, none + np.inf, (0.0,) * 4, SHIPPED)
    adaptation = Adaptation(PAPER_CHOICE, None, (ShareRule(),) * 4, {}, len(real), trust)
    made = balance_for(path, real, MILL, Method(), adaptation, rng=np.random.default_rng(2), train=train).generated
    said, error, own_error = steadier(made, real, MILL, SHIPPED, train)
    follow = np.isfinite(said[:, SPINDLE])
    assert 10 < follow.sum() < 0.5 * len(made)
    assert np.isfinite(made.currents[:, SPINDLE]).all()
    np.testing.assert_array_equal(made.currents[follow, SPINDLE], said[follow, SPINDLE])
    own = train(real, np.ones((len(real), 4)))(made)
    np.testing.assert_array_equal(made.currents[~follow, SPINDLE], own[~follow, SPINDLE])
    np.testing.assert_array_equal(made.expected_error[~follow, SPINDLE], own_error[~follow, SPINDLE])
    np.testing.assert_array_equal(made.expected_error[follow, SPINDLE], error[follow, SPINDLE])
