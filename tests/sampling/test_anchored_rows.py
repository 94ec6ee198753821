"""Rows between recorded ones, and whether models gain by them."""

from dataclasses import replace

import numpy as np

from pido.core.samples import PIA, PIE, Samples
from pido.equations.choose import PAPER_CHOICE
from pido.feature_space.grid import SAMPLING_GRID
from pido.models.axis_models import quick_trainer
from pido.sampling.anchored import PER_ROW, anchored, unsaid
from pido.sampling.method import Adaptation, Method, balance_for
from pido.sampling.shares import ShareRule
from pido.sampling.trust import learn
from tests.sampling.test_sampling import MILL, half_trusted, milling


def as_before(samples, weights):
    """A model that learns nothing."""
    return lambda rows: np.zeros((len(rows), 4))


def rows_of(real, seed=0):
    return anchored(real, real, as_before, SAMPLING_GRID, np.random.default_rng(seed))


def test_a_row_is_for_one_axis_and_lies_between_its_anchor_and_a_neighbour():
    real = milling(400)
    made = rows_of(real)
    assert len(made) == 4 * PER_ROW * len(real)
    assert (np.isfinite(made.currents).sum(axis=1) == 1).all()
    assert (made.origin == PIA).all()
    assert (made.voxel == SAMPLING_GRID.ids(made.reduced)).all()
    for axis in range(4):
        own = made.currents[np.isfinite(made.currents[:, axis]), axis]
        assert real.currents[:, axis].min() <= own.min() <= own.max() <= real.currents[:, axis].max()


def test_an_axis_that_was_not_recorded_gets_no_rows():
    real = milling(300)
    currents = real.currents.copy()
    currents[:, 2] = np.nan
    currents[20:, 3] = np.nan
    made = rows_of(replace(real, currents=currents))
    known = np.isfinite(made.currents).sum(axis=0)
    assert known.tolist() == [PER_ROW * 300, PER_ROW * 300, 0, PER_ROW * 20]
    assert not len(rows_of(replace(real, currents=np.full_like(currents, np.nan))))


def test_rare_currents_are_anchors_more_often_and_the_order_of_parts_does_not_matter():
    a, b = milling(300, 1, "a"), milling(300, 2, "b")
    currents = a.currents.copy()
    currents[:6, 3] += 50.0  # a run-up
    a = replace(a, currents=currents)
    one, two = rows_of(Samples.concat([a, b])), rows_of(Samples.concat([b, a]))
    np.testing.assert_array_equal(one.currents, two.currents)
    np.testing.assert_array_equal(one.inputs, two.inputs)
    spindle = one.currents[np.isfinite(one.currents[:, 3]), 3]
    assert (spindle > 25).mean() > 5 * 6 / 600


def as_far(path, share):
    """The path with that share of its rows twenty times as fast as anything recorded."""
    inputs = path.inputs.copy()
    inputs[: int(share * len(path)), :2] *= 20
    return replace(path, inputs=inputs)


def carried(real):
    """A model that anchored rows make say something else everywhere, but for z."""

    def train(samples, weights):
        by = real.currents.std(axis=0) * [1.0, 1.0, 0.0, 1.0] * (len(samples) > len(real))
        return lambda rows: rows.inputs[:, :4] + by

    return train


def test_where_a_part_leaves_what_was_recorded_the_models_own_word_goes_with_them():
    """Trees carry the rows to where nothing was recorded: rows of the path hold them."""
    real, path = milling(600, 1), replace(as_far(milling(300, 2), 0.2), row=np.arange(300))
    made = anchored(real, path, carried(real), SAMPLING_GRID, np.random.default_rng(0))
    held = made.take(made.origin == PIE)
    assert len(made) == 4 * PER_ROW * len(real) + len(held)
    assert 40 < len(held) <= 60
    assert set(held.row) <= set(range(60))
    np.testing.assert_array_equal(held.inputs, path.inputs[held.row])
    np.testing.assert_array_equal(held.currents[:, [0, 1, 3]], path.inputs[held.row][:, [0, 1, 3]])
    assert np.isnan(held.currents[:, 2]).all()  # which says the same with them
    assert np.isfinite(held.expected_error[:, [0, 1, 3]]).all()
    near = anchored(real, milling(300, 2), carried(real), SAMPLING_GRID, np.random.default_rng(0))
    assert (near.origin == PIE).mean() < 0.01


def test_a_part_that_goes_elsewhere_gets_none():
    real, path = milling(600, 1), milling(300, 2)
    still = real.inputs.copy()
    still[:, 6] = 18_000.0  # the spindle never changed its speed
    for known, coming in ((real, as_far(path, 0.6)), (replace(real, inputs=still), path)):
        assert not len(anchored(known, coming, as_before, SAMPLING_GRID, np.random.default_rng(0)))


def test_an_axis_without_anchored_rows_is_not_held_and_what_an_equation_says_stands():
    real, path = milling(600, 1), replace(as_far(milling(300, 2), 0.2), row=np.arange(300))
    currents = real.currents.copy()
    currents[:, 1] = np.nan
    made = anchored(replace(real, currents=currents), path, carried(real), SAMPLING_GRID, np.random.default_rng(0))
    held = made.take(made.origin == PIE)
    assert np.isfinite(held.currents).any(axis=0).tolist() == [True, False, False, True]
    says = np.full((10, 4), np.nan)
    says[:, 0] = 1.0
    left = unsaid(made, held.row[:10], says)
    assert np.isfinite(left.currents[left.origin == PIE, 0]).sum() == len(held) - 10
    assert np.isfinite(left.currents[left.origin == PIE, 3]).sum() == len(held)
    np.testing.assert_array_equal(left.take(left.origin == PIA).currents, made.take(made.origin == PIA).currents)


def test_of_many_rows_an_even_share_says_what_the_models_own_word_is():
    asked = []

    def count(samples, weights):
        asked.append(len(samples))
        return as_before(samples, weights)

    real = milling(10_000)
    assert len(anchored(real, as_far(real, 0.05), count, SAMPLING_GRID, np.random.default_rng(0))) > 10_000
    assert len(asked) == 2
    assert asked[0] < 5_000
    assert asked[0] < asked[1] < 5_000 * (1 + 4 * PER_ROW)


def run_ups(n: int, seed: int = 0) -> Samples:
    """Parts whose spindle draws a lot in a few rows, which nothing but its acceleration announces."""
    part = milling(n, seed)
    inputs, currents = part.inputs.copy(), part.currents.copy()
    at = np.arange(5, n, 25)
    inputs[at, 7] = 5_000.0 * np.where(np.arange(len(at)) % 2, 1, -1)
    currents[at, 3] += 0.01 * inputs[at, 7]
    return replace(part, inputs=inputs, currents=currents)


def test_they_are_used_where_a_forest_draws_a_few_rows_to_their_surroundings():
    assert learn(run_ups(400), MILL, quick_trainer()).anchored[3]


def test_the_report_counts_rows_in_the_bins_in_which_they_lie_and_says_how_many_lie_in_none_of_the_part():
    real, path = milling(600, 1), milling(200, 2, turn=(0.0, np.pi / 2))
    trust = replace(half_trusted(0), anchored=(True,) * 4)
    found = Adaptation(PAPER_CHOICE, None, (ShareRule(),) * 4, {}, len(real), trust)
    made = balance_for(path, real, MILL, Method(), found, rng=np.random.default_rng(0), train=quick_trainer())
    report, lies = made.report, SAMPLING_GRID.ids(made.generated.reduced)
    for origin, counted, beside in zip((PIA, PIE), (report.pia, report.pie), report.elsewhere, strict=True):
        mine = lies[made.generated.origin == origin]
        assert counted.tolist() == [int((mine == b).sum()) for b in report.bins]
        assert beside == int((~np.isin(mine, report.bins)).sum())
    assert report.elsewhere[0] > report.pia.sum() > 0
    assert f"{report.elsewhere[0]} in bins that the coming part does not go through" in report.summary()
