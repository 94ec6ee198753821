"""What a simulation contains, read from its own current: a mechanism in it can be miscalibrated, but not missing.

In:  one axis of all parts with the simulated current, and the noise of the mismatch.
Out: mechanism id -> the term, with the simulation's own shape, that the simulated current is made of.
The simulated current has no noise of its own. Noise of the mismatch's kind, at a fraction of its level, is added: what
disappears in it could not be found miscalibrated either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from pido.core.arrays import Float1D
from pido.diagnosis.identify import coarse_columns, left_over
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.misfit import lasting
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.select import best_addition, drop_useless, grid_terms, swap
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise

_ROWS = 6_000  # that are looked at: the simulated current is the same to the last digit however many there are
_FRACTION = 0.3  # of the mismatch's noise level
_LEAST_SHARE = 0.005  # of the simulated current's rms that a component must have
_LEAST_LEVEL = 0.5  # of the mismatch's noise level that it must have
_LEAST_WEIGHT = 2.0  # the same for a constant, which much else may leave behind
_LEAST_OWN = 0.1  # of what no component explains, that only this one does
_AROUND = 5  # rows
_LASTING = 0.5  # correlation of a component with itself one row later
_LEAST_GAIN = 30.0  # BIC
# Share of a law's power that no others have, above which it is asked for. Over a few speeds of a spindle hardly any of
# its drag is left beside friction and windage; without noise, as a simulated current is, that little tells.
_COLLINEAR = 3e-5
_MOST = 7
# What few simulations have, and what can imitate what most of them have (friction that a warm machine changes, or that
# varies along the travel with a mean of its own), is asked for when the usual is in.
_LATER = frozenset(
    {
        "friction_asymmetry",
        "position_dependent_friction",
        "thermal_drift",
        "tool_wear",
        "edge_force",
        "coolant_load",
        "axis_coupling",
        "backlash",
    }
)
NOT_A_COMPONENT = frozenset(
    {
        "sensor_gain",
        "sensor_offset",
        "sensor_clipping",
        "time_misalignment",
        "current_saturation",
        "external_force",
        "material_hard_zone",
    }
)


@dataclass(frozen=True, slots=True)
class Component:
    """A mechanism that a simulation contains, with its shape and its amplitudes there; size : its rms there, A."""

    term: Term
    amplitudes: Float1D
    size: float


def contained(
    mismatch: Mismatch, mechanisms: Sequence[Mechanism], noise: Noise, rng: np.random.Generator
) -> dict[str, Component]:
    """What the simulated current is made of, by mechanism id; empty where no simulated current is given."""
    if mismatch.sim is None or not np.any(mismatch.usable):
        return {}
    own = [m for m in mechanisms if m.id not in NOT_A_COMPONENT and m.applies(mismatch.states) is None]
    stride = max(1, mismatch.n // _ROWS)
    thin = lay_out(mismatch.states, [s.sim for s in mismatch.states if s.sim is not None], stride=stride)
    sim = np.where(thin.usable, np.concatenate([s.sim for s in thin.states if s.sim is not None]), 0.0)
    # White noise: what a row is worth is set by how many rows there are, not by how they hang together.
    level = _FRACTION * float(np.median(noise.level))
    faint = Noise(np.zeros(0), np.full(thin.n, level), 1.0, thin.usable)
    problem = thin.with_target(np.where(thin.usable, sim + rng.normal(scale=level, size=thin.n), 0.0))
    # A constant is no mechanism, and must not be put together from halves of one.
    problem = replace(problem, base=thin.usable[None].astype(float), base_names=("constant",))
    # What a simulation holds at rest has a name of its own, and is not asked for within other laws.
    offered = [t for m in own for t in grid_terms(m, problem.states) if not dict(t.shape).get("rest")]
    # A simulation may round its signs and delay its transients: where all mechanisms at once do not reproduce it, one
    # of them must not be made to.
    amiss = maximum_filter1d(np.abs(left_over(problem, coarse_columns(problem, offered), None)), _AROUND)
    faint = replace(faint, level=np.hypot(level, np.where(thin.usable, amiss, 0.0)))
    library = Library(problem, offered, collinear=_COLLINEAR)
    library.whiten(faint)
    usual = swap(library, faint, _greedy(library, faint, [], _LATER), _LATER)
    usual = drop_useless(library, faint, usual, _LEAST_GAIN)
    least = max(
        _LEAST_SHARE * float(np.sqrt(np.mean(sim[thin.usable] ** 2))), _LEAST_LEVEL * float(np.median(noise.level))
    )
    every = _greedy(library, faint, usual)
    out = {}
    for term in every:
        part = _component(library, faint, usual if term in usual else every, term)
        if part.size > least and lasting(mismatch, term) > _LASTING:
            out[term.mechanism.id] = part
    level_of_all = float(fit(problem, faint, every).base[0])
    weight = next((t for t in offered if t.mechanism.id == "gravity_load"), None)
    # What a simulation draws at all times on a vertical axis is the weight.
    own = out.get("gravity_load")
    # Beside a far larger constant, what is in proportion to a tool's mass is an accident of which tool cuts what.
    if weight is not None and abs(level_of_all) > max(
        _LEAST_WEIGHT * float(np.median(noise.level)), 0.0 if own is None else own.size
    ):
        out[weight.mechanism.id] = Component(weight, np.array([level_of_all]), abs(level_of_all))
    return out


def _component(library: Library, noise: Noise, terms: Sequence[Term], term: Term) -> Component:
    """A term beside the others; of no size where it explains hardly anything that they do not."""
    joint = fit(library.mismatch, noise, terms)
    without = basis(library, noise, [t for t in terms if t is not term]).rss
    amplitudes = joint.amplitudes[list(terms).index(term)]
    if without <= (1 + _LEAST_OWN) * joint.rss:
        return Component(term, amplitudes, 0.0)
    effect = amplitudes @ library.columns(term)
    return Component(term, amplitudes, float(np.sqrt(np.mean(effect[library.mismatch.usable] ** 2))))


def _greedy(library: Library, noise: Noise, terms: list[Term], without: frozenset[str] = frozenset()) -> list[Term]:
    """`terms`, and the best single additions but those `without`, while each is worth it."""
    while len(terms) < _MOST:
        current = basis(library, noise, terms)
        best = best_addition(library, current, without | {t.name for t in terms})
        if best is None or best.bic > current.bic - _LEAST_GAIN:
            break
        terms = [*terms, best.term]
    return terms
