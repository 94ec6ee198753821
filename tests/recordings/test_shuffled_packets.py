"""Packets of a known path, shuffled here: the right order is the truth."""

import numpy as np
import pytest

from pido.recordings import read_recording
from pido.recordings.packets import Track, in_order

STEP = 0.1


def _path(n, seed):
    """A random smooth walk in x and y, a spindle counter; positions rounded to three digits as in the files."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * STEP
    tracks = []
    for _ in range(2):
        w, phase = rng.uniform(0.05, 0.6, 4), rng.uniform(0, 6, 4)
        p = 150 + sum(8 / k * np.sin(w[k - 1] * t + phase[k - 1]) for k in range(1, 5))
        tracks.append((p, np.gradient(p, STEP)))
    tracks.append(((53.3 * t + 2000) % 4294.967296 - 2147.483648, np.full(n, 53.3)))
    return tracks


def _three_digits(p):
    scale = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(p), 1e-3))) - 2)
    return np.round(p / scale) * scale


def _shuffled(n, seed):
    tracks = _path(n, seed)
    packets = np.random.default_rng(seed + 100).permutation(n // 10)
    file = (packets[:, None] * 10 + np.arange(10)).ravel()
    period = (None, None, 4294.967296)
    made = [Track(_three_digits(p)[file], v[file], c) for (p, v), c in zip(tracks, period, strict=True)]
    return file, made, np.column_stack([t.position for t in made] + [np.arange(n)])


@pytest.mark.parametrize("seed", range(5))
def test_what_is_linked_is_in_the_true_order_and_what_is_not_is_marked(seed):
    file, tracks, rows = _shuffled(600, seed)
    order, border, notes = in_order(tracks, rows, STEP)
    assert sorted(order) == list(range(600))
    true = file[order]
    wrong = (np.diff(true) != 1) & ~border[1:]
    assert wrong.sum() <= 1
    assert border.sum() <= 6
    assert any("put in order" in note for note in notes)


def test_a_file_in_order_is_left_as_it_is():
    tracks = [Track(_three_digits(p), v, None) for p, v in _path(300, 7)[:2]]
    order, border, notes = in_order(tracks, np.arange(300.0)[:, None], STEP)
    assert order.tolist() == list(range(300))
    assert not border.any()
    assert notes == ()


def test_rows_repeated_while_moving_are_taken_once():
    tracks = [Track(_three_digits(p), v, None) for p, v in _path(300, 7)[:2]]
    at = np.r_[0:100, 99, 100:300]
    tracks = [Track(t.position[at], t.velocity[at], None) for t in tracks]
    order, _, notes = in_order(tracks, at.astype(float)[:, None], STEP)
    assert len(order) == 300
    assert "1 rows came twice" in notes[0]


@pytest.mark.real
@pytest.mark.parametrize(("number", "left"), [("01", 0), ("11", 20), ("13", 20), ("14", 30)])
def test_the_real_files_come_out_nearly_continuous_and_say_what_is_not(real_data, number, left):
    recording = read_recording(real_data / "umich_smart_mill" / f"experiment_{number}.csv")
    step = np.diff(recording.time)
    assert (step > 0.15).sum() <= left
    inside = step < 0.15
    for axis, rounding in (("x", 1.0), ("y", 1.0), ("z", 1.0)):
        way = np.abs(np.diff(recording[f"pos_{axis}"]))
        speed = np.maximum(np.abs(recording[f"v_{axis}"][1:]), np.abs(recording[f"v_{axis}"][:-1]))
        assert (way <= 0.25 * speed + 1.01 * rounding)[inside].all()
    if left:
        assert any("undecided" in note for note in recording.notes)
