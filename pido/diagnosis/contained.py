"""What a simulation contains, read from its own current: a mechanism in it can be miscalibrated, but not missing.

In:  one axis of all parts with the simulated current, and the noise of the mismatch.
Out: mechanism id -> the term, with the simulation's own shape, that the simulated current is made of.
The simulated current has no noise of its own. Noise of the mismatch's kind, at a fraction of its level, is added: what
disappears in it could not be found miscalibrated either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar

from pido.diagnosis.confirm import bootstrap, whitened
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.identify import coarse_columns, left_over
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mechanisms.sliding import SIMULATED
from pido.diagnosis.misfit import cancelled, lasting
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.select import best_addition, drop_useless, grid_terms, swap
from pido.diagnosis.terms import Component, Term, behind, fit
from pido.diagnosis.whiten import Noise
from pido.physics.drive import AT_ONCE, MOST_LAGS, Loop

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
_DRAWS = 200  # of blocks
_SHORTEST_LAG = 0.25  # steps
_LONGEST_LAG_S = 0.1
_LAGS = 8
_NOTHING_LEFT = 1e-3  # of the simulated current's rms
_LAG_LEAVES = 0.7  # of what is left without a lag
_MORE_LAGS_LEAVE = 0.9  # of what is left with one of first order
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
_OWN_STATE = "coulomb_friction"
_FALLING = "stribeck_friction"
_CONSTANT = 0.9  # cosine of what a friction that falls with speed says and what Coulomb's does: it hardly falls
_PLAIN = frozenset({_OWN_STATE, "viscous_friction", "inertia"})
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


def contained(
    mismatch: Mismatch, mechanisms: Sequence[Mechanism], noise: Noise, rng: np.random.Generator
) -> dict[str, Component]:
    """What the simulated current is made of, by mechanism id; empty where no simulated current is given."""
    if mismatch.sim is None or not np.any(mismatch.usable):
        return {}
    own = [m for m in mechanisms if m.id not in NOT_A_COMPONENT and m.applies(mismatch.states) is None]
    loop = _loop(mismatch, _offered(own, mismatch))
    # A lag is shorter than the steps of fewer rows.
    thin = _of_simulation(mismatch, 1 if loop else max(1, mismatch.n // _ROWS))
    offered = _offered(own, thin)
    sim = thin.target
    # White noise: what a row is worth is set by how many rows there are, not by how they hang together.
    level = _FRACTION * float(np.median(noise.level))
    faint = Noise(np.zeros(0), np.full(thin.n, level), 1.0, thin.usable)
    problem = thin.with_target(np.where(thin.usable, sim + rng.normal(scale=level, size=thin.n), 0.0))
    # A simulation may round its signs and delay its transients: where all mechanisms at once do not reproduce it, one
    # of them must not be made to.
    every_law = coarse_columns(problem, [t.behind(loop) for t in offered])
    amiss = maximum_filter1d(np.abs(left_over(problem, every_law, None)), _AROUND)
    faint = replace(faint, level=np.hypot(level, np.where(thin.usable, amiss, 0.0)))
    library = Library(problem, offered, collinear=_COLLINEAR, loop=loop)
    library.whiten(faint)
    # What falls with speed, over a long way, is nearly all of a friction: from there no single swap leads back to two.
    coulomb = [t.behind(loop) for t in offered if t.mechanism.id == _OWN_STATE][-1:]
    tried = [swap(library, faint, _greedy(library, faint, start, _LATER), _LATER) for start in ([], coulomb)]
    tried = [drop_useless(library, faint, terms, _LEAST_GAIN) for terms in tried]
    usual = min(tried, key=lambda terms: float(basis(library, faint, terms).bic))
    least = max(
        _LEAST_SHARE * float(np.sqrt(np.mean(sim[thin.usable] ** 2))), _LEAST_LEVEL * float(np.median(noise.level))
    )
    usual = _plainer(library, faint, usual)
    every = _not_cancelled(library, faint, _greedy(library, faint, usual))
    usual = [t for t in usual if t in every]
    out = {}
    for term in every:
        part = _component(library, faint, usual if term in usual else every, term)
        if part.size > least and lasting(mismatch, term) > _LASTING:
            out[term.mechanism.id] = part
    out = _how_sure(thin, faint, out | _level_of(library, faint, every, out), rng)
    level_of_all = float(fit(problem, faint, every).base[0])
    weight = next((t for t in offered if t.mechanism.id == "gravity_load"), None)
    # What a simulation draws at all times on a vertical axis is the weight.
    own = out.get("gravity_load")
    # Beside a far larger constant, what is in proportion to a tool's mass is an accident of which tool cuts what.
    if weight is not None and abs(level_of_all) > max(
        _LEAST_WEIGHT * float(np.median(noise.level)), 0.0 if own is None else own.size
    ):
        out[weight.mechanism.id] = Component(weight, np.array([level_of_all]), abs(level_of_all), np.zeros(1))
    return out


def _offered(mechanisms: Sequence[Mechanism], mismatch: Mismatch) -> list[Term]:
    """What a simulation holds at rest has a name of its own, and is not asked for within other laws; a friction with a
    state of its own there is Coulomb's."""
    every = [t for m in mechanisms for t in grid_terms(m, mismatch.states)]
    return [t for t in every if not (rest := dict(t.shape).get("rest")) or (rest == SIMULATED and t.name == _OWN_STATE)]


def _of_simulation(mismatch: Mismatch, stride: int) -> Mismatch:
    """The simulated current over a constant, every stride-th row of it: a constant is no mechanism, and must not be put
    together from halves of one."""
    thin = lay_out(mismatch.states, [s.sim for s in mismatch.states if s.sim is not None], stride=stride)
    sim = np.concatenate([s.sim for s in thin.states if s.sim is not None])
    thin = thin.with_target(np.where(thin.usable, sim, 0.0))
    return replace(thin, base=thin.usable[None].astype(float), base_names=("constant",))


def _loop(mismatch: Mismatch, offered: Sequence[Term]) -> Loop:
    """The loop behind which the simulation's own drive answers; none where all mechanisms at once do as well without
    one: what a loop makes of a few laws, many others would be put together for."""
    whole = _of_simulation(mismatch, 1)
    columns = coarse_columns(whole, offered)

    def left(tau: float, lags: int = 1) -> float:
        late = behind(columns, whole.states, Loop(tau, lags))
        return float(np.sqrt(np.mean(left_over(whole, late, None)[whole.usable] ** 2)))

    at_once = left(0.0)
    if at_once < _NOTHING_LEFT * float(np.sqrt(np.mean(whole.target[whole.usable] ** 2))):
        return AT_ONCE
    taus = np.geomspace(_SHORTEST_LAG * whole.step, max(_LONGEST_LAG_S, 2 * whole.step), _LAGS)
    k = int(np.argmin([left(float(tau)) for tau in taus]))
    around = (float(taus[max(0, k - 1)]), float(taus[min(_LAGS - 1, k + 1)]))

    def best(lags: int) -> tuple[float, Loop]:
        bounds = (around[0], lags * around[1])
        found: Any = minimize_scalar(left, bounds=bounds, args=(lags,), method="bounded", options={"maxiter": _LAGS})
        return float(found.fun), Loop(float(found.x), lags)

    least, loop = best(1)
    for lags in range(2, MOST_LAGS + 1):
        if left(loop.lag, lags) < _MORE_LAGS_LEAVE * least:
            least, loop = min((least, loop), best(lags), key=lambda each: each[0])
    return loop if least < _LAG_LEAVES * at_once else AT_ONCE


def _component(library: Library, noise: Noise, terms: Sequence[Term], term: Term) -> Component:
    """A term beside the others; of no size where it explains hardly anything that they do not."""
    joint = fit(library.mismatch, noise, terms)
    without = basis(library, noise, [t for t in terms if t != term]).rss
    amplitudes = joint.amplitudes[list(terms).index(term)]
    if without <= (1 + _LEAST_OWN) * joint.rss:
        return Component(term, amplitudes, 0.0, np.zeros(len(amplitudes)))
    effect = amplitudes @ library.columns(term)
    size = float(np.sqrt(np.mean(effect[library.mismatch.usable] ** 2)))
    return Component(term, amplitudes, size, np.zeros(len(amplitudes)))


def _level_of(
    library: Library, noise: Noise, terms: Sequence[Term], found: Mapping[str, Component]
) -> dict[str, Component]:
    """Coulomb's friction as it is without one that falls with speed, where that falls over all speeds that there are,
    by more than the half.

    It then stands for a friction that bends, or for a loop beyond a first order: neither is a component, and with the
    line of a viscous friction it says nearly what Coulomb's does.
    """
    falling = found.get(_FALLING)
    coulomb = next((t for t in (*terms, *library.terms) if t.name == _OWN_STATE), None)
    if falling is None or coulomb is None:
        return {}
    beside = found[_OWN_STATE].amplitudes[0] / falling.amplitudes[0] if _OWN_STATE in found else 0.0
    rows = library.mismatch.usable
    one, other = (library.columns(t)[0, rows] for t in (falling.term, coulomb))
    if beside > 1 or float(one @ other) < _CONSTANT * float(np.sqrt((one @ one) * (other @ other))):
        return {}
    others = [t for t in terms if t.name not in (_OWN_STATE, _FALLING)]
    return {_OWN_STATE: _component(library, noise, [*others, coulomb], coulomb)}


def _how_sure(
    thin: Mismatch, noise: Noise, found: dict[str, Component], rng: np.random.Generator
) -> dict[str, Component]:
    """`found` with the standard errors of their amplitudes: how far these differ between blocks of the simulated
    current as it is, which has no noise, but laws that no component says."""
    if not found:
        return found
    model = whitened(thin, noise, [c.term for c in found.values()])
    errors = bootstrap(model, thin.block, rng, _DRAWS).std(axis=0)
    return {i: replace(c, unsure=errors[own]) for (i, c), own in zip(found.items(), model.spans, strict=True)}


def _not_cancelled(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms` without those that others take back nearly everywhere: of two accelerations that go together in all
    parts, the difference mends what the simulation's loop has beyond a first order."""
    kept = list(terms)
    while True:
        joint = fit(library.mismatch, noise, kept)
        effects = [a @ t.columns(library.mismatch.states) for t, a in zip(kept, joint.amplitudes, strict=True)]
        i = cancelled(effects, library.mismatch.usable)
        if i is None:
            return kept
        del kept[i]


def _plainer(library: Library, noise: Noise, terms: list[Term]) -> list[Term]:
    """`terms`, each as one of the laws that nearly every simulation has where that does as well: at speeds far below
    its own, a Stribeck friction is Coulomb's."""
    out = list(terms)
    for i, term in enumerate(terms):
        rest = basis(library, noise, [t for t in out if t is not term])
        most = (1 + _LEAST_OWN) * basis(library, noise, out).rss
        plain = _PLAIN - {t.mechanism.id for t in out} if term.mechanism.id not in _PLAIN else ()
        scores = [library.score(t, rest) for t in library.terms if t.mechanism.id in plain]
        best = max((s for s in scores if s is not None), key=lambda s: s.gain, default=None)
        if best is not None and rest.rss - best.gain <= most:
            out[i] = best.term
    return out


def _greedy(library: Library, noise: Noise, terms: list[Term], without: frozenset[str] = frozenset()) -> list[Term]:
    """`terms`, and the best single additions but those `without`, while each is worth it."""
    while len(terms) < _MOST:
        current = basis(library, noise, terms)
        best = best_addition(library, current, without | {t.name for t in terms})
        if best is None or best.bic > current.bic - _LEAST_GAIN:
            break
        # What a shape lacks would be taken for another law.
        terms = settle_shapes(library.mismatch, noise, [*terms, best.term])
    return terms
