"""Many names for one effect that none of them is: one finding without a name, and only then."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.confirm import less_error
from pido.diagnosis.finding import Estimate, Evidence, Finding, HeldOut, Where
from pido.diagnosis.formulas import Formula
from pido.diagnosis.gates import Gate
from pido.diagnosis.shared_out import MANY, is_shared_out, one_for_many, opposed
from pido.diagnosis.signals import signals
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.unnamed import says_it_all
from tests.diagnosis.feeds import BY_ID
from tests.diagnosis.planted import NOISE, planted

LAWS = ("v_x", "v_y", "a_x", "a_y")


def laid_out(*sizes):
    """Four laws of so many noises each on one axis, and their terms."""

    def effect(state):
        columns = [signals(state, [name])[name][0] for name in LAWS]
        return sum(size * c / np.std(c) for size, c in zip(sizes, columns, strict=True))

    library, noise = planted(effect, strength=4.0)
    terms = [Term(Formula(((name, "u"),), "–")) for name, size in zip(LAWS, sizes, strict=True) if size]
    return library.mismatch, noise, terms


@pytest.mark.parametrize(
    ("sizes", "shared"),
    [((1, 1, 1, 1), True), ((5, 1, 1, 1), False), ((3, 3, 1, 1), False), ((1, 1, 1, 0), False)],
)
def test_laws_are_shared_out_where_they_are_many_and_neither_one_nor_two_are_most_of_it(sizes, shared):
    mismatch, _, terms = laid_out(*sizes)
    assert (len(terms) >= MANY) == (sum(map(bool, sizes)) >= MANY)
    assert is_shared_out(mismatch, terms) == shared


@pytest.mark.parametrize(("boxes", "shared"), [(0, False), (2, False), (3, True), (4, True)])
def test_laws_most_of_which_act_in_boxes_of_their_own_imitate_more(boxes, shared):
    mismatch, _, terms = laid_out(4, 2, 1.8, 1.8)
    wide = [(Gate("v_x", low=-1e3 - k),) for k in range(boxes)]
    boxed = [replace(t, gates=g) for t, g in zip(terms, wide, strict=False)]
    assert is_shared_out(mismatch, [*boxed, *terms[boxes:]]) == shared


def test_beside_an_equation_that_lacks_many_laws_many_are_missing():
    mismatch, _, terms = laid_out(1, 1, 1, 1)
    assert not is_shared_out(replace(mismatch, base_names=("viscous",)), terms)


def finding(name, k):
    proof = HeldOut("leave-one-part-out", 1.0, 0.9, 0.1, 0.2, 1e-4)
    return Finding(
        "x", name, "missing_physics", f"dI_x = k * {name}", {"k": Estimate(0.1 * k, "A", (0.0, 0.2))},
        Where("somewhere"), Evidence(10.0**-k, 10.0**-k, 50.0), proof, ("linear",),
    )  # fmt: skip


def test_they_stand_as_one_finding_without_a_name_that_says_what_it_is_made_of():
    mismatch, noise, terms = laid_out(1, 1, 1, 1)
    names = ["inertia", "backlash", "coulomb_friction", "torque_ripple"]
    findings = [finding(name, k) for k, name in enumerate(names, start=1)]
    amplitudes = fit(mismatch, noise, terms).amplitudes
    (one,), note = one_for_many(mismatch, noise, terms, amplitudes, findings, mismatch.target, NOISE)
    assert (one.axis, one.mechanism, one.kind) == ("x", "unknown", "unexplained")
    assert list(one.parameters) == [f"k_{k}" for k in range(1, 5)]
    assert one.fit.rmse_after < 0.5 * one.fit.rmse_before
    assert one.evidence.q_value == 1e-4
    assert one.replaces == ("linear",)
    assert one.where.intervals
    assert all(f"dI_x = k * {name}" in one.equation for name in names)
    assert note is not None
    assert ", ".join(names) in note


def test_findings_that_are_not_shared_out_stay_as_they_are():
    mismatch, noise, terms = laid_out(5, 1, 1, 1)
    findings = [finding("inertia", k) for k in range(4)]
    same = one_for_many(
        mismatch, noise, terms, fit(mismatch, noise, terms).amplitudes, findings, mismatch.target, NOISE
    )
    assert same == (findings, None)


def friction(id_, name="", **shape):
    return Term(BY_ID[id_], tuple(shape.items()), (), name)


DRIFT = friction("thermal_drift", along=1.0, tau=20.0, warms=0.0)
COULOMB = friction("coulomb_friction", rest=0.0)
WRONG = friction("coulomb_friction", "miscalibrated:coulomb_friction", rest=0.0)
WRONG_STRIBECK = friction("stribeck_friction", "miscalibrated:stribeck_friction", v_s=2.0, delta=1.0, rest=0.0)
STANDSTILL = friction("standstill_friction", rest=0.0)
STRIBECK = friction("stribeck_friction", v_s=2.0, delta=1.0, rest=1.0)
VISCOUS = friction("viscous_friction")
ALONG = replace(friction("position_dependent_friction", form=1.0, L=60.0, p_0=0.0), gates=(Gate("AR", low=2.0),))
ZERO = friction("sensor_offset")
NAMELESS = Term(Formula((("a_x", "u"),), "mm/s²"))
BOX = replace(VISCOUS, gates=(Gate("AR", low=2.0),))


@pytest.mark.parametrize(
    ("two", "back", "which"),
    [
        ((DRIFT, COULOMB), 0.7, (0, 1)),
        ((DRIFT, COULOMB), 0.2, None),  # most of both is left
        ((DRIFT, COULOMB), -0.7, None),  # they add up
        ((WRONG, WRONG_STRIBECK), 0.7, None),  # a friction curve with two wrong numbers
        ((STANDSTILL, STRIBECK), 0.7, None),  # around stops
        ((COULOMB, VISCOUS), 0.7, None),  # everywhere: their sum is friction that falls with speed
        ((COULOMB, ALONG), 0.7, None),  # holds Coulomb's
        ((COULOMB, BOX), 0.7, (0, 1)),
        ((NAMELESS, BOX), 0.7, (0, 1)),
        ((NAMELESS, VISCOUS), 0.7, None),
        ((ZERO, NAMELESS), 0.5, (0, 1)),  # a law without a name has a constant of its own
        ((ZERO, VISCOUS), 0.7, None),
    ],
)
def test_two_laws_that_take_most_of_each_other_back_are_one_without_a_name(two, back, which):
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 4000))
    assert opposed(two, [one, -back * one + np.sqrt(1 - back**2) * other]) == which


def test_two_that_oppose_each_other_stand_as_one_beside_what_else_was_found():
    mismatch, noise, terms = laid_out(1, 1, 1, 0)
    names = ["thermal_drift", "coulomb_friction", "inertia"]
    findings = [finding(name, k) for k, name in enumerate(names, start=1)]
    law = replace(terms[0], gates=(Gate("v_y", low=-1e6),))
    named = [replace(t, name=name) for t, name in zip((law, law, terms[2]), names, strict=True)]
    size, _, last = fit(mismatch, noise, terms).amplitudes
    (one, third), note = one_for_many(
        mismatch, noise, named, [size, -0.9 * size, last], findings, mismatch.target, NOISE
    )
    assert one.mechanism == "unknown"
    assert list(one.parameters) == ["k_1", "k_2"]
    assert third is findings[2]
    assert note is not None
    assert "thermal_drift, coulomb_friction" in note


def test_a_law_that_others_have_spoilt_is_not_replaced_by_a_worse_one_without_a_name():
    """Beside v_x stand two that follow the clock, which goes another way in each part."""
    library, _ = planted(lambda s: 0.01 * s.v, strength=1.0)
    mismatch = library.mismatch
    clocks = [((k - 1) / 4) * signals(s, ["t_part"])["t_part"][0] for k, s in enumerate(mismatch.states)]
    mismatch = mismatch.with_target(mismatch.target + NOISE * np.concatenate(clocks))
    law, *spoils = (Term(Formula(((n, f),), "–")) for n, f in (("v_x", "u"), ("t_part", "u"), ("t_part", "u²")))
    worse = [Term(Formula((("v_x", "sgn u"),), "–"))]
    assert less_error(mismatch, worse, [law, *spoils], 0.0)
    assert less_error(mismatch, [law], worse, 0.0)
    assert not says_it_all(mismatch, worse, [law, *spoils])
    assert says_it_all(mismatch, [law], [*worse, *spoils])
