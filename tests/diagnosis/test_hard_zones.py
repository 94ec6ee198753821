"""Places of the workpiece that cut harder: what form they have, where they are, and when there is none."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.mechanisms.hard_zone import best_layer
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.search import first_look, search
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import fit

NOISE, STEP = 0.05, 0.02
FORMS = {"disc": 0, "box": 1, "layer": 2, "ball": 3}


def path(rng, legs):
    """(n,) of x, y and z, mm, and which leg: along x, y, x, y, ..., each fifth along z."""
    ends, here, place = {"x": 34.0, "y": 24.0, "z": 12.0}, {"x": 0.0, "y": 0.0, "z": -6.0}, []
    for k in range(legs):
        axis = "z" if k % 5 == 4 else "xy"[k % 2]
        to = rng.uniform(-12.0, 0.0) if axis == "z" else rng.uniform(-ends[axis], ends[axis])
        count = max(3, int(abs(to - here[axis]) / (rng.choice([9.0, 20.0]) * STEP)))
        for v in np.linspace(here[axis], to, count + 1)[1:]:
            place.append([v if a == axis else here[a] for a in "xyz"] + [k])
        here[axis] = to
    return np.array(place).T


def recordings(count=4, legs=40, top=True):
    """A block of 80 by 60 mm and 12 deep is milled at random places and depths, with a force against the motion; every
    part is clamped elsewhere."""
    for k in range(count):
        rng = np.random.default_rng(k)
        *place, leg = path(rng, legs)
        n, v = len(leg), [np.gradient(p, STEP) for p in place]
        load = (rng.uniform(50, 300, legs) * (rng.random(legs) < 0.8) * (np.arange(legs) % 5 < 4))[leg.astype(int)]
        clamped = (300 + 70 * rng.random(), 200 + 50 * rng.random(), 150 + 40 * rng.random())
        columns = {"time": np.arange(n) * STEP, "mrr_sim": load / 10}
        for a, p, s, c in zip("xyz", place, v, clamped, strict=True):
            columns |= {f"v_{a}": s, f"pos_{a}": p + c, f"f_{a}_sim": -load * np.sign(s)}
        columns["curr_x_sim"] = 0.3 * np.sign(v[0]) + 0.004 * columns["f_x_sim"]
        piece = {"center_xy_mm": clamped[:2], "size_xy_mm": [80, 60]} | ({"top_z_mm": clamped[2]} if top else {})
        about = {"part": f"p{k}", "machine": "m", "order": k + 1, "start_time_s": 200.0 * k, "workpiece": piece}
        yield Recording(PartInfo.model_validate(about), columns)


def answer_of(effect, **how):
    """effect : state -> (n,), A, beside white noise. Terms and their amplitudes."""
    rng = np.random.default_rng(1)
    states = axis_states(list(recordings(**how)), "x")
    mismatch = lay_out(states, [effect(s) + rng.normal(0, NOISE, len(s.time)) for s in states])
    answer = search(first_look(mismatch, rng), 1, False, rng)
    assert answer.noise is not None
    return answer.terms, fit(mismatch, answer.noise, answer.terms).amplitudes


def skin(s):
    return s.wz > -3.0


def inclined(s):
    return np.abs((s.wx * np.cos(1.0) + s.wy * np.sin(1.0)) * np.sin(0.6) + s.wz * np.cos(0.6) + 2.0) < 4.0


def seam(s):
    return np.abs(s.wx * np.cos(0.7) + s.wy * np.sin(0.7) - 5.0) < 5.0


def inclusion(s):
    return np.sqrt((s.wx - 4.0) ** 2 + (s.wy + 3.0) ** 2 + (s.wz + 6.0) ** 2) < 9.0


def pocket(s):
    return (np.abs(s.wx - 10.0) < 14.0) & (np.abs(s.wy) < 8.0)


ZONES = {
    "skin": (skin, "layer", {"tilt": (0.0, 3.0)}),
    "inclined": (inclined, "layer", {"tilt": (np.degrees(0.6), 4.0), "d": (-2.0, 1.0), "r": (4.0, 0.6)}),
    "seam": (seam, "layer", {"tilt": (90.0, 3.0), "d": (5.0, 1.0), "r": (5.0, 0.6)}),
    "inclusion": (inclusion, "ball", {"x_c": (4.0, 1.5), "y_c": (-3.0, 1.5), "z_c": (-6.0, 2.0), "r": (9.0, 1.0)}),
    "pocket": (pocket, "box", {"x_c": (10.0, 1.0), "y_c": (0.0, 1.0), "r": (14.0, 1.0)}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("zone", ZONES)
def test_a_hard_place_is_found_in_its_own_form(zone):
    inside, form, numbers = ZONES[zone]
    (term,), ((H,),) = answer_of(lambda s: 0.0015 * s.force * inside(s))
    shape = dict(term.shape)
    assert term.mechanism.id == "material_hard_zone"
    assert shape["form"] == FORMS[form]
    if shape["tilt"] > 90.0:  # the same normal, the other way round
        shape["tilt"], shape["azimuth"], shape["d"] = 180.0 - shape["tilt"], shape["azimuth"] + 180.0, -shape["d"]
    for name, (value, within) in numbers.items():
        here = abs(shape[name]) if name in ("tilt", "d") and form == "layer" else shape[name]
        assert here == pytest.approx(abs(value) if name == "d" else value, abs=within), (name, shape)
    assert float(H) == pytest.approx(0.0015, rel=0.08)


@pytest.mark.thorough
def test_a_force_that_is_larger_everywhere_is_no_hard_place():
    (term,), ((k,),) = answer_of(lambda s: 0.0015 * s.force)
    assert term.mechanism.id == "cutting_force"
    assert k == pytest.approx(0.0015, rel=0.05)


@pytest.mark.thorough
def test_without_the_top_of_the_workpiece_a_seam_is_upright():
    (term,), _ = answer_of(lambda s: 0.0015 * s.force * seam(s), top=False)
    shape = dict(term.shape)
    assert (term.mechanism.id, shape["form"]) == ("material_hard_zone", FORMS["layer"])
    assert np.sin(np.radians(shape["tilt"])) == pytest.approx(1.0, abs=0.01)


def test_nothing_differs_where_nothing_is_cut_or_all_is_alike():
    place, rng = np.random.default_rng(0).uniform(-10, 10, (3, 500)), np.random.default_rng(1)
    assert best_layer(place, np.zeros(500), rng.normal(size=500)) is None
    assert best_layer(place[:, :10], np.ones(10), np.ones(10)) is None
    force = rng.normal(size=500)
    assert best_layer(np.zeros((3, 500)), force, force) is None
