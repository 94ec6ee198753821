"""The vocabulary once more, in forms of the textbooks that the first two editions do not use.

In:  nothing. Out: `CONCEALED` of this edition, what its groups draw from, and which two mechanisms stand together. The
sentences of `mechanisms.md` stay the meaning. Sources: Hess and Soom, J. Tribology 112 (1990); Dahl, Aerospace Corp.
TOR-0158 (1968); Altintas, Manufacturing Automation, 2.3; Fröhlich's curve: Bozorth, Ferromagnetism (1951).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from benchmarks.newcomer import catalogue
from benchmarks.newcomer.axes import typical
from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.process import load
from benchmarks.newcomer.third.memory import stood
from benchmarks.newcomer.world import Concealed, Law, Maker, World, held, number, per_part, since_reversal
from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES


def _turns(v: Float1D, width: float) -> Float1D:
    """(n,), –1 to 1: sign of a speed, softened as tanh."""
    return np.sign(v) if width <= 0 else np.tanh(v / width)


def _width(world: World, axis: str) -> float:
    return 2.0 * float(world.machine.sign_width[number(axis)])


def coulomb(world: World, axis: str, rng: np.random.Generator) -> Law:
    k, w = number(axis), _width(world, axis)
    return Law(per_part(world, lambda p: _turns(p.v[:, k], w)), {"F_c": (1.0, "A")})


def stribeck(world: World, axis: str, rng: np.random.Generator) -> Law:
    """With an exponent between those of the other editions, or as 1 / (1 + (v / v_s)²) after Hess and Soom."""
    k, w = number(axis), _width(world, axis)
    v_s, hess = typical(world, axis, float(rng.uniform(0.08, 0.4))), bool(rng.random() < 0.35)
    delta = float(rng.choice([0.7, 1.2, 2.0, 2.5]))

    def fallen(v: Float1D) -> Float1D:
        r = np.abs(v) / v_s
        return (1 / (1 + r**2) if hess else np.exp(-(r**delta))) * _turns(v, w / 4)

    exact: dict[str, tuple[float, str]] = {"v_s": (v_s, "mm/s")} if delta == 2 and not hess else {}
    return Law(per_part(world, lambda p: fallen(p.v[:, k])), {"F_s - F_c": (1.0, "A")}, exact,
               {"form": "Hess and Soom" if hess else f"delta {delta}"})  # fmt: skip


def standstill(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Held with the logarithm of time as creep goes, down to a rest of it."""
    k, dt, slope = number(axis), world.machine.dt, float(rng.uniform(0.0, 0.12))

    def rest(v: Float1D) -> Float1D:
        kept = np.maximum(1 - slope * np.log1p(stood(v, dt) / 0.1), 0.4)
        return np.where(v == 0, held(v) * kept, 0.0)

    return Law(per_part(world, lambda p: rest(p.v[:, k])))


def asymmetry(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The straight line of Coulomb and viscous friction together is another one to either side."""
    k, w, share = number(axis), _width(world, axis), float(rng.uniform(0.2, 0.8))
    fast, back = typical(world, axis, 0.9), float(rng.uniform(-1.0, 0.3))
    sign = float(rng.choice([-1.0, 1.0]))

    def of(v: Float1D) -> Float1D:
        return ((1 - share) * _turns(v, w) + share * v / fast) * np.where(sign * v > 0, 1.0, back)

    return Law(per_part(world, lambda p: of(p.v[:, k])), shape={"of": "both", "back": back})


def load_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Two faces of a box way: the loads of both are added, each whichever way it presses.

    No k of the other editions, which multiplies sqrt(f_y² + f_z²) on x: each face has a coefficient of its own.
    """
    k, w = number(axis), _width(world, axis)
    across, mu = [n for n in range(3) if n != k], rng.uniform(0.5, 1.5, 2)
    sizes = {f"k_{LINEAR_AXES[n]}": (float(m), "A/N") for n, m in zip(across, mu, strict=True)}
    return Law(per_part(world, lambda p: (np.abs(p.f[:, across]) @ mu) * _turns(p.v[:, k], w)), sizes)


def position_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A level in straight pieces between a few places of the travel, as gibs are scraped."""
    k, w = number(axis), _width(world, axis)
    where = np.concatenate([p.pos[p.v[:, k] != 0, k] for p in world.parts])
    places = np.linspace(*np.quantile(where, [0.01, 0.99]), int(rng.integers(3, 6)))
    levels = rng.uniform(-1, 1, len(places)) + np.where(np.arange(len(places)) % 2 == 0, 0.6, -0.6)
    mean = float(np.interp(where, places, levels).mean())
    return Law(per_part(world, lambda p: (np.interp(p.pos[:, k], places, levels) - mean) * _turns(p.v[:, k], w)))


def presliding(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Dahl's: dz/dx = (1 − z sgn(v)) / reach, from wherever z was; the simulation has sgn(v)."""
    k, dt = number(axis), world.machine.dt
    reach = max(typical(world, axis, 0.3) * float(rng.uniform(0.05, 0.25)), 0.01)

    def lacking(v: Float1D) -> Float1D:
        now, out = 0.0, np.empty_like(v)
        for n, (sign, way) in enumerate(
            zip(np.sign(v).tolist(), np.exp(-np.abs(v) * dt / reach).tolist(), strict=True)
        ):
            now = sign + (now - sign) * way if sign else now
            out[n] = now - sign if sign else 0.0
        return out

    return Law(per_part(world, lambda p: lacking(p.v[:, k])), shape={"reach_mm": reach})


def backlash(world: World, axis: str, rng: np.random.Generator) -> Law:
    """No friction of the table while the gap is crossed, soft at its end."""
    k, dt = number(axis), world.machine.dt
    gap = max(typical(world, axis, 0.4) * float(rng.uniform(0.12, 0.5)), 0.01)
    soft = 0.15 * gap

    def free(v: Float1D) -> Float1D:
        way, _ = since_reversal(v, dt)
        return np.where(v != 0, -held(v) * np.clip((gap - way) / soft, 0, 1), 0.0)

    return Law(per_part(world, lambda p: free(p.v[:, k])), shape={"gap_mm": gap})


def ripple(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Once, twice and three times per lead or pitch, of any shares."""
    k, pitch = number(axis), world.machine.kind.pitch_mm
    phases, sizes = rng.uniform(0, 2 * np.pi, 3), np.array([1.0, *rng.uniform(0, 0.5, 2)])
    wave = lambda x: sum(s * np.sin(n * 2 * np.pi * x / pitch + f) for n, s, f in zip((1, 2, 3), sizes, phases))  # noqa: B905, E731
    return Law(per_part(world, lambda p: wave(p.pos[:, k])), fixed={"period": (float(pitch), "mm")})


def edge(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Ploughing along the feed and across it, both by the engaged length alone (K_te and K_re)."""
    if axis == "sp":
        return Law(per_part(world, lambda p: p.edge))
    k, (u, w, infeed), across = number(axis), world.machine.kind.plane, float(rng.uniform(-0.4, 0.4))

    def of(p: Part) -> Float1D:
        aside = {u: -p.v[:, w], w: p.v[:, u], infeed: np.zeros(len(p.t))}[k]
        return p.edge * (p.v[:, k] + across * aside) / np.maximum(p.speed, 1e-6)

    return Law(per_part(world, of))


def wear(world: World, axis: str, rng: np.random.Generator) -> Law:
    """By the volume that an edge has cut, fast at first and then slowly, or the other way round (Taylor)."""
    dt, power = world.machine.dt, float(rng.choice([0.7, 1.4]))

    def worn(part: Part) -> Float1D:
        cut = np.zeros(len(part.t))
        for n, before in part.worn.items():
            here = part.tool == n
            cut[here] = before[0] + np.cumsum(part.mrr[here]) * dt
        return (cut / 2e4) ** power

    return Law(per_part(world, lambda p: load(p, axis) * worn(p)), shape={"by": "volume", "power": power})


def hard_zone(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A weld seam or a cast-in plate: a rectangle of any direction, the same in every part."""
    plane, size = list(world.machine.kind.plane[:2]), world.parts[0].size
    middle, heading = rng.uniform(-0.2, 0.2, 2) * size, float(rng.uniform(0, np.pi))
    half = np.array([rng.uniform(0.2, 0.5), rng.uniform(0.12, 0.2)]) * float(size.min())
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])

    def inside(part: Part) -> Float1D:
        far = np.abs((part.pos[:, plane] - part.centre[plane] - middle) @ turn)
        return np.prod(np.clip((half - far) / (0.15 * half[1]) + 0.5, 0, 1), axis=1)

    return Law(per_part(world, lambda p: load(p, axis) * inside(p)), shape={"rectangle": True})


def coolant(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Full as soon as it is on."""
    return Law(per_part(world, lambda p: p.coolant.copy()), {"k": (1.0, "A")})


def warming(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Towards a steady value with time since the machine's start, pauses included: a hall, not a motor, that warms."""
    whole = world.parts[-1].start + float(world.parts[-1].t[-1])
    tau, fades = float(np.clip(whole * rng.uniform(0.08, 0.4), 30.0, 700.0)), bool(rng.random() < 0.5)
    left = per_part(world, lambda p: np.exp(-(p.start + p.t) / tau))
    return Law(left if fades else [1 - x for x in left], fixed={"tau_s": (tau, "s")}, shape={"fades": fades})


def saturation(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Fröhlich's curve: I / (1 − |I| / I_s), of which the simulation has I."""
    most = float(np.max([np.abs(i).max() for i in world.sim[axis]]))
    full = most * float(rng.uniform(1.15, 1.8))
    return Law([i / (1 - np.abs(i) / full) - i for i in world.sim[axis]], shape={"I_s": full})


def external(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Ramps up, stays, ramps down, either way, a few times in every part."""
    dt, columns = world.machine.dt, []
    for p in world.parts:
        force, seconds = np.zeros(len(p.t)), float(p.t[-1])
        for slot in range(max(1, int(seconds / 25))):
            long, rise = float(rng.uniform(4, 9)), float(rng.uniform(0.3, 1.5))
            begin = 25 * slot + float(rng.uniform(0.5, max(1.0, min(24.0, seconds - 25 * slot) - long)))
            size = float(rng.uniform(0.6, 1.3))
            force += size * np.clip(np.minimum(p.t - begin, begin + long - p.t) / rise, 0, 1)
        columns.append(gaussian_filter1d(force, 0.1 / dt))
    return Law(columns)


_FORMS: Mapping[str, Maker] = {
    "coulomb_friction": coulomb, "stribeck_friction": stribeck, "standstill_friction": standstill,
    "friction_asymmetry": asymmetry, "load_dependent_friction": load_dependent,
    "position_dependent_friction": position_dependent, "presliding_hysteresis": presliding, "backlash": backlash,
    "torque_ripple": ripple, "edge_force": edge, "tool_wear": wear, "material_hard_zone": hard_zone,
    "coolant_load": coolant, "thermal_drift": warming, "current_saturation": saturation, "external_force": external,
}  # fmt: skip

CONCEALED: Mapping[str, Concealed] = {n: replace(c, law=_FORMS.get(n, c.law)) for n, c in catalogue.CONCEALED.items()}
"""The rest of them is one formula in every textbook."""

PAIRS = tuple(
    f"{one} and {two}"
    for one, partners in {
        "stribeck_friction": ("torque_ripple", "gravity_load", "coolant_load", "cutting_force"),
        "backlash": ("inertia", "position_dependent_friction", "spindle_windage"),
        "presliding_hysteresis": ("viscous_friction", "axis_coupling", "tool_wear"),
        "standstill_friction": ("load_dependent_friction", "spindle_torque_load", "coulomb_friction"),
        "friction_asymmetry": ("torque_ripple", "edge_force", "thermal_drift"),
        "material_hard_zone": ("spindle_viscous_drag", "inertia", "coulomb_friction"),
        "thermal_drift": ("viscous_friction", "torque_ripple", "spindle_inertia"),
        "axis_coupling": ("cutting_force", "coolant_load", "position_dependent_friction"),
    }.items()
    for two in partners
)  # fmt: skip
"""What has the same cause on a real machine, or hides one behind the other."""

WIDER: Mapping[str, tuple[str, ...]] = {
    "pair": PAIRS,
    "wrong coefficient": (*catalogue.MISCALIBRATED, "stribeck_friction"),
    "confined to a region": (
        *catalogue.CONFINED, "stribeck_friction", "position_dependent_friction", "spindle_inertia", "tool_wear",
    ),
}  # fmt: skip
"""What the groups of this edition draw from."""
