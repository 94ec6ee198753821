from dataclasses import replace

import numpy as np
import pytest

from pido.core.errors import FitError, RegistryError
from pido.core.samples import Samples
from pido.models.axis_models import AxisModels, Trained, digest, held_out_errors, quick_trainer
from pido.models.estimators import ESTIMATORS
from pido.models.metrics import axis_metrics, metrics
from pido.models.promotion import gate
from pido.models.rivals import RIVALS, constant, friction_line, nearest_commands


def rows(n=400, seed=0, part="p"):
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(n, 13)) * 5
    direction = np.sign(inputs[:, [0, 1, 2, 6]])
    currents = direction * [1, 2, 3, 0] + 0.1 * inputs[:, [0, 1, 2, 6]] + [0, -5, 1, 8.0]
    return Samples.real(inputs, np.zeros(n), currents, direction, part, np.arange(n))


def test_same_rows_and_seed_give_the_same_model_whatever_the_order_of_parts_and_the_number_of_jobs():
    a, b = rows(200, 1, "a"), rows(200, 2, "b")
    first = AxisModels.fit(Samples.concat([a, b]), seed=3)
    second = AxisModels.fit(Samples.concat([b, a]), seed=3, n_jobs=2)
    assert first.digest() == second.digest()
    assert first.predict(a).tobytes() == second.predict(a).tobytes()
    assert AxisModels.fit(Samples.concat([a, b]), seed=4).digest() != first.digest()


@pytest.mark.parametrize("choice", ESTIMATORS)
def test_every_set_of_estimators_has_a_digest_of_what_it_learned(choice):
    a = rows(120)
    other = replace(a, currents=a.currents + 1e-3)
    digests = [AxisModels.fit(s, choice=choice, seed=1).digests() for s in (a, a, other)]
    assert digests[0] == digests[1]
    assert all(digests[0][axis] != digests[2][axis] for axis in digests[0])


def test_a_training_on_rows_that_were_trained_on_is_not_done_twice_and_changes_no_model():
    real, more, known = rows(200, 1), rows(50, 2, "b"), Trained()
    both = Samples.concat([real, more])
    weight = np.ones((len(both), 4))
    weight[len(real) :, 2] = 0.0  # on z the second part does not count: the same rows as before
    first = AxisModels.fit(real, seed=3, trained=known)
    second = AxisModels.fit(both, weight, seed=3, trained=known)
    assert second.digests() == AxisModels.fit(both, weight, seed=3).digests()
    assert second.models["z"] is first.models["z"]
    assert all(second.models[axis] is not first.models[axis] for axis in ("x", "y", "sp"))
    assert AxisModels.fit(real, seed=4, trained=known).models["z"] is not first.models["z"]
    assert AxisModels.fit(real, np.full(200, 0.5), seed=3, trained=known).models["z"] is not first.models["z"]


def test_any_regressor_can_take_a_place():
    from sklearn.linear_model import LinearRegression

    models = AxisModels.fit(rows(), choice=dict.fromkeys(("x", "y", "z", "sp"), lambda seed: LinearRegression()))
    assert digest(models.models["x"]) == digest(models.models["x"])
    np.testing.assert_allclose(models.predict(rows(50, 9)), rows(50, 9).currents, atol=1e-9)


def test_an_axis_without_current_has_no_model_and_the_others_are_untouched():
    whole, holed = rows(), rows()
    currents = holed.currents.copy()
    currents[:, 2] = np.nan
    one, other = AxisModels.fit(whole), AxisModels.fit(replace(holed, currents=currents))
    assert np.isnan(other.predict(whole)[:, 2]).all()
    assert other.digests() == {axis: d for axis, d in one.digests().items() if axis != "z"}
    with pytest.raises(FitError, match="no sample has a current"):
        AxisModels.fit(replace(whole, currents=np.full_like(currents, np.nan)))


def test_a_row_of_weight_zero_is_as_good_as_absent():
    a = rows(300)
    weights = np.r_[np.ones(200), np.zeros(100)]
    assert AxisModels.fit(a, weights).digest() == AxisModels.fit(a.take(slice(0, 200)), np.ones(200)).digest()


def test_standstill_is_only_predictable_for_a_model_that_is_told_the_last_direction():
    s = rows(1000)
    inputs = s.inputs.copy()
    inputs[:, 0] = 0.0
    currents = s.direction * 1.0
    still = replace(s, inputs=inputs, currents=currents)

    def rmse(kind):
        predicted = AxisModels.fit(still.take(slice(0, 700)), inputs=kind).predict(still.take(slice(700, None)))
        return np.sqrt(np.mean((predicted[:, 0] - currents[700:, 0]) ** 2))

    assert rmse("paper") > 0.9
    assert rmse("extended") < 0.1


def test_metrics_have_their_textbook_values():
    y = np.array([0.0, 1.0, 2.0, 3.0, np.nan])
    m = axis_metrics(y, np.array([0.0, 1.0, 2.0, 5.0, 7.0]))
    assert (m.n, m.rmse, m.mae) == (4, 1.0, 0.5)
    assert m.r2 == pytest.approx(1 - 4 / 5)
    assert axis_metrics(y, np.full(5, np.nanmean(y))).r2 == pytest.approx(0.0)
    nothing = metrics(np.full((3, 4), np.nan), np.zeros((3, 4)))
    assert nothing["x"].n == 0
    assert np.isnan(nothing["x"].rmse)
    tail = axis_metrics(np.zeros(1000), np.arange(1000.0))
    assert tail.error_99 == pytest.approx(989, abs=1)


def test_trivial_rivals_do_what_their_names_say():
    train = rows()
    assert np.allclose(constant(train)(train), train.currents.mean(axis=0))
    np.testing.assert_allclose(friction_line(train)(rows(40, 5)), rows(40, 5).currents, atol=1e-9)
    np.testing.assert_allclose(nearest_commands(train, 1)(train), train.currents)
    currents = train.currents.copy()
    currents[:, 1] = np.nan
    for rival in RIVALS.values():
        said = rival(replace(train, currents=currents))(train)
        assert np.isnan(said[:, 1]).all()
        assert np.isfinite(said[:, [0, 2, 3]]).all()


def test_held_out_errors_come_from_models_that_had_not_seen_the_row():
    s = rows(300)
    noise = replace(s, currents=np.random.default_rng(1).normal(size=s.currents.shape))
    held = held_out_errors(noise)
    assert np.sqrt(np.mean(held.residual**2)) > 0.95  # a model that had seen its rows would do better than the noise


def errors(**axes):
    return {
        part: np.array([axes.get(a, [1.0] * 5)[k] for a in ("x", "y", "z", "sp")]) for k, part in enumerate("abcde")
    }


def test_a_better_challenger_may_be_promoted_and_a_worse_axis_stops_it():
    same = errors()
    assert gate(errors(x=[0.9] * 5), same).passed
    verdict = gate(errors(x=[0.5] * 5, y=[1.1] * 5), same)
    assert not verdict.passed
    assert "fails on y" in verdict.words
    assert gate(same, same).passed


def test_small_but_steady_losses_are_losses():
    assert gate(errors(x=[1.015, 0.99, 1.0, 1.01, 0.995]), errors()).passed
    assert not gate(errors(x=[1.015] * 5), errors()).passed


def test_the_first_model_has_to_beat_a_constant_current():
    trivial = errors()
    assert gate(errors(x=[0.4] * 5), {}, trivial).passed
    assert not gate(errors(x=[1.4] * 5), {}, trivial).passed
    with pytest.raises(RegistryError, match="nothing to compare"):
        gate(errors(), {})
    with pytest.raises(RegistryError, match="different parts"):
        gate(errors(), {"a": np.ones(4)})


def test_an_axis_that_was_not_recorded_has_no_say():
    blind = {part: np.where([True, True, False, True], e, np.nan) for part, e in errors().items()}
    verdict = gate(blind, errors())
    assert verdict.passed
    assert [a.axis for a in verdict.axes] == ["x", "y", "sp"]


def test_an_axis_whose_current_is_always_zero_is_neither_better_nor_worse():
    flat = gate(errors(z=[0.0] * 5), errors(z=[0.0] * 5))
    assert flat.passed
    assert flat.axes[2].change == 0
    assert "z +0.0%" in flat.words
    assert gate(errors(z=[1e-15] * 5), errors(z=[0.0] * 5)).passed
    assert not gate(errors(z=[0.1] * 5), errors(z=[0.0] * 5)).passed


def test_a_quick_trainer_says_of_the_same_rows_the_same_again():
    real, weights, train = rows(200, 1), np.ones((200, 4)), quick_trainer(trees=3)
    first, other = train(real, weights), train(rows(200, 3), weights)
    np.testing.assert_array_equal(train(real, weights)(rows(50, 2)), first(rows(50, 2)))
    np.testing.assert_array_equal(quick_trainer(trees=3)(real, weights)(rows(50, 2)), first(rows(50, 2)))
    assert np.any(other(rows(50, 2)) != first(rows(50, 2)))


def test_every_axis_on_which_a_trivial_rival_is_better_is_said_with_both_errors_and_fails_nothing():
    line = {"friction line": {p: np.array([2.0, 0.378, 2.0, 0.0908]) for p in "ab"}}
    constant = {p: np.array([3.0, 3.0, 3.0, 3.0]) for p in "ab"}
    new = {p: np.array([1.0, 0.398, 1.0, 0.130]) for p in "ab"}
    for champion in ({}, {p: np.array([1.1, 0.5, 1.1, 0.2]) for p in "ab"}):
        verdict = gate(new, champion, constant, others=line)
        assert verdict.passed
        assert verdict.warnings == (
            "y (friction line 0.378 A beside 0.398 A)", "sp (friction line 0.0908 A beside 0.13 A)"
        )  # fmt: skip
        assert all(warning in verdict.words for warning in verdict.warnings)
    assert gate(new, {}, constant, others={"friction line": constant}).warnings == ()
