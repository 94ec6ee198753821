"""Noise models against series whose law is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.diagnosis.whiten import Noise, autocorrelation_time, averaged, estimate_noise, fit_ar, robust_sd


def _ar(phi, n, rng, sd=1.0):
    return lfilter([1.0], np.r_[1.0, -np.asarray(phi)], rng.normal(scale=sd, size=n))


def _starts(n):
    starts = np.zeros(n, bool)
    starts[0] = True
    return starts


@pytest.mark.parametrize("phi", [[0.5], [0.9], [0.6, 0.3], [1.2, -0.5]])
def test_the_coefficients_of_an_autoregressive_series_are_found(phi):
    x = _ar(phi, 60_000, np.random.default_rng(1))
    found, innovation = fit_ar(x, _starts(len(x)), 12)
    padded = np.r_[phi, np.zeros(max(0, len(found) - len(phi)))]
    np.testing.assert_allclose(found, padded[: len(found)], atol=0.03)
    assert innovation == pytest.approx(1.0, abs=0.03)


def test_independent_rows_need_no_filter():
    x = np.random.default_rng(2).normal(size=20_000)
    assert len(fit_ar(x, _starts(len(x)), 12)[0]) == 0


def test_whitened_noise_is_independent_and_of_unit_variance():
    rng = np.random.default_rng(3)
    state = (np.arange(40_000) // 500) % 2
    level = np.where(state == 0, 0.1, 0.3)
    x = level * _ar([0.8], 40_000, rng, sd=0.6)
    noise = estimate_noise(x, _starts(len(x)), state)
    white = noise.whiten(x[None])[0][noise.valid]
    assert np.std(white) == pytest.approx(1.0, abs=0.05)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.03
    assert np.std(white[state[noise.valid] == 0]) == pytest.approx(np.std(white[state[noise.valid] == 1]), rel=0.1)


def test_rows_after_an_interruption_wait_until_their_past_is_complete():
    n = 20_000
    x = np.r_[_ar([0.7], n // 2, np.random.default_rng(4)), _ar([0.7], n // 2, np.random.default_rng(5))]
    starts = _starts(n)
    starts[n // 2] = True
    noise = estimate_noise(x, starts, np.zeros(n, int))
    order = len(noise.ar)
    assert order >= 1
    waiting = np.flatnonzero(~noise.valid)
    assert waiting.tolist() == [*range(order), *range(n // 2, n // 2 + order)]


def test_memory_is_the_variance_of_a_mean_over_that_of_a_sample():
    phi = 0.9
    assert autocorrelation_time(np.array([phi])) == pytest.approx((1 + phi) / (1 - phi), rel=1e-6)
    assert autocorrelation_time(np.zeros(0)) == 1.0


def test_a_wave_that_is_not_yet_explained_does_not_pass_for_memory_of_the_noise():
    rng = np.random.default_rng(5)
    n = 40_000
    x = _ar([0.5], n, rng) + 1.5 * np.sin(2 * np.pi * np.arange(n) / 900)
    plain = estimate_noise(x, _starts(n), np.zeros(n, int))
    first = estimate_noise(x, _starts(n), np.zeros(n, int), smooth_spectrum=True)
    assert first.memory == pytest.approx(3.0, abs=0.7)
    assert plain.memory > 2 * first.memory


def test_spikes_do_not_move_the_level_of_the_noise_much():
    x = np.random.default_rng(6).normal(size=10_000)
    x[::100] += 50.0
    assert robust_sd(x) == pytest.approx(1.0, rel=0.15)


def test_the_matrix_of_a_noise_is_what_it_does_to_rows():
    rng = np.random.default_rng(6)
    x, part = rng.normal(size=(4, 600)), np.repeat([0, 1], 300)
    noise = Noise(np.array([0.5, 0.2, -0.1]), rng.uniform(0.5, 2.0, 600), 0.7, rng.random(600) > 0.1)
    slow = averaged(noise, rng.normal(size=600), part, rng.random(600) > 0.2)
    assert slow is not None
    for each in (noise, slow):
        np.testing.assert_allclose(x @ each.matrix().T.toarray(), each.whiten(x), atol=1e-12)
