"""Proof: intervals that hold what they promise, p values under no effect, and curves that cannot run away."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.confirm import Whitened, even, half_widths, held_out, p_value, q_values
from pido.diagnosis.diagnose import proved
from pido.diagnosis.estimate import estimate, settle_shapes
from pido.diagnosis.formulas import Formula, Surface
from pido.diagnosis.gates import Gate
from pido.diagnosis.identify import Answer
from pido.diagnosis.misfit import useless
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.models import AxisModel
from pido.diagnosis.terms import Term, fit, held_back, solve
from pido.diagnosis.transients import Transient
from tests.diagnosis.feeds import BY_ID
from tests.diagnosis.planted import NOISE, STEP, VISCOUS, planted

_ROWS, _BLOCKS = 1200, 40


def _laid_out(parts: int) -> Mismatch:
    """Only what the statistics read: how rows fall into parts and blocks."""
    rows = np.arange(_ROWS)
    return Mismatch(
        axis="x",
        states=tuple(SimpleNamespace(part=f"p{i}") for i in range(parts)),  # type: ignore[arg-type]
        target=np.zeros(_ROWS),
        base=np.zeros((0, _ROWS)),
        base_names=(),
        sim=None,
        part=rows * parts // _ROWS,
        block=rows * _BLOCKS // _ROWS,
        starts=rows == 0,
        usable=np.ones(_ROWS, bool),
        noise_class=np.zeros(_ROWS, int),
    )


def _noise(rng: np.random.Generator) -> np.ndarray:
    """Rows whose spread differs from block to block and that share a part of it within a block."""
    block = np.arange(_ROWS) * _BLOCKS // _ROWS
    spread = np.exp(0.3 * rng.normal(size=_BLOCKS))[block]
    return spread * rng.normal(size=_ROWS) + 0.15 * rng.normal(size=_BLOCKS)[block]


@pytest.mark.parametrize("parts", [1, pytest.param(10, marks=pytest.mark.thorough)])
def test_a_95_percent_interval_holds_the_truth_in_90_to_98_of_100_repetitions(parts):
    mismatch, rng, truth = _laid_out(parts), np.random.default_rng(5), np.array([0.4, -1.2])
    held = []
    for _ in range(250):
        X = rng.normal(size=(2, _ROWS)) + rng.normal(size=(2, _BLOCKS))[:, mismatch.block]
        y = truth @ X + _noise(rng)
        beta, _ = solve(X, y)
        half = half_widths(Whitened(X, y, (slice(0, 2),)), mismatch, rng, draws=120)
        held += list(np.abs(beta - truth) <= half)
    assert 0.90 <= np.mean(held) <= 0.98


def test_without_an_effect_p_values_are_not_smaller_than_their_name():
    mismatch, rng, p = _laid_out(1), np.random.default_rng(8), []
    for _ in range(400):
        X = rng.normal(size=(2, _ROWS)) + rng.normal(size=(2, _BLOCKS))[:, mismatch.block]
        p.append(p_value(Whitened(X, _noise(rng), (slice(0, 1), slice(1, 2))), 1, mismatch.block))
    for size in (0.05, 0.2):
        # Binomial: at most this many of 400 lie below `size` in 999 of 1000 such experiments.
        assert np.sum(np.array(p) < size) <= stats.binom.ppf(0.999, 400, size)


@pytest.mark.parametrize("acts", [3, 5, 8])
def test_a_term_of_few_blocks_has_an_honest_p_value_which_is_as_sure_as_all_blocks_make_it(acts):
    mismatch, rng, p = _laid_out(1), np.random.default_rng(4), []
    for _ in range(400):
        X = rng.normal(size=_ROWS) * (mismatch.block % (_BLOCKS // acts) == 0)
        p.append(p_value(Whitened(X[None], _noise(rng), (slice(0, 1),)), 0, mismatch.block, pooled=True))
    assert np.mean(np.array(p) < 0.05) < 0.08
    assert np.mean(np.array(p) < 0.005) < 0.02
    X = 1.0 * (mismatch.block < acts)
    y = 1.5 * X + rng.normal(size=_ROWS)  # fourteen standard errors in three blocks
    assert p_value(Whitened(X[None], y, (slice(0, 1),)), 0, mismatch.block, pooled=True) < 1e-8


def test_a_law_that_is_strong_in_one_block_is_proved_by_the_others_and_an_event_there_is_not():
    mismatch, rng = _laid_out(1), np.random.default_rng(3)
    heavy = np.where(mismatch.block == 4, 8.0, 1.0)  # one cut has nearly all of the power
    X, noise = heavy * rng.normal(size=_ROWS), rng.normal(size=_ROWS)
    law, event = X + noise, X * (mismatch.block == 4) + noise
    p_law, p_event = (
        p_value(Whitened(X[None], y, (slice(0, 1),)), 0, mismatch.block, pooled=True, least=4.0) for y in (law, event)
    )
    assert p_law < 1e-8
    assert p_event > 0.05


def test_an_amplitude_that_a_form_does_without_asks_no_question():
    rng = np.random.default_rng(0)
    X, y, block = rng.normal(size=(2, 400)), rng.normal(size=400), np.arange(400) // 10
    y += 0.15 * X[0]
    plain = p_value(Whitened(X, y, (slice(0, 2),)), 0, block)
    assert p_value(Whitened(np.vstack([X, np.zeros((2, 400))]), y, (slice(0, 4),)), 0, block) == pytest.approx(plain)
    assert p_value(Whitened(np.vstack([X, np.zeros((1, 400))]), y, (slice(0, 2), slice(2, 3))), 1, block) == 1.0


def test_the_false_discovery_rate_counts_questions_that_were_not_kept():
    p = np.array([0.001, 0.004, 0.03])
    padded = stats.false_discovery_control(np.r_[p, np.ones(17)])
    np.testing.assert_allclose(q_values(list(p), questions=20), padded[:3])


def test_a_corner_of_a_surface_that_one_faint_row_reaches_takes_no_height():
    knots = (0.0, 1.0, 2.0)
    term = Term(Surface(("v_x",), (knots,), (False,)))
    u = np.r_[np.linspace(0, 1, 500), 1.0005]
    X = np.array([np.interp(u, knots, row) for row in np.eye(3)])
    y = np.r_[np.ones(500), 11.0]  # the last row alone would ask for 20 000 A at the third knot
    free, _ = solve(X, y)
    drawn, _ = solve(X, y, held_back(X, 0, [term], [X]))
    assert abs(free[2]) > 1e4
    assert abs(drawn[2]) < 1.0
    np.testing.assert_allclose(drawn[:2], 1.0, atol=0.1)  # an outlier of 10 A leans on its neighbours


def test_a_formula_without_a_reason_ends_where_its_data_end():
    known = {"v_x": (np.array([-5.0, 0.5, 1.0, 50.0]), "mm/s")}
    cubic = Formula((("v_x", "u³"),), "(mm/s)^3", ((0.0, 1.0),))
    np.testing.assert_allclose(cubic.values(known), [0.0, 0.125, 1.0, 1.0])


def test_a_term_acts_on_a_new_part_at_most_three_times_as_strongly_as_where_it_was_found():
    class Ramp:
        held_back = 0.0

        def regressors(self, state, **shape):
            return np.linspace(-100.0, 100.0, 9)[:, None]

    state = SimpleNamespace(time=np.arange(9.0))
    recording = Recording(PartInfo(part="new", machine="m"), {"time": state.time})
    model = AxisModel("x", 0.1, (Term(Ramp(), name="ramp"),), (np.array([1.0]),), largest=(10.0,))  # type: ignore[arg-type]
    effect = model.effect(np.zeros(9), recording, state)  # type: ignore[arg-type]
    assert effect.min() == pytest.approx(-30.0)
    assert effect.max() == pytest.approx(30.0)
    np.testing.assert_allclose(effect[4], 0.0, atol=1e-12)


def test_a_corner_that_hardly_any_row_reaches_has_an_interval_that_can_be_read():
    library, noise = planted(lambda s: np.abs(s.v))
    top = max(float(s.v.max()) for s in library.mismatch.states)
    surface = Term(Surface(("v_x",), ((-15.0, 0.0, top - 1e-9, top + 100.0),), (False,)))
    (found,) = estimate(library.mismatch, noise, [surface], np.random.default_rng(0)).parameters
    low, high = found["g_3"].ci95
    assert low <= found["g_3"].value <= high
    assert high - low < 100 * NOISE
    low, high = found["g_0"].ci95
    assert 0 < high - low < NOISE


@pytest.mark.parametrize(
    ("sizes", "rejected"),
    [((1, 1, 1, 1, 1, 1), False), ((0.7, 1.3, 0.8, 1.1, 0.9, 1.2), False), ((-0.2, 0.4, 0.7, 1.5, 2.4, 3.0), True)],
)
def test_a_law_beside_another_has_the_same_size_in_every_part_or_mends_its_form(sizes, rejected):
    library, noise = planted(lambda s: 2 * s.v + 0.1 * sizes[int(s.part[1:])] * s.a, count=6)
    steady, other = Term(VISCOUS), Term(Formula((("a_x", "u"),), "(mm/s²)"), name="inertia")
    _, reason = useless(library, noise, [steady, other])
    assert (reason is not None and "in every part" in reason) == rejected
    _, reason = useless(library, noise, [other])
    assert reason is None or "in every part" not in reason


def test_terms_of_the_equation_that_some_parts_cannot_tell_apart_do_not_run_away_on_another_part():
    mismatch, rng = _laid_out(3), np.random.default_rng(2)
    u, other = rng.normal(size=(2, _ROWS))
    alike = np.where(mismatch.part < 2, 1e-3 * other, other)  # beside u, only part p2 shows the second one
    laid_out = replace(
        mismatch, base=np.array([u, u + alike]), base_names=("u", "w"), target=u + rng.normal(0, 0.3, _ROWS)
    )
    proof = held_out(laid_out, even(laid_out), [], [], laid_out.target)
    assert proof.rmse_before == pytest.approx(0.3, rel=0.5)


@pytest.mark.parametrize(("bursts", "stays"), [(1, False), (4, True)])
def test_what_acts_too_seldom_to_tell_in_all_has_to_be_shown_by_a_paired_test(bursts, stays, monkeypatch):
    """A drag beyond 30 mm/s, which two of three parts reach for half a second each time."""
    monkeypatch.setattr("pido.diagnosis.diagnose._LESS_ERROR", 0.5)  # of all error: none takes away as much

    def fast(k, recording):
        v = recording["v_x"].copy()
        for at in range(bursts if k < 2 else 0):
            v[500 + 600 * at : 600 + 600 * at] += 40.0 * np.hanning(100)
        moved = {"v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": np.gradient(v, STEP)}
        return Recording(recording.part, {**recording.columns, **moved})

    law = Term(VISCOUS, gates=(Gate("v_x", low=30.0),))
    library, noise = planted(lambda s: law.columns([s])[0], strength=0.5, change=fast)
    mismatch = library.mismatch
    answer = Answer("x", [law], [1e-9], [1e-8], [500.0], [[]])
    kept, _, _ = proved(mismatch, (noise, noise), [law], answer, mismatch.target, np.random.default_rng(5))
    assert kept == ([law] if stays else [])
    assert ["paired test" in r.reason for r in answer.rejected] == ([] if stays else [True])


def test_a_wave_of_friction_far_from_the_machines_zero_has_heights_that_are_known():
    """Counted from there, its phase would be as little known as its length times the number of waves in between."""
    law = BY_ID["position_dependent_friction"]

    def effect(state):
        return np.sign(state.v) * np.sin(2 * np.pi * (state.pos - 800.0) / 12.0)

    def far(k, recording):
        return replace(recording, columns={**recording.columns, "pos_x": recording["pos_x"] + 800.0})

    library, noise = planted(effect, strength=1.0, change=far)
    start = min(law.starts(library.mismatch.states), key=lambda s: (s["form"] != 0, abs(s["L"] - 12.0)))
    start = law.from_the_middle(start, library.mismatch.states)
    (term,) = settle_shapes(library.mismatch, noise, [Term(law, tuple(start.items()))])
    assert fit(library.mismatch, noise, [term.with_shape(p_0=0.0)]).rss == pytest.approx(
        fit(library.mismatch, noise, [term]).rss
    )
    (found,) = estimate(library.mismatch, noise, [term], np.random.default_rng(5)).parameters
    height = np.hypot(found["G_1"].value, found["G_2"].value)
    assert found["L"].value == pytest.approx(12.0, rel=0.02)
    assert all(np.ptp(found[g].ci95) < 0.3 * height for g in ("G_0", "G_1", "G_2"))


def test_a_transient_is_not_settled_at_a_frequency_that_its_damping_hides():
    law = Transient("v_x", "mm/s", "both", level=True, rings=True)
    assert {p.name: p.high for p in law.shape} == {"c": None, "f": None, "zeta": 1.0}
