"""Textbook effects that act in a box of (v_x, v_y, AR) only, in the current of a small machine of this test's own.

The axes hold their feeds for seconds, as in milling, and the noise remembers: a box is met at few times, for long.
"""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.confirm import even, less_error_there
from pido.diagnosis.forms import fewest
from pido.diagnosis.gates import PATH_SPEED, Gate, inside
from pido.diagnosis.identify import candidates
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.misfit import useless
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.regions import best_region
from pido.diagnosis.search import first_look, search
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.whiten import Noise
from pido.physics.drive import Loop, answered_late

pytestmark = pytest.mark.thorough

NOISE = 0.05
FEEDS = (-25.0, -12.0, -6.0, 0.0, 0.0, 6.0, 12.0, 25.0)


def feeds(rng, n, rate):
    """Levels held for a second or three, with ramps of a fifth of a second between them; a stop is a stop."""
    v = np.concatenate([np.full(int(rng.uniform(1, 3) * rate), rng.choice(FEEDS)) for _ in range(n)])[:n]
    width = int(0.2 * rate) | 1
    v = np.convolve(v, np.ones(width) / width, "same")
    return np.where(np.abs(v) < 1e-9, 0.0, v)


def remembering(rng, n, phi):
    e = rng.normal(0, NOISE * np.sqrt(1 - phi**2), n)
    for i in range(1, n):
        e[i] += phi * e[i - 1]
    return e


def recordings(seed, rate, seconds=60.0, count=4, z=False):
    """x and y mill at feeds of their own; the simulation of x has friction and the process force. With z, which stands,
    the removed area is known: none in the air, and for a second per part that of a hole."""
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        n = int(seconds * rate)
        t = np.arange(n) / rate
        cuts = np.repeat(rng.random(n) < 0.6, int(4 * rate))[:n]
        depth = np.repeat(rng.uniform(0.2, 1.0, n), int(2 * rate))[:n] * cuts
        columns = {"time": t}
        for axis in "xy":
            v = feeds(rng, n, rate)
            columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) / rate, f"a_{axis}": np.gradient(v, t)}
            columns[f"f_{axis}_sim"] = -300.0 * depth * np.sign(v)
        v_x, v_y = columns["v_x"], columns["v_y"]
        columns["mrr_sim"] = 40.0 * depth * np.hypot(v_x, v_y)
        if z:
            columns |= {"v_z": np.zeros(n), "a_z": np.zeros(n)}
            columns["mrr_sim"] *= np.where(t > seconds - 1.0, 20.0, 1.0)
        columns["curr_x_sim"] = 0.4 * np.sign(v_x) + 0.002 * columns["f_x_sim"]
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=100.0 * k), columns)


def answer_of(effect, seed, rate, phi, **more):
    """effect : state -> (n,), A. What the search says of it, and the mismatch."""
    rng = np.random.default_rng(seed)
    states = axis_states(list(recordings(seed, rate, **more)), "x")
    targets = [effect(s) + remembering(rng, len(s.time), phi) for s in states]
    mismatch = lay_out(states, targets)
    return search(first_look(mismatch, rng), 1, False, rng), mismatch


def other(state):
    return state.others["y"].v


def late(effect):
    """As a current shows it that follows its command over four samples."""
    k = np.exp(-np.arange(12) / 4)
    return np.convolve(effect, k / k.sum())[: len(effect)]


def overlap(term, box, law, mismatch):
    """Rows in which an effect is said to be and is, of those in which it is either."""
    truly = np.concatenate([box(s) & (law(s) != 0) for s in mismatch.states])
    said = np.concatenate([(inside(s, term.gates) > 0) & (law(s) != 0) for s in mismatch.states])
    return np.sum(truly & said) / np.sum(truly | said)


EFFECTS = {
    "viscous_friction": (lambda s: 0.006 * s.v, lambda s: other(s) > 4.0),
    "coulomb_friction": (lambda s: 0.08 * np.sign(s.v), lambda s: (other(s) > 4.0) & (s.v < 9.0)),
    "axis_coupling": (lambda s: -0.006 * other(s), lambda s: (s.v > 4.0) & (other(s) < -4.0)),
    "cutting_force": (lambda s: 0.0005 * s.force, lambda s: (s.v < -4.0) & (other(s) < 4.0)),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_in_a_box_is_named_and_placed_there(name):
    law, box = EFFECTS[name]
    answer, mismatch = answer_of(lambda s: law(s) * box(s), 1, 25.0, 0.5)
    (term,) = answer.terms
    assert term.mechanism.id == name
    assert overlap(term, box, law, mismatch) > 0.8


def test_a_box_with_limits_on_both_sides_is_found_with_all_of_them():
    def box(s):
        return (np.abs(s.v) < 18.0) & (s.ar > 16.0) & (s.ar < 26.0)

    answer, mismatch = answer_of(lambda s: 0.015 * s.v * box(s), 4, 25.0, 0.5, z=True)
    (term,) = answer.terms
    assert term.mechanism.id == "viscous_friction"
    assert overlap(term, box, lambda s: s.v, mismatch) > 0.8
    assert {(g.variable, bool(np.isfinite(g.low))) for g in term.gates} == {
        ("v_x", True), ("v_x", False), ("AR", True), ("AR", False)
    }  # fmt: skip


WAYS = {
    "both ways": (lambda s: 0.08 * np.sign(s.v), lambda s: np.abs(other(s)) > 8.0, {"|v_y|"}),
    "own, of a place": (lambda s: 0.12 * np.sin(2 * np.pi * s.pos / 7.0), lambda s: np.abs(s.v) > 9.0, {"|v_x|"}),
    "own, of the cut": (lambda s: 0.0005 * s.force, lambda s: np.abs(s.v) > 9.0, {"|v_x|"}),
    "ring": (lambda s: 0.006 * s.v, lambda s: np.hypot(s.v, other(s)) > 15.0, {"path speed"}),
}  # fmt: skip


@pytest.mark.parametrize("name", WAYS)
def test_a_law_confined_by_speed_without_a_sign_is_one_law_with_that_limit(name):
    law, box, variables = WAYS[name]
    answer, mismatch = answer_of(lambda s: law(s) * box(s), 6, 25.0, 0.5)
    (term,) = answer.terms
    assert overlap(term, box, law, mismatch) > 0.9
    assert {g.variable for g in term.gates} == variables


def test_what_a_law_of_the_simulation_lacks_in_a_box_is_no_wrong_coefficient():
    answer, _ = answer_of(lambda s: -0.12 * np.sign(s.v) * (other(s) > 8.0), 6, 25.0, 0.5)
    (term,) = answer.terms
    assert term.name == "unknown"
    assert term.mechanism.reads == {"v_x"}
    assert {g.variable for g in term.gates} == {"v_y"}


def test_what_differs_by_direction_below_a_speed_of_the_path_is_one_asymmetry_there():
    answer, _ = answer_of(lambda s: 0.08 * (s.v > 0) * (np.hypot(s.v, other(s)) < 15.0), 6, 25.0, 0.5)
    (term,) = answer.terms
    assert term.mechanism.id == "friction_asymmetry"
    assert {g.variable for g in term.gates} == {"path speed"}


def test_a_law_that_acts_in_two_boxes_is_found_in_both():
    def there(s):
        return (other(s) > 9.0) | ((other(s) < -4.0) & (other(s) > -9.0))

    answer, mismatch = answer_of(lambda s: 0.12 * np.sign(s.v) * there(s), 6, 25.0, 0.5, seconds=120.0)
    assert [t.mechanism.id for t in answer.terms] == ["coulomb_friction"] * 2
    truly = np.concatenate([there(s) for s in mismatch.states])
    said = np.concatenate([sum(inside(s, t.gates) > 0 for t in answer.terms) for s in mismatch.states])
    assert np.mean(truly == said) > 0.9


RARE = {
    "cutting_force": (lambda s: 0.0006 * s.force, lambda s: (s.v < -8.0) & (other(s) > 8.0)),
    "viscous_friction": (lambda s: 0.0056 * s.v, lambda s: (s.v > 8.0) & (other(s) > 8.0)),
}


@pytest.mark.parametrize(
    ("name", "seed", "phi"),
    [("cutting_force", 2, 0.9), ("cutting_force", 3, 0.95), ("viscous_friction", 1, 0.9)],
)
def test_a_box_that_is_met_in_a_thirtieth_of_the_time_is_found_in_noise_that_remembers(name, seed, phi):
    law, box = RARE[name]
    answer, mismatch = answer_of(lambda s: late(law(s) * box(s)), seed, 50.0, phi)
    (term,) = answer.terms
    assert term.mechanism.id == name
    assert overlap(term, box, law, mismatch) > 0.6


@pytest.mark.parametrize(("size", "holds"), [(1.0, True), (0.0, False)])
def test_what_few_blocks_show_in_sizes_of_their_own_holds_on_unseen_parts(size, holds):
    law, box = EFFECTS["cutting_force"][0], RARE["cutting_force"][1]
    rng = np.random.default_rng(3)
    states = axis_states(list(recordings(3, 50.0)), "x")
    louder = [size * 0.48 * law(s) * box(s) * (1 + 3 * (s.time > 40)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in louder])
    force = next(m for m in CATALOGUE if m.id == "cutting_force")
    library = Library(mismatch, [Term(force)])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    library.whiten(noise)
    _, reason = useless(library, noise, [Term(force, gates=(Gate("v_x", high=-8.0), Gate("v_y", low=8.0)))])
    assert (reason is None) == holds


@pytest.mark.parametrize(("size", "much"), [(10.0, True), (0.0, False)])
def test_what_acts_in_few_rows_is_judged_by_the_error_in_these(size, much):
    law, box = RARE["viscous_friction"]
    rng = np.random.default_rng(3)
    states = axis_states(list(recordings(3, 50.0)), "x")
    mismatch = lay_out(states, [size * law(s) * box(s) + rng.normal(0, 0.5, len(s.time)) for s in states])
    viscous = next(m for m in CATALOGUE if m.id == "viscous_friction")
    term = Term(viscous, gates=(Gate("v_x", low=8.0), Gate("v_y", low=8.0)))
    acts = np.concatenate([box(s) for s in states]) & mismatch.usable
    assert (less_error_there(mismatch, even(mismatch), [term], [], acts) < 0.9) == much


def with_rapids(seed, rate, count=4):
    """The same machine, whose x axis now and then goes at twenty times its feeds for a second."""
    for recording in recordings(seed, rate, count=count):
        rapid = recording.time % 9.0 < 1.0
        v = np.where(rapid, 500.0 * np.where(recording.time % 18.0 < 9.0, 1, -1), recording["v_x"])
        v = np.convolve(v, np.ones(5) / 5, "same")
        yield recording.with_columns(v_x=v, pos_x=np.cumsum(v) / rate, a_x=np.gradient(v, recording.time))


def test_friction_that_ends_with_speed_is_found_beside_rapids():
    """What a whitened rapid leaves in the rows after it is no part of the slow motion that follows."""
    rng = np.random.default_rng(4)
    states = axis_states(list(with_rapids(4, 50.0)), "x")
    effects = [0.02 * s.v * (np.abs(s.v) < 16) for s in states]
    mismatch = lay_out(states, [e + remembering(rng, len(e), 0.9) for e in effects])
    (term,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert term.mechanism.id == "viscous_friction"
    assert {g.variable for g in term.gates} == {"v_x"}


def test_what_grows_with_the_speed_of_another_axis_is_one_law_of_it_and_not_two_boxes():
    rng = np.random.default_rng(5)
    states = axis_states(list(recordings(5, 50.0)), "x")
    growing = [0.25 * s.held * s.moving * (1 - np.exp(-np.abs(other(s)) / 10.0)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in growing])
    coulomb, heat = (next(m for m in CATALOGUE if m.id == i) for i in ("coulomb_friction", "thermal_drift"))
    drift = (("tau", 4000.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0))
    library = Library(mismatch, [Term(coulomb), Term(heat, drift)])
    library.whiten(even(mismatch))
    boxes = [Term(coulomb, gates=(Gate("v_y", high=-5.0),)), Term(heat, drift, gates=(Gate("v_y", low=5.0),))]
    (one,) = fewest(library, even(mismatch), boxes)
    assert one.name == "unknown"
    assert one.mechanism.reads == {"v_x", "v_y"}


def test_a_box_is_no_narrower_than_the_least_step_between_levels():
    """Where a sign turns smoothly, a sliver of speeds around standstill would mend it."""
    states = axis_states(list(recordings(5, 50.0)), "x")
    rng = np.random.default_rng(5)
    effects = [0.5 * s.v * (np.abs(s.v) < 0.2) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, 0.01, len(e)) for e in effects])
    library = Library(mismatch, [Term(next(m for m in CATALOGUE if m.id == "viscous_friction"))])
    noise = Noise(np.zeros(0), np.full(mismatch.n, 0.01), 1.0, mismatch.usable)
    library.whiten(noise)
    found = best_region(library, basis(library, noise, []))
    gates = found.term.gates if found else ()
    ends = [v for g in gates if g.variable == "v_x" for v in (g.low, g.high) if np.isfinite(v)]
    assert len(ends) < 2 or np.ptp(ends) > 0.01 * np.ptp(np.concatenate([s.v for s in states]))


def at_any_feed(seed, rate):
    """The same machine, whose x axis is at another speed every half a second."""
    for k, recording in enumerate(recordings(seed, rate)):
        n = len(recording)
        v = np.repeat(np.random.default_rng([seed, k, 1]).uniform(-15, 15, n), rate // 2)[:n]
        v = np.convolve(v, np.ones(5) / 5, "same")
        yield recording.with_columns(v_x=v, pos_x=np.cumsum(v) / rate, a_x=np.gradient(v, recording.time))


def test_friction_that_falls_with_speed_in_a_box_is_no_constant_between_two_limits():
    """A law that is largest at the lower limit of its box keeps that limit, and needs no upper one."""
    rng = np.random.default_rng(2)
    states = axis_states(list(at_any_feed(2, 50)), "x")
    falling = [0.3 * np.exp(-((np.abs(s.v) / 5) ** 1.2)) * (s.v > 2.8) * (other(s) > -4.0) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in falling])
    library = Library(mismatch, first_look(mismatch, rng).offered)
    library.whiten(even(mismatch))
    found = best_region(library, basis(library, even(mismatch), []))
    assert found is not None
    assert found.term.mechanism.id == "stribeck_friction"
    assert {g.variable for g in found.term.gates if np.isfinite(g.high)} == set()


@pytest.mark.parametrize("seed", range(4))
def test_the_limits_of_what_ramps_show_are_found_behind_a_loop_and_in_averaged_rows(seed):
    """An acceleration passes the limits within a few rows: what of these lies inside, and that the drive answers late
    to what was inside, decides where the limits are."""
    rng = np.random.default_rng(seed)
    states = axis_states(list(recordings(seed, 500)), "x")
    box = (Gate(PATH_SPEED, low=4.0), Gate(PATH_SPEED, high=9.0))
    acts = [2e-3 * s.others["y"].a * inside(s, box) for s in states]
    late = [answered_late(e[None], s.time, 0.02)[0] for e, s in zip(acts, states, strict=True)]
    mismatch = lay_out(states, [e + rng.normal(0, 0.15, len(e)) for e in late], stride=10)
    offered, _ = candidates(CATALOGUE, mismatch, {})
    library = Library(mismatch, [t for t in offered if t.mechanism.id == "axis_coupling"], loop=Loop(0.02))
    noise = Noise(np.zeros(0), np.full(mismatch.n, 0.15 / np.sqrt(10)), 1.0, mismatch.usable)
    library.whiten(noise)
    found = best_region(library, basis(library, noise, []))
    assert found is not None
    limits: dict[str, list[object]] = {g.variable: [] for g in found.term.gates}
    for gate in found.term.gates:
        limits[gate.variable].append(gate.low if np.isfinite(gate.low) else gate.high)
    assert limits == {PATH_SPEED: [pytest.approx(4.0, abs=0.5), pytest.approx(9.0, abs=0.5)]}
    assert found.amplitudes[0] == pytest.approx(2e-3, rel=0.1)


def test_a_factor_on_the_current_in_a_box_is_no_saturation():
    """It bends nowhere, and is there where the axis is slow."""
    answer, _ = answer_of(lambda s: 0.2 * s.sim * (np.hypot(s.v, other(s)) < 9.0), 1, 25.0, 0.5)
    (term,) = answer.terms
    assert (term.name, term.mechanism.equation, bool(term.gates)) == ("unknown", "dI = k * I_x", True)


@pytest.mark.parametrize(("share", "told"), [(1.0, None), (0.1, "no gain on parts that were not fitted")])
def test_a_law_that_a_few_of_many_visits_to_its_box_show_is_none(share, told):
    """However strong it is in those."""
    rng = np.random.default_rng(5)
    box = Gate("v_y", low=4.0)
    states = axis_states(list(recordings(5, 25.0)), "x")
    targets = []
    for state in states:
        visit = np.cumsum(np.diff(inside(state, (box,)) > 0, prepend=False))
        shown = rng.random(visit.max() + 1) < share
        targets.append(0.05 / share * np.sign(state.v) * shown[visit] + remembering(rng, len(state.time), 0.0))
    mismatch = lay_out(states, targets)
    term = Term(next(m for m in CATALOGUE if m.id == "coulomb_friction"), gates=(box,))
    library = Library(mismatch, [term])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    library.whiten(noise)
    assert useless(library, noise, [term])[1] == told


def test_a_law_that_acts_between_two_removal_rates_is_limited_by_them_and_not_by_the_area():
    answer, _ = answer_of(lambda s: 0.03 * s.v * ((s.mrr > 200.0) & (s.mrr < 600.0)), 2, 50.0, 0.5)
    (term,) = answer.terms
    assert term.name == "viscous_friction"
    assert {g.variable for g in term.gates} == {"MRR"}
    assert sorted(g.low if np.isfinite(g.low) else g.high for g in term.gates) == pytest.approx([200, 600], rel=0.05)


def test_what_an_area_limits_as_well_as_a_rate_does_is_told_by_the_area():
    answer, _ = answer_of(lambda s: 0.03 * s.v * (s.mrr > 0.0), 2, 50.0, 0.5, z=True)
    (term,) = answer.terms
    assert {g.variable for g in term.gates} == {"AR"}
