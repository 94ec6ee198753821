from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.config import machine
from pido.core.columns import INPUTS
from pido.core.errors import FitError
from pido.core.samples import Samples
from pido.equations.choose import candidates, choose, fit_chosen
from pido.equations.fit import approximation, fit_global, fit_global_from, fit_local, fit_local_from
from pido.equations.moments import Moments
from pido.equations.terms import CONSTANT, HELD, PAPER, PAPER_HELD, TERM_SETS, term_set
from pido.equations.weights import PAPER_KERNELS, Kernel
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import EQUATION_GRID, Grid

MILL = machine("smart_mill")


def rows(n=600, seed=0, noise=0.2, part="p"):
    """Full-rank inputs of a small mill with both spindle directions, and currents from known coefficients."""
    rng = np.random.default_rng(seed)
    size = np.array([8, 8, 2, 300, 300, 50, 20000, 5000, 60, 60, 20, 0.3, 30.0])
    inputs = rng.normal(size=(n, 13)) * size
    inputs[:, 12] = np.abs(inputs[:, 12])
    currents = np.sign(inputs[:, :1]) * [1.0, 0.3, 0.1, 0] + inputs[:, [1]] * [0, 0.1, 0, 0.02] + [2.0, -5.0, 1.0, 8.0]
    currents = currents + rng.normal(scale=noise, size=(n, 4))
    ar = rng.uniform(0, 40, n)
    return Samples.real(inputs, ar, currents, np.sign(inputs[:, [0, 1, 2, 6]]), part, np.arange(n))


def textbook(samples, centre, kernel, terms, axis):
    """One bin by itself: numpy's least squares on rows weighted one by one, with the ridge as extra rows."""
    X, y = terms.design(samples, MILL), samples.currents[:, axis]
    distance = (samples.reduced - centre) * [1, 1, kernel.alpha]
    w = np.exp(-np.sum(distance**2, axis=1) / (2 * kernel.sigma**2)) + kernel.beta
    root = np.sqrt(w / w.sum())
    penalty = np.eye(len(terms)) * terms.floor
    penalty[terms.constant] = 0
    A = np.vstack([root[:, None] * X, penalty])
    return np.linalg.lstsq(A, np.r_[root * y, np.zeros(len(terms))], rcond=None)[0]


@pytest.mark.parametrize("terms", [PAPER, HELD], ids=lambda t: t.id)
def test_local_fits_are_per_bin_weighted_least_squares_to_a_hundred_millionth_of_the_noise(terms):
    samples, noise = rows(), 0.2
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::40]
    kernels = [*PAPER_KERNELS[:3], Kernel(0.1, 0.01, 2.0)]
    fit = fit_local(samples, bins, MILL, terms=terms, kernels=kernels)
    X = terms.design(samples, MILL)
    for b, centre in enumerate(EQUATION_GRID.centres(bins)):
        for axis in range(4):
            expected = X @ textbook(samples, centre, kernels[axis], terms, axis)
            error = X @ fit.coefficients[axis, b] - expected
            assert np.sqrt(np.mean(error**2)) < 1e-8 * noise


def test_the_ridge_of_the_printed_terms_is_far_below_the_noise():
    samples = rows(4000)
    X = PAPER.design(samples, MILL)
    plain = X @ np.linalg.lstsq(X, samples.currents, rcond=None)[0]
    assert np.abs(fit_global(samples, MILL).predict(samples) - plain).max() < 1e-3 * 0.2


def test_statistics_of_the_whole_give_the_global_equation_that_the_samples_give():
    samples = rows(2000)
    moments = Moments(PAPER, MILL)
    moments.add(samples)
    difference = fit_global_from(moments).predict(samples) - fit_global(samples, MILL).predict(samples)
    assert np.abs(difference).max() < 1e-8


def test_per_bin_statistics_approach_exact_distances_as_cells_shrink():
    samples = rows(3000)
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::50]
    exact = fit_local(samples, bins, MILL)
    errors = []
    for width in ((2.0, 2.0, 20.0), (1.0, 1.0, 10.0), (0.25, 0.25, 2.5)):
        moments = Moments(PAPER, MILL, Grid(width))
        moments.add(samples)
        errors.append(approximation(fit_local_from(moments, bins), exact, samples).max())
    assert errors[1] < 0.005
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("terms", [t for t in TERM_SETS], ids=lambda t: t.id)
def test_predictions_do_not_depend_on_the_unit_of_spindle_speed(terms):
    samples, k = rows(), 1 / 360  # revolutions instead of degrees
    inputs = samples.inputs.copy()
    inputs[:, 6:8] *= k
    slow = replace(MILL, spindle_max_deg_s=MILL.spindle_max_deg_s * k, spindle_acc_deg_s2=MILL.spindle_acc_deg_s2 * k)
    there = replace(samples, inputs=inputs)
    a, b = fit_global(samples, MILL, terms).predict(samples), fit_global(there, slow, terms).predict(there)
    np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("way", ["exact", "statistics"])
def test_predictions_do_not_depend_on_the_order_of_the_rows(way):
    samples = rows()
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::60]
    results = []
    for order in (np.arange(len(samples)), np.random.default_rng(3).permutation(len(samples))):
        mixed = samples.take(order)
        if way == "exact":
            results.append(fit_local(mixed, bins, MILL).predict(samples))
        else:
            moments = Moments(PAPER, MILL)
            moments.add(mixed)
            results.append(fit_local_from(moments, bins).predict(samples))
    np.testing.assert_allclose(results[0], results[1], atol=1e-9)


@given(k=st.integers(2, 5), seed=st.integers(0, 2**16))
@settings(max_examples=10, deadline=None)
def test_a_sample_that_occurs_k_times_counts_k_times(k, seed):
    once = rows(80, seed)
    X = HELD.design(once, MILL)
    counts = np.r_[k, np.ones(len(once) - 1, int)]
    fit = fit_global(once.take(np.repeat(np.arange(len(once)), counts)), MILL, HELD)
    root = np.sqrt(counts / counts.sum())[:, None]
    penalty = np.eye(len(HELD)) * HELD.floor
    penalty[HELD.constant] = 0
    A, y = np.vstack([root * X, penalty]), np.vstack([root * once.currents, np.zeros((len(HELD), 4))])
    np.testing.assert_allclose(fit.predict(once), X @ np.linalg.lstsq(A, y, rcond=None)[0], atol=1e-8)


def test_the_kernel_has_the_peak_one_so_that_a_local_equation_is_local():
    kernel = PAPER_KERNELS[0]
    assert kernel.weights(np.zeros((1, 3)), np.zeros((1, 3)))[0, 0] == pytest.approx(1 + kernel.beta)
    far = kernel.weights(np.zeros((1, 3)), np.array([[100.0, 0, 0]]))
    assert far[0, 0] == pytest.approx(kernel.beta)


def test_with_an_endless_width_every_local_equation_is_the_global_one():
    samples = rows()
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::50]
    fit = fit_local(samples, bins, MILL, kernels=[Kernel(0.0, 0.0, 1e8)] * 4)
    np.testing.assert_allclose(fit.predict(samples), fit.overall.predict(samples), atol=1e-8)
    np.testing.assert_allclose(fit.effective, len(samples), rtol=1e-9)


def test_an_axis_without_current_stays_without_and_does_not_touch_the_others():
    samples = rows()
    currents = samples.currents.copy()
    currents[:, 2] = np.nan
    currents[::3, 0] = np.nan
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::60]
    holed, whole = replace(samples, currents=currents), samples
    fit, reference = fit_local(holed, bins, MILL), fit_local(whole, bins, MILL)
    assert np.isnan(fit.predict(samples)[:, 2]).all()
    np.testing.assert_allclose(fit.predict(samples)[:, 1], reference.predict(samples)[:, 1], atol=1e-9)
    present = whole.take(np.isfinite(currents[:, 0]))
    np.testing.assert_allclose(
        fit.predict(samples)[:, 0], fit_local(present, bins, MILL).predict(samples)[:, 0], atol=1e-9
    )
    moments = Moments(PAPER, MILL, Grid((0.25, 0.25, 2.5)))
    moments.add(holed)
    np.testing.assert_allclose(fit_local_from(moments, bins).predict(samples), fit.predict(samples), atol=0.01)


def test_terms_that_say_nothing_are_dropped_and_named():
    samples = rows()
    inputs = samples.inputs.copy()
    inputs[:, 6], inputs[:, 12] = np.abs(inputs[:, 6]), 0.0  # one spindle direction, nothing removed
    fit = fit_global(replace(samples, inputs=inputs), MILL)
    assert set(fit.dropped) == {"sgn(v_sp)", "F_x MRR", "F_y MRR", "F_z MRR", "M_sp MRR"}
    assert fit.rank.tolist() == [12] * 4
    assert (fit.coefficients[:, [2, 7, 11, 15, 16]] == 0).all()


@given(st.permutations(range(4)), st.integers(0, 3))
@settings(max_examples=15, deadline=None)
def test_statistics_depend_on_which_parts_are_in_and_not_on_how_they_came(order, gone):
    parts = [rows(60, seed=k, part=f"p{k}") for k in range(5)]
    straight, crooked = Moments(PAPER, MILL), Moments(PAPER, MILL)
    for k in sorted(set(range(4)) - {gone}):
        straight.add(parts[k])
    crooked.add(parts[4])
    for k in order:
        crooked.add(parts[k])
    crooked.remove(parts[gone])
    crooked.remove(parts[4])
    assert crooked.digest() == straight.digest()
    assert len(crooked) == 180
    again = Moments.from_arrays(crooked.arrays(), PAPER, MILL)
    assert again.digest() == straight.digest()


def test_removing_what_was_never_added_is_refused():
    moments = Moments(PAPER, MILL)
    moments.add(rows(50))
    with pytest.raises(FitError, match="only samples that were added"):
        moments.remove(rows(50, seed=9))


def test_taking_one_part_out_leaves_what_the_others_give():
    a, b = rows(300, 1), rows(300, 2)
    both, one = Moments(HELD, MILL), Moments(HELD, MILL)
    both.add(a)
    both.add(b)
    one.add(b)
    alone = Moments(HELD, MILL)
    alone.add(a)
    assert both.without(one).digest() == alone.digest()
    assert alone.merged(one).digest() == both.digest()


def test_the_printed_terms_are_those_of_equation_17():
    one = np.array([[2.0, -3.0, 0.5, 7.0, 11.0, -13.0, 100.0, -40.0, 5.0, 6.0, 8.0, 0.2, 9.0]])
    samples = Samples.real(one, np.array([1.0]), np.zeros((1, 4)), np.ones((1, 4)), "p", np.array([0]))
    raw = PAPER.design(samples, MILL)[0] * PAPER.scale(MILL)
    by_hand = [
        7 * 2,
        4,
        5 * 9,
        1,
        1,
        11 * -3 * -1,
        -9,
        6 * 9,
        -1,
        -13 * 0.5,
        0.25,
        8 * 9,
        1,
        -40 * 100,
        1e4,
        0.2 * 9,
        1,
    ]
    np.testing.assert_allclose(raw, by_hand)
    held = PAPER_HELD.design(samples, MILL)[0]
    assert held[8] == 1.0  # last moved in +y, whatever the velocity says now


def test_standard_error_covers_the_truth_as_often_as_it_says():
    terms, hits = HELD, []
    truth = rows(400, 0, noise=0.0)
    for seed in range(30):
        noisy = replace(truth, currents=truth.currents + np.random.default_rng(seed).normal(scale=0.5, size=(400, 4)))
        fit = fit_local(
            noisy, relevant_bins(truth.reduced, EQUATION_GRID)[:1], MILL, terms=terms, kernels=[Kernel(0, 1, 1e6)] * 4
        )
        inside = truth.take(fit.grid.ids(truth.reduced) == fit.bins[0])
        value, error, _ = fit.predict_with_support(inside)
        hits.append(np.abs(value - inside.currents) < 1.96 * error)
    assert np.mean(np.concatenate(hits)) == pytest.approx(0.95, abs=0.06)


def test_leverage_tells_directions_that_no_sample_took():
    samples = rows(500)
    inputs = samples.inputs.copy()
    inputs[:, 1] = inputs[:, 4] = 0.0  # everything along x
    along = replace(samples, inputs=inputs, direction=np.sign(inputs[:, [0, 1, 2, 6]]))
    bins = np.unique(np.r_[relevant_bins(along.reduced, EQUATION_GRID), relevant_bins(samples.reduced, EQUATION_GRID)])
    fit = fit_local(along, bins, MILL, terms=HELD)
    usual, strange = (fit.predict_with_support(s)[2] for s in (along, samples))
    assert np.quantile(strange, 0.1) > np.quantile(usual, 0.95)


def test_a_constant_current_is_described_by_a_constant():
    samples = rows(500)
    currents = np.random.default_rng(5).normal(loc=3.0, size=samples.currents.shape)
    choice = choose(replace(samples, currents=currents), MILL)
    assert {c.terms for c in choice.near} <= {CONSTANT, term_set("held-small")}
    assert sum(c.terms == CONSTANT for c in choice.near) >= 3


def test_friction_at_standstill_is_only_described_by_terms_that_remember():
    rng = np.random.default_rng(0)
    samples = rows(1500)
    inputs = samples.inputs.copy()
    rest = rng.random(len(samples)) < 0.5
    inputs[rest, 0] = rng.normal(scale=1e-6, size=rest.sum())
    currents = samples.direction[:, :1] * [1.0, 0, 0, 0] + rng.normal(scale=0.05, size=samples.currents.shape)
    standing = replace(samples, inputs=inputs, currents=currents)
    choice = choose(standing, MILL)
    assert choice.near[0].terms.id in ("held", "held-small", "paper-held")
    fit = fit_chosen(standing, relevant_bins(standing.reduced, EQUATION_GRID), MILL, choice, blend=True)
    assert np.sqrt(np.mean((fit.predict(standing)[:, 0] - currents[:, 0]) ** 2)) < 0.07


def test_friction_that_rises_towards_rest_is_described_by_terms_that_fall_with_speed():
    rng = np.random.default_rng(3)
    samples = rows(1500)
    inputs = samples.inputs.copy()
    inputs[:, 0] = np.sign(inputs[:, 0]) * 10.0 ** rng.uniform(-2, 1, len(samples))  # mm/s
    friction = np.sign(inputs[:, 0]) * (0.5 + np.exp(-((inputs[:, 0] / 0.3) ** 2)))
    currents = friction[:, None] * [1.0, 0, 0, 0] + rng.normal(scale=0.05, size=samples.currents.shape)
    falling = replace(samples, inputs=inputs, currents=currents, direction=np.sign(inputs[:, [0, 1, 2, 6]]))
    assert choose(falling, MILL).near[0].terms.id == "friction"


class _Ripple:
    name, axis, found = "ripple", "x", (0.0,)

    def columns(self, samples):
        return np.sin(samples.inputs[:, 0])[:, None]


def test_an_accepted_term_joins_the_equation_and_takes_its_amplitude():
    samples = rows(800, noise=0.01)
    extra = replace(samples, currents=samples.currents + 0.7 * np.sin(samples.inputs[:, :1]))
    fit = fit_global(extra, MILL, HELD.extended(_Ripple()))
    np.testing.assert_allclose(fit.coefficients[0, -1], 0.7, atol=0.01)
    tried = candidates(HELD.extended(_Ripple()))
    assert any(c.terms.id == "held+ripple" for c in tried)


@pytest.mark.parametrize("way", ["one for all", "exact", "statistics", "some axes not recorded"])
def test_an_accepted_term_changes_no_axis_but_its_own(way):
    samples = rows(800, noise=0.01)
    currents = samples.currents + 0.7 * np.sin(samples.inputs[:, :1])
    if way == "some axes not recorded":
        currents[:300, 1] = np.nan
    samples = replace(samples, currents=currents)
    bins = relevant_bins(samples.reduced, EQUATION_GRID)[::50]

    def fit(terms):
        if way == "one for all":
            return fit_global(samples, MILL, terms)
        moments = Moments(terms, MILL)
        moments.add(samples)
        return fit_local_from(moments, bins) if way == "statistics" else fit_local(samples, bins, MILL, terms=terms)

    plain, extended = fit(HELD), fit(HELD.extended(_Ripple()))
    for said in ("predict", "leverage") if way == "one for all" else ("predict",):
        before, after = (getattr(equation, said)(samples) for equation in (plain, extended))
        np.testing.assert_allclose(after[:, 1:], before[:, 1:], rtol=1e-9, atol=1e-9)
        assert np.abs(after[:, 0] - before[:, 0]).max() > 1e-4
    assert plain.terms.concerns("y")
    assert not extended.terms.concerns("y")


def test_a_missing_input_is_refused_by_name():
    samples = rows(20)
    inputs = samples.inputs.copy()
    inputs[3, INPUTS.index("a_y")] = np.nan
    with pytest.raises(FitError, match="sample 3"):
        Moments(PAPER, MILL).add(replace(samples, inputs=inputs))
    with pytest.raises(FitError, match="never filled in"):
        fit_global(replace(samples, inputs=inputs), MILL)
