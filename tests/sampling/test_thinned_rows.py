"""Rows of a store that outgrows memory: what is kept does not depend on the way there, and is even."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.core.samples import Samples
from pido.feature_space.grid import Grid
from pido.rows import Rows
from pido.sampling.thin import BinCounts, kept, level, places

GRID = Grid((2.0, 2.0, 2.0))


def part(name: str, n: int, seed: int, spread: float = 6.0) -> Samples:
    rng = np.random.default_rng(seed)
    inputs = rng.normal(0, spread, (n, 13))
    return Samples.real(
        inputs, np.abs(rng.normal(0, 4, n)), rng.normal(size=(n, 4)), np.sign(inputs[:, :4]), name, np.arange(n)
    )


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 500), min_size=1, max_size=30), st.integers(1, 4000))
def test_no_higher_level_than_k_keeps_the_limit(count, limit):
    counts = BinCounts(np.arange(len(count)), np.array(count))
    k = level(counts, limit)
    assert np.minimum(counts.count, k).sum() <= limit + 1e-6
    if counts.rows > limit:
        assert np.minimum(counts.count, k + 1e-3).sum() > limit


def test_places_are_even_and_belong_to_a_part_and_its_row():
    rows = part("a", 20_000, 0)
    at = places(rows)
    assert np.abs(np.histogram(at, 20, (0, 1))[0] - 1000).max() < 5 * np.sqrt(1000)
    np.testing.assert_array_equal(places(rows.take(slice(7, None, 3))), at[7::3])
    assert np.corrcoef(at, places(part("b", 20_000, 0)))[0, 1] == pytest.approx(0, abs=0.03)
    assert np.corrcoef(at[1:], at[:-1])[0, 1] == pytest.approx(0, abs=0.03)


def test_rare_bins_stay_whole_and_crowded_ones_are_cut_to_one_height():
    rows = part("a", 30_000, 1, spread=3.0)
    counts = BinCounts.of(rows.reduced, GRID)
    stays = kept(rows, counts, 8000, GRID)
    assert stays.sum() == pytest.approx(8000, rel=0.05)
    left, k = BinCounts.of(rows.take(stays).reduced, GRID), level(counts, 8000)
    whole = dict(zip(left.bins, left.count, strict=True))
    for bin_, count in zip(counts.bins, counts.count, strict=True):
        if count <= k:
            assert whole[bin_] == count
        else:
            assert abs(whole.get(bin_, 0) - k) <= 6 * np.sqrt(k)


class _Parts:
    """Parts in memory that remember how often they were read."""

    def __init__(self, names: str) -> None:
        self.parts = {name: part(name, 2000, k) for k, name in enumerate(names)}
        self.read: list[str] = []

    def __call__(self, name: str) -> Samples:
        self.read.append(name)
        return self.parts[name]


def _same(a: Samples, b: Samples) -> None:
    for name in ("inputs", "ar", "currents", "direction", "row", "part"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_kept_rows_are_the_same_added_one_by_one_in_any_order_or_read_at_once(tmp_path: Path):
    at_once = Rows(tmp_path / "once", "s", GRID, _Parts("abcdef")).of("abcdef", 3000)
    assert 2700 < len(at_once) < 3300
    growing = Rows(tmp_path / "grown", "s", GRID, _Parts("abcdef"))
    for known in ("bd", "bdf", "bdef", "abdef", "abcdef"):
        grown = growing.of(known, 3000)
    _same(grown, at_once)


def test_a_new_part_costs_its_own_rows_and_not_those_of_the_parts_before(tmp_path: Path):
    source = _Parts("abcdef")
    rows = Rows(tmp_path, "s", GRID, source)
    rows.of("abcde", 3000)
    source.read.clear()
    rows.of("abcdef", 3000)
    assert set(source.read) == {"f"}
    source.read.clear()
    rows.of("abcdef", 3000)
    assert source.read == []


def test_below_the_limit_every_row_is_there(tmp_path: Path):
    source = _Parts("ab")
    found = Rows(tmp_path, "s", GRID, source).of("ba", 4000)
    _same(found, Samples.concat([source.parts["b"], source.parts["a"]]))


def test_a_part_that_is_taken_out_again_leaves_no_trace(tmp_path: Path):
    rows = Rows(tmp_path, "s", GRID, _Parts("abcd"))
    first = rows.of("abc", 2500)
    rows.of("abcd", 2500)
    rows._place("abc", 2500).unlink()
    _same(rows.of("abc", 2500), first)


def test_other_settings_do_not_find_what_was_kept_under_these(tmp_path: Path):
    source = _Parts("abcd")
    Rows(tmp_path, "s", GRID, source).of("abcd", 2500)
    source.read.clear()
    Rows(tmp_path, "t", GRID, source).of("abcd", 2500)
    assert set(source.read) == set("abcd")
