from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pido import iteration
from pido.config import MethodSettings, machine
from pido.core.columns import INPUTS
from pido.core.errors import FitError
from pido.core.samples import PIA, PIE, REAL, Samples
from pido.equations.choose import PAPER_CHOICE, fit_chosen
from pido.equations.terms import FRICTION, HELD
from pido.feature_space.density import balance, occupancy, relevant_bins
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, Grid, touched
from pido.feature_space.regional import HeldOut, folds, sectors
from pido.files.equations import dump, load
from pido.models.axis_models import AxisModels, Trained, quick_trainer
from pido.sampling.gate import NO_SUPPORT, OPEN, PASSED, WORSE_THAN_MODEL, Gate
from pido.sampling.inputs import ChipScaling, draw_inputs
from pido.sampling.loss import certainty_weights, loss_weights
from pido.sampling.method import Adaptation, adapt, balance_for
from pido.sampling.optimise import optimise
from pido.sampling.shares import ShareRule, fill, nothing, paper_pia, paper_pie
from pido.sampling.trust import Spacing, Trust, currents, learn, taken

MILL = machine("smart_mill")
V_X, V_Y, MRR = (INPUTS.index(n) for n in ("v_x", "v_y", "mrr_sim"))


def milling(n=1500, seed=0, part="p", turn=(0.0, 2 * np.pi), cut=True):
    """A part milled in all directions between `turn`, friction with memory and load, 0.05 A of noise."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(*turn, n) + rng.normal(scale=0.05, size=n)
    speed = rng.uniform(3, 8, n)
    inputs = np.zeros((n, 13))
    inputs[:, 0], inputs[:, 1] = speed * np.cos(angle), speed * np.sin(angle)
    inputs[:, 2] = rng.normal(scale=0.1, size=n)
    inputs[:, 3:6] = rng.normal(scale=20, size=(n, 3))
    inputs[:, 6], inputs[:, 7] = 18000 + rng.normal(scale=5, size=n), rng.normal(scale=50, size=n)
    ar = rng.uniform(0.5, 3.5, n) * cut
    inputs[:, 8:11] = 5 * ar[:, None] * np.column_stack([np.cos(angle), np.sin(angle), 0.2 * np.ones(n)])
    inputs[:, 11], inputs[:, 12] = 0.01 * ar, ar * np.linalg.norm(inputs[:, :3], axis=1)
    direction = np.sign(inputs[:, [0, 1, 2, 6]])
    currents = direction * [1, 0.8, 0.2, 0] + inputs[:, [0, 1, 2, 11]] * [0.02, 0.03, 0, 50] + [0, -5, 1, 6.0]
    return Samples.real(inputs, ar, currents + rng.normal(scale=0.05, size=(n, 4)), direction, part, np.arange(n))


def equations_on(real, path):
    bins = touched(relevant_bins(path.reduced, SAMPLING_GRID), SAMPLING_GRID, EQUATION_GRID)
    return fit_chosen(real, bins, MILL, PAPER_CHOICE)


def test_share_functions_have_the_published_values_and_end_at_one_hundred_percent():
    assert paper_pie(np.array(0.0)) == pytest.approx(1.766)
    x = np.linspace(0, 100, 100_001)
    assert paper_pie(x).max() == pytest.approx(18.2, abs=0.05)
    assert x[paper_pie(x).argmax()] == pytest.approx(29.8, abs=0.1)
    assert paper_pie(np.array(100.0)) == pytest.approx(2.57, abs=0.05)
    assert paper_pia(x).max() == pytest.approx(1.28, abs=0.01)
    assert (paper_pia(x) >= 0).all()
    assert paper_pia(np.array(10.0)) == 0.0  # eq. 15 is negative between 1.9 and 20.2 %
    assert paper_pie(np.array(1e6)) == paper_pie(np.array(100.0))


def test_rounding_to_nearest_leaves_pia_almost_nothing_and_chance_keeps_the_mean():
    held = np.arange(0, 41)
    nearest, _ = ShareRule(rounding="nearest").wanted(held, np.random.default_rng(0))
    assert held[nearest > 0].tolist() == [31, 32, 33, 34]
    assert nearest.max() == 1
    many = np.full(200_000, 30)
    pia, pie = ShareRule().wanted(many, np.random.default_rng(0))
    assert pia.mean() == pytest.approx(float(paper_pia(np.array(75.0))) * 0.4, abs=0.005)
    assert pie.mean() == pytest.approx(float(paper_pie(np.array(75.0))) * 0.4, abs=0.02)


@given(st.integers(0, 100), st.integers(0, 2**16))
def test_augmented_rows_never_outnumber_real_ones(n, seed):
    rule = ShareRule(pia=fill, pie=nothing)
    assert rule.wanted(np.array([n]), np.random.default_rng(seed))[0][0] <= n


@pytest.mark.parametrize("nuisance", ["joint", "paper", "planned"])
@given(seed=st.integers(0, 2**16))
def test_every_generated_row_is_in_its_bin_and_inside_the_machine(nuisance, seed):
    rng = np.random.default_rng(seed)
    real = milling(200, seed)
    wild = replace(real, inputs=real.inputs * np.r_[[1, 1, 900], np.full(3, 500), 50, 900, np.full(5, 1)])
    own = relevant_bins(wild.reduced, SAMPLING_GRID)
    far = SAMPLING_GRID.id_of(np.array([[29, 0, 0], [30, 0, 0], [31, 0, 0], [0, -40, 3]]))
    bins = np.unique(np.r_[own, far])
    rows, source = draw_inputs(bins, np.full(len(bins), 5), SAMPLING_GRID, wild, MILL, rng, nuisance=nuisance)
    assert (SAMPLING_GRID.ids(rows.reduced) == rows.voxel).all()
    assert len(source) == len(rows)
    for axis in ("x", "y", "z"):
        limits = MILL.axes[axis]
        assert (np.abs(rows.inputs[:, INPUTS.index(f"v_{axis}")]) <= limits.v_max).all()
        assert (np.abs(rows.inputs[:, INPUTS.index(f"a_{axis}")]) <= limits.a_max).all()
    assert (np.abs(rows.inputs[:, INPUTS.index("v_sp")]) <= MILL.spindle_max_deg_s).all()
    assert (rows.ar >= 0).all()
    assert (np.abs(rows.inputs[:, MRR]) <= MILL.mrr_max_mm3_s).all()
    assert np.isfinite(rows.inputs).all()


def test_removal_rate_and_speed_of_generated_rows_agree_with_their_area():
    real = milling()
    bins = relevant_bins(real.reduced, SAMPLING_GRID)
    rows, _ = draw_inputs(bins, np.full(len(bins), 10), SAMPLING_GRID, real, MILL, np.random.default_rng(1))
    np.testing.assert_allclose(rows.inputs[:, MRR], rows.ar * np.linalg.norm(rows.inputs[:, :3], axis=1))
    moves = np.abs(rows.inputs[:, :2]) > 0.05
    assert (np.sign(rows.inputs[:, :2])[moves] == rows.direction[:, :2][moves]).all()


def test_an_axis_that_rests_in_the_source_row_goes_on_resting():
    real = milling()
    inputs = real.inputs.copy()
    inputs[:, 1] = 1e-5
    along = replace(real, inputs=inputs)
    bins = relevant_bins(along.reduced, SAMPLING_GRID)
    rows, _ = draw_inputs(bins, np.full(len(bins), 5), SAMPLING_GRID, along, MILL, np.random.default_rng(0))
    assert len(rows)
    assert (np.abs(rows.inputs[:, V_Y]) < 1e-4).all()


def test_forces_follow_the_chip_and_turn_with_the_feed():
    one = milling(1)
    inputs = one.inputs.copy()
    inputs[0, :3], inputs[0, 8:12] = [5, 0, 0], [10, 2, 3, 0.1]
    source = replace(one, inputs=inputs, ar=np.array([2.0]))
    turned = inputs.copy()
    turned[0, :3] = [0, 5, 0]
    np.testing.assert_allclose(ChipScaling()(turned, np.array([4.0]), source), [[-4, 20, 6, 0.2]], atol=1e-12)
    faster = inputs.copy()
    faster[0, 0] = 10.0
    np.testing.assert_allclose(ChipScaling(z=0.3)(faster, np.array([2.0]), source)[0, 0], 10 * 2**0.7)
    assert (ChipScaling()(inputs, np.array([0.0]), source) == 0).all()


def test_generated_rows_carry_origin_bin_source_and_equation_currents():
    real = milling()
    path = milling(400, 5)
    equations = equations_on(real, path)
    rule = ShareRule(pia=lambda x: np.full_like(x, 10.0))
    made, report = optimise(
        real, relevant_bins(path.reduced, SAMPLING_GRID), equations, rule, rng=np.random.default_rng(0)
    )
    assert set(np.unique(made.origin)) == {PIA, PIE}
    pia, pie = made.take(made.origin == PIA), made.take(made.origin == PIE)
    np.testing.assert_array_equal(pia.inputs, real.take(pia.row).inputs)
    assert len(np.unique(pia.row)) == len(pia)  # without replacement
    assert (pie.row == -1).all()
    assert (pie.part == "").all()
    np.testing.assert_allclose(made.currents, equations.predict(made))
    assert (made.expected_error > 0).all()
    assert report.pia.sum() == len(pia)
    assert report.pie.sum() == len(pie)
    assert (report.pia <= report.asked_pia).all()
    assert (report.pie <= report.asked_pie).all()


def test_same_seed_gives_the_same_bytes_in_whatever_order_parts_came():
    a, b, path = milling(500, 1, "a"), milling(500, 2, "b"), milling(300, 3)
    needed = relevant_bins(path.reduced, SAMPLING_GRID)
    made = []
    for real in (Samples.concat([a, b]), Samples.concat([b, a])):
        equations = equations_on(Samples.concat([a, b]), path)
        made.append(optimise(real, needed, equations, ShareRule(), rng=np.random.default_rng(7), gate=OPEN)[0])
    assert made[0].inputs.tobytes() == made[1].inputs.tobytes()
    assert made[0].currents.tobytes() == made[1].currents.tobytes()


def test_filling_bins_makes_the_needed_bins_more_even():
    real, path = milling(600, 1, turn=(0, np.pi)), milling(600, 2)
    needed = relevant_bins(path.reduced, SAMPLING_GRID)
    rule = ShareRule(density=20, pia=nothing, pie=fill)
    made, _ = optimise(real, needed, equations_on(real, path), rule, rng=np.random.default_rng(0))
    both = Samples.concat([real, made])
    assert balance(both.reduced, needed, SAMPLING_GRID) < balance(real.reduced, needed, SAMPLING_GRID)
    assert (occupancy(both.reduced, SAMPLING_GRID).count_in(needed) >= 10).mean() > 0.9


def test_no_row_passes_in_a_direction_that_no_sample_took():
    real, path = milling(800, 1, turn=(-0.3, 0.3)), milling(800, 2, turn=(1.3, 1.8))
    needed = relevant_bins(path.reduced, SAMPLING_GRID)
    method = MethodSettings().build()
    gate = replace(method.gate, compare=False)
    rule = ShareRule(pia=nothing, pie=fill)
    made, report = optimise(
        real, needed, equations_on(real, path), rule, rng=np.random.default_rng(0), gate=gate, planned=path,
        nuisance="planned",
    )  # fmt: skip
    assert report.asked_pie.sum() > 100
    assert len(made) <= 0.02 * report.asked_pie.sum()
    assert report.refused[NO_SUPPORT].sum() > 0


def test_the_gate_asks_for_an_equation_that_beats_the_model_and_for_evidence():
    current = np.zeros((1, 4))
    errors = np.array([[[0.1, 0.1, np.inf, 0.1]], [[0.1, 0.3, 0.1, 0.1]]])
    rival = np.full((2, 1, 4), 0.2)
    verdict = Gate().judge(current, np.zeros((1, 4)), np.ones(4), errors, rival, MILL)
    assert verdict.tolist() == [[PASSED, WORSE_THAN_MODEL, WORSE_THAN_MODEL, PASSED]]


def test_errors_are_judged_by_rows_in_the_same_position():
    points = np.zeros((60, 3))
    residual = np.repeat([[1.0], [3.0]], 30, axis=0) * np.ones((60, 4))
    held = HeldOut(points, residual, np.repeat([True, False], 30), np.zeros(60, np.int64))
    here = SAMPLING_GRID.ids(points[:1])
    assert held.at(here, np.array([True])).tolist() == [[1.0] * 4]
    assert held.at(here, np.array([False])).tolist() == [[3.0] * 4]
    never = HeldOut(points[:30], residual[:30], np.ones(30, bool), np.zeros(30, np.int64))
    assert np.isinf(never.at(here, np.array([False]))).all()


def test_folds_never_part_neighbours_and_sectors_never_part_directions():
    parts = Samples.concat([milling(50, k, f"p{k}") for k in range(4)])
    fold = folds(parts)
    assert all(len(np.unique(fold[parts.part == name])) == 1 for name in np.unique(parts.part.astype(str)))
    one = folds(milling(90), 3)
    assert (np.diff(one) >= 0).all()
    there = sectors(milling(2000))
    assert set(there) == set(range(8))


def test_eq_7_reduces_to_one_weight_per_category():
    rng = np.random.default_rng(0)
    origin, error = np.repeat([0, 1, 2], [50, 5, 25]), rng.normal(size=80)
    w_data, w_pe = 2.0, 0.5
    printed = sum(len(e) / 80 * w * np.mean(e**2) for e, w in ((error[origin == 0], w_data), (error[origin > 0], w_pe)))
    assert np.sum(loss_weights(origin, w_data, w_pe) * error**2) / 80 == pytest.approx(printed)
    trust = certainty_weights(origin, np.repeat(error[:, None], 4, axis=1), np.full(4, 0.3))
    assert (trust[:50] == 1).all()
    assert (np.diff(trust[50:, 0][np.argsort(np.abs(error[50:]))]) <= 0).all()


@pytest.mark.thorough
def test_the_adaptive_method_leaves_noise_alone():
    rng = np.random.default_rng(0)
    real = milling(800)
    noise = replace(real, currents=rng.normal(size=real.currents.shape))
    method = MethodSettings().build()
    found = adapt(noise, MILL, method, train=quick_trainer())
    rng = np.random.default_rng(2)
    made = balance_for(milling(300, 4), noise, MILL, method, found, rng=rng, train=quick_trainer())
    alone = AxisModels.fit(noise).predict(real)
    weights = np.vstack([np.ones((len(noise), 4)), made.weights])
    helped = AxisModels.fit(Samples.concat([noise, made.generated]), weights).predict(real)
    assert np.sqrt(np.mean(helped**2)) <= 1.02 * np.sqrt(np.mean(alone**2))  # the truth is zero


def test_the_adaptive_method_does_no_harm_where_samples_are_few():
    real = milling(160)
    truth = milling(1500, 9)
    method = MethodSettings().build()
    found = adapt(real, MILL, method, train=quick_trainer(), choice=PAPER_CHOICE)
    made = balance_for(truth, real, MILL, method, found, rng=np.random.default_rng(2), train=quick_trainer())
    weights = np.vstack([np.ones((len(real), 4)), made.weights])

    def rmse(models):
        return np.sqrt(np.mean((models.predict(truth) - truth.currents) ** 2, axis=0))

    alone, helped = rmse(AxisModels.fit(real)), rmse(AxisModels.fit(Samples.concat([real, made.generated]), weights))
    assert (helped <= 1.03 * alone).all()


def test_rows_of_a_coming_part_help_where_few_samples_show_what_friction_and_load_do():
    method = MethodSettings().build()
    real, truth = viscous(160), viscous(1500, 9)
    found = adapt(real, MILL, method, train=quick_trainer(), choice=PAPER_CHOICE)
    path = replace(truth, currents=np.full_like(truth.currents, np.nan))
    made = balance_for(path, real, MILL, method, found, rng=np.random.default_rng(2), train=quick_trainer())
    rows, report = made.generated, made.report
    assert len(rows)
    known = np.isfinite(rows.currents)
    assert known[rows.origin == PIA].any(axis=0).tolist() == list(found.trust.anchored)
    for axis, spacing in enumerate(found.trust.spacing):
        own = occupancy(rows.take(known[:, axis] & (rows.origin == PIE)).reduced, spacing.grid(SAMPLING_GRID))
        assert (own.count <= spacing.density).all()
    assert (rows.expected_error[known] > 0).all()
    assert report.pie.sum() == (rows.origin == PIE).sum()
    weights = np.vstack([np.ones((len(real), 4)), made.weights])
    alone = AxisModels.fit(real).predict(truth) - truth.currents
    helped = AxisModels.fit(Samples.concat([real, rows]), weights).predict(truth) - truth.currents
    better = np.sqrt(np.mean(helped**2, axis=0) / np.mean(alone**2, axis=0))
    assert better.min() < 0.9
    assert better.max() < 1.03


@pytest.mark.parametrize(("density", "width"), [(3.0, 1.0), (12.0, 0.5), (5.0, 2.0)])
def test_each_axis_takes_no_more_rows_of_a_path_than_its_own_bins_may_hold(density, width):
    path = milling(700)
    spacing = (Spacing(density, width), Spacing(), Spacing(4 * density, width), Spacing(1e6))
    take = taken(path, SAMPLING_GRID, spacing, np.random.default_rng(0))
    bins = Grid(tuple(width * w for w in SAMPLING_GRID.width)).ids(path.reduced)
    every = np.unique(bins, return_counts=True)[1]
    assert np.unique(bins[take[:, 0]], return_counts=True)[1].tolist() == np.minimum(every, density).tolist()
    assert (take[:, 0] <= take[:, 2]).all()  # more rows of the same bins: those, and others
    assert take[:, 3].all()


def viscous(n: int, seed: int = 0) -> Samples:
    """Parts with a viscous drag that trees step through and equations know."""
    part = milling(n, seed)
    return replace(part, currents=part.currents + 0.3 * part.inputs[:, [0, 1, 0, 1]])


def test_rows_are_taken_more_densely_where_models_learn_more_from_more_of_them():
    coarse, few = Grid((40.0, 40.0, 400.0)), 2.0  # a handful of rows for the whole path
    found = learn(viscous(400), MILL, quick_trainer(), grid=coarse, density=few)
    assert max(one.density for one in found.spacing) > few
    assert all(one.density == few for one, terms in zip(found.spacing, found.terms, strict=True) if terms is None)


def test_the_plain_spacing_stays_where_no_other_is_better():
    found = learn(viscous(400), MILL, quick_trainer(), density=1e6)  # all rows of a path, however fine the bins
    assert found.any
    assert found.spacing == (Spacing(1e6),) * 4


def test_no_row_is_generated_for_models_that_gain_nothing_by_it():
    quick = quick_trainer()

    def deaf(samples, weights):
        heard = samples.origin == REAL
        return quick(samples.take(heard), weights[heard])

    assert learn(viscous(400), MILL, quick).any
    found = learn(viscous(400), MILL, deaf)
    assert not found.any
    assert not any(found.anchored)


@pytest.mark.thorough
def test_trust_depends_on_the_set_of_parts_and_not_on_their_order():
    a, b = milling(300, 1, "a"), milling(300, 2, "b")
    one, two = (learn(Samples.concat(parts), MILL, quick_trainer()) for parts in ([a, b], [b, a]))
    np.testing.assert_array_equal(one.share, two.share)
    assert one.terms == two.terms


def test_an_equation_that_is_wrong_in_every_play_is_not_followed():
    real = milling(800)
    bent = replace(real, currents=np.sin(3 * real.inputs[:, [0, 1, 0, 1]]))  # no equation has such a term
    found = learn(bent, MILL, quick_trainer(trees=30))
    assert (found.share <= 0.25).all()


def test_a_plan_is_needed_where_rows_of_it_are_asked_for():
    real = milling(100)
    with pytest.raises(FitError, match="planned"):
        optimise(
            real, relevant_bins(real.reduced, SAMPLING_GRID), equations_on(real, real), ShareRule(),
            rng=np.random.default_rng(0), nuisance="planned",
        )  # fmt: skip


def test_printed_settings_build_the_printed_method():
    method = MethodSettings.paper().build()
    assert method.gate == OPEN or (method.gate.quantile is None and not method.gate.compare)
    assert (method.nuisance, method.adaptive, method.share.density) == ("paper", False, 40.0)
    assert MethodSettings().build().adaptive


def half_trusted(*used):
    """Half way between model and equation on the axes `used`; no generated rows on the others."""
    terms = tuple(HELD if axis in used else None for axis in range(4))
    share = np.where(np.isin(np.arange(4), used)[:, None], 0.5, 0.0) * np.ones((4, 5))
    return Trust(terms, share, np.full((4, 5), 0.1), (-0.1,) * 4, (HELD, FRICTION))


def test_an_axis_without_generated_rows_leaves_those_of_the_others_as_they_are():
    real, rows, train = milling(300), milling(100, 5), quick_trainer()
    every, error, where, _ = currents(rows, real, MILL, half_trusted(0, 1, 2, 3), train)
    some, its_error, its_where, _ = currents(rows, real, MILL, half_trusted(0, 3), train)
    assert np.isnan(some[:, 1:3]).all()
    assert np.isfinite(some[:, [0, 3]]).any()
    np.testing.assert_array_equal(some[:, [0, 3]], every[:, [0, 3]])
    np.testing.assert_array_equal(its_error[:, [0, 3]], error[:, [0, 3]])
    np.testing.assert_array_equal(its_where, where)


def test_models_kept_from_balancing_are_those_that_training_afresh_gives():
    real, path, recipe = milling(300), milling(200, 5), iteration.Recipe()
    adaptation = Adaptation(PAPER_CHOICE, None, (ShareRule(),) * 4, {}, 300, half_trusted(0, 3))
    kept, digests = Trained(), []
    for trained in (kept, None):
        made = iteration.balance(real, path, adaptation, MILL, recipe, 0, trained)
        for variant in ("real", "both"):
            models = iteration.retrain(real, made.generated, made.weights, variant, recipe, 0, trained)
            digests.append(models.digest())
    assert len(made.generated)
    assert digests[:2] == digests[2:]


def test_what_was_learned_about_trust_survives_being_a_file():
    share = np.linspace(0, 1, 20).reshape(4, 5)
    trust = Trust((HELD, None, FRICTION, HELD), share, share + np.inf, (-0.1, 0.0, -0.2, 0.0), (HELD, FRICTION),
                  (Spacing(), Spacing(10.0, 0.5), Spacing(160.0), Spacing()), (True, False, True, False))  # fmt: skip
    kept = Adaptation(PAPER_CHOICE, None, (ShareRule(),) * 4, {"trusted": trust.gain}, 7, trust)
    back = load(dump(kept), MILL).trust
    assert (back.terms, back.gain, back.tried) == (trust.terms, trust.gain, trust.tried)
    assert back.spacing == trust.spacing
    assert back.anchored == trust.anchored
    np.testing.assert_array_equal(back.share, trust.share)
    np.testing.assert_array_equal(back.error, trust.error)
