"""Every mechanism finds itself: textbook effects on a fine clock, recorded at 500 Hz or smoothed to 50 Hz.

Nothing here uses the laws of `pido`: signs are exact, friction states are integrated step by step, transients are
rectangles or exponentials, zones have hard edges. Only then is the effect sampled, and the catalogue has to find it.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.state import axis_states

FINE = 1000  # Hz
BY_ID = {m.id: m for m in CATALOGUE}
LEAD = 10.0


@dataclass
class Fine:
    """A part as it was: exact motion and load on a fine clock."""

    t: np.ndarray
    pos: dict[str, np.ndarray]
    v: dict[str, np.ndarray]
    a: dict[str, np.ndarray]
    v_sp: np.ndarray
    a_sp: np.ndarray
    force: dict[str, np.ndarray]
    m_sp: np.ndarray
    mrr: np.ndarray
    a_p: np.ndarray
    coolant: np.ndarray
    tool: np.ndarray
    mass: np.ndarray
    line: np.ndarray
    depth_of_line: list[float]
    clock: float
    used: dict[int, float] = field(default_factory=lambda: {1: 0.0, 2: 0.0})  # mm³ each tool cut before this part


def machine_run(seed: int, seconds: float = 45.0, clock: float = 0.0) -> Fine:
    """Moves of all sizes and feeds with stops between them; some cut."""
    rng = np.random.default_rng(seed)
    n = int(seconds * FINE)
    v = {a: np.zeros(n) for a in "xyz"}
    cut, depth, line = np.zeros(n, bool), np.zeros(n), np.zeros(n, int)
    at = {"x": 20.0 + 40 * rng.random(), "y": 20.0 + 40 * rng.random(), "z": 10.0}
    start = dict(at)
    depths, k, size = [0.0], int(0.3 * FINE), {"x": 100.0, "y": 80.0, "z": 30.0}
    while True:
        axes = rng.choice(["x", "y", "xy", "z", "x", "y"])
        target = dict(at)
        for a in axes:
            small = rng.random() < 0.3
            way = rng.choice([-1, 1]) * rng.choice([0.1, 0.5, 2.0]) if small else size[a] * rng.random() - at[a]
            target[a] = float(np.clip(at[a] + way, 0, size[a]))
        way = np.sqrt(sum((target[a] - at[a]) ** 2 for a in "xyz"))
        feed = float(rng.choice([0.7, 2.0, 6.0, 15.0, 40.0]))
        if way < 0.02 or way / feed > 6:
            continue
        ramp = max(2, int(min(feed / 300.0, way / feed) * FINE))
        flat = max(1, int(way / feed * FINE) - ramp)
        profile = np.convolve(np.ones(flat + 1), np.ones(ramp) / ramp)
        profile = np.convolve(profile, np.hanning(42)[1:-1] / np.hanning(42).sum())
        profile *= way / (profile.sum() / FINE)
        end = k + len(profile)
        if end + FINE // 2 > n:
            break
        for a in "xyz":
            v[a][k:end] = profile * (target[a] - at[a]) / way
        is_cut = axes != "z" and rng.random() < 0.6
        cut[k:end] = is_cut
        depths.append(float(rng.choice([1.0, 2.0, 3.5])) if is_cut else 0.0)
        depth[k:end] = depths[-1]
        at = target
        stop = int(rng.choice([0.02, 0.3, 1.0]) * FINE)
        line[k : end + stop] = len(depths) - 1
        k = end + stop
        line[k:] = len(depths) - 1
    pos = {a: start[a] + np.cumsum(v[a]) / FINE for a in "xyz"}
    acc = {a: np.gradient(v[a], 1 / FINE) for a in "xyz"}
    t = np.arange(n) / FINE
    speed = np.sqrt(sum(v[a] ** 2 for a in "xyz"))
    chip = np.where(cut, depth * speed**0.75 * (1 + 0.3 * np.sin(0.9 * t + seed)), 0.0)
    one = np.where(speed > 0, speed, 1.0)
    force = {
        "x": 9.0 * chip * (0.6 * v["x"] + 0.8 * v["y"]) / one,
        "y": 9.0 * chip * (0.6 * v["y"] - 0.8 * v["x"]) / one,
        "z": 4.0 * chip,
    }
    wanted = np.repeat(rng.choice([3000.0, 7200.0, 12000.0, 18000.0], 6), n // 6 + 1)[:n]
    v_sp = np.convolve(np.r_[np.zeros(800), wanted], np.ones(800) / 800, "valid")[:n]
    half = t > seconds * (0.35 + 0.2 * rng.random())
    return Fine(
        t, pos, v, acc, v_sp, np.gradient(v_sp, 1 / FINE), force, 0.15 * chip, depth * 5.0 * speed * cut, depth,
        ((t % 13.0) > 5.0).astype(float), np.where(half, 2, 1), np.where(half, 3.5, 1.0), line, depths, clock,
    )  # fmt: skip


def three_parts() -> list[Fine]:
    parts, used = [], {1: 0.0, 2: 0.0}
    for k, clock in enumerate((0.0, 70.0, 600.0)):
        parts.append(replace(machine_run(k + 1, clock=clock), used=dict(used)))
        for tool in used:
            used[tool] += float((parts[-1].mrr * (parts[-1].tool == tool)).sum() / FINE)
    return parts


@pytest.fixture(scope="module")
def fine() -> list[Fine]:
    return three_parts()


def sampled(values: np.ndarray, rate: int) -> np.ndarray:
    """Every second sample at 500 Hz; means over 20 ms at 50 Hz."""
    if rate == 500:
        return values[::2]
    m = FINE // rate
    return values[: len(values) // m * m].reshape(-1, m).mean(axis=1)


def recorded(parts: list[Fine], rate: int, sim=None, lead=True, workpiece=True) -> list[Recording]:
    out = []
    for k, f in enumerate(parts):
        rng = np.random.default_rng(100 + k)
        columns = {"time": sampled(f.t, rate)}
        columns["time"] = columns["time"] - columns["time"][0]
        for a in "xyz":
            columns[f"pos_{a}"] = np.round(sampled(f.pos[a], rate), 4)
            columns[f"v_{a}"] = sampled(f.v[a], rate) + rng.normal(0, 0.002, len(columns["time"]))
            columns[f"a_{a}"] = sampled(f.a[a], rate)
            columns[f"f_{a}_sim"] = sampled(f.force[a], rate)
        columns |= {
            "v_sp": sampled(f.v_sp, rate), "a_sp": sampled(f.a_sp, rate), "m_sp_sim": sampled(f.m_sp, rate),
            "mrr_sim": sampled(f.mrr, rate), "coolant": np.round(sampled(f.coolant, rate)),
            "nc_line": np.round(sampled(f.line.astype(float), rate)),
        }  # fmt: skip
        if sim is not None:
            columns |= {f"curr_{a}_sim": sampled(sim(f), rate) for a in ("x", "y", "z", "sp")}
        about = {
            "part": f"p{k}", "machine": "m", "order": k + 1, "start_time_s": f.clock, "vertical_axis": "z",
            "tools": {"1": {"mass_kg": 1.0}, "2": {"mass_kg": 3.5}},
            "tool_changes": [{"t": 0.0, "tool_id": 1}, {"t": float(f.t[np.argmax(f.tool == 2)]), "tool_id": 2}],
            "operations": [{"nc_line": i, "a_p": d} for i, d in enumerate(f.depth_of_line)],
        }  # fmt: skip
        if lead:
            about["ball_screw_lead_mm"] = {a: LEAD for a in "xyz"}
        if workpiece:
            about["workpiece"] = {"center_xy_mm": [50, 40], "size_xy_mm": [100, 80]}
        out.append(Recording(PartInfo.model_validate(about), columns))
    return out


def find(mechanism, states, target, beside=()):
    """Amplitudes and shape of least squares together with the mechanisms `beside`, and the share explained.

    Best shape by least squares: its starts, what the target suggests, then one parameter after another.
    """
    y = np.concatenate(target)

    def columns(state, shape):
        return [mechanism.regressors(state, **shape), *(m.regressors(state) for m in beside)]

    def fit(shape):
        with np.errstate(over="ignore"):
            X = np.concatenate([np.column_stack(columns(s, shape)) for s in states])
        beta, *_ = np.linalg.lstsq(X, y, rcond=1e-9)
        return float(np.sum((y - X @ beta) ** 2)), beta, shape

    best = min((fit(s) for s in (*mechanism.starts(states), *mechanism.suggest(states, target))), key=lambda r: r[0])
    for _ in range(4):
        for p in mechanism.shape:
            low, high = mechanism.around(p.name, best[2], states)
            if not low < high:
                continue
            log = p.scale == "log"
            to, back = (np.log, np.exp) if log else (float, float)

            def moved(u, shape=best[2], name=p.name, back=back):
                return fit({**shape, name: float(back(u))})

            got = minimize_scalar(
                lambda u, moved=moved: moved(u)[0],
                bounds=(to(low), to(high)),
                method="bounded",
                options={"maxiter": 14},
            )
            best = min(best, moved(got.x), key=lambda r: r[0])
    return 1.0 - best[0] / float(np.sum(y**2)), best[1], best[2]


# -- the textbook ---------------------------------------------------------------------------------------------------


def last_sign(v):
    moved = np.where(v != 0, np.arange(len(v)), 0)
    return np.sign(v)[np.maximum.accumulate(moved)]


def dahl(f, x_0):
    z, out = 0.0, np.empty(len(f.t))
    for k, v in enumerate(f.v["x"]):
        z += (v - abs(v) * z) / x_0 / FINE
        out[k] = z
    return out


def lugre(f, x_0):
    """Bristle deflection of constant friction: F = s0 z + s1 dz/dt, s0 = 1 / x_0, small s1."""
    z, out, s_1 = 0.0, np.empty(len(f.t)), 0.002
    for k, v in enumerate(f.v["x"]):
        for _ in range(4):
            rate = v - abs(v) * z / x_0
            z += rate / FINE / 4
        out[k] = z / x_0 + s_1 * rate
    return out


def slip(f, x_0):
    """One Maxwell element: a spring that slides."""
    z, out = 0.0, np.empty(len(f.t))
    for k, step in enumerate(f.v["x"] / FINE):
        z = min(1.0, max(-1.0, z + step / x_0))
        out[k] = z
    return out


def after_reversal(f):
    """(way mm, time s) since the last reversal of x, inf before the first."""
    way, seconds, last = np.inf, np.inf, 0.0
    out = np.empty((2, len(f.t)))
    for k, v in enumerate(f.v["x"]):
        if v * last < 0:
            way, seconds = 0.0, 0.0
        last = np.sign(v) or last
        way, seconds = way + abs(v) / FINE, seconds + 1 / FINE
        out[:, k] = way, seconds
    return out


def sgn(f, axis="x"):
    return np.sign(f.v[axis])


def simulated(f):
    return 0.5 * np.tanh(f.v["x"] / 0.3) + 0.004 * f.a["x"] + 0.004 * f.force["x"] + 0.02 * f.v["x"]


def delayed(shift, drift=0.0):
    return lambda f: np.interp(f.t - shift - drift * f.t, f.t, simulated(f)) - simulated(f)


def wear_volume(f):
    """cm³ that the tool in use has cut, this part and those before."""
    own = [f.used[tool] + np.cumsum(f.mrr * (f.tool == tool)) / FINE for tool in (1, 2)]
    return np.where(f.tool == 1, own[0], own[1]) / 1000.0


def cooled(f, tau):
    """Warmth 0..1 that grows while a part runs and decays in the pauses, integrated from the first part on."""
    warm, end = 0.0, None
    for clock in (0.0, 70.0, 600.0):
        if end is not None:
            warm *= np.exp(-(clock - end) / tau)
        if clock == f.clock:
            break
        warm, end = 1 - (1 - warm) * np.exp(-45.0 / tau), clock + 45.0
    return 1 - (1 - warm) * np.exp(-f.t / tau)


def zone(f, disc):
    dx, dy = f.pos["x"] - 60.0, f.pos["y"] - 35.0
    return np.hypot(dx, dy) < 22.0 if disc else (np.abs(dx) < 25.0) & (np.abs(dy) < 12.0)


def perp(f):
    return np.hypot(f.force["y"], f.force["z"])


# id, axis, the effect in A, amplitudes and shapes that must come out (8 %, 12 % at 50 Hz), share that must be explained
ROWS = [
    ("coulomb_friction", "x", lambda f: 0.4 * sgn(f), {"F_c": 0.4}, 0.97),
    ("coulomb_friction", "x", lambda f: 0.4 * np.tanh(f.v["x"] / 0.05), {"F_c": 0.4}, 0.97),
    ("coulomb_friction", "sp", lambda f: 0.4 * np.sign(f.v_sp), {"F_c": 0.4}, 0.97),
    ("viscous_friction", "y", lambda f: 0.01 * f.v["y"], {"F_v": 0.01}, 0.97),
    (
        "stribeck_friction",
        "x",
        lambda f: 0.5 * np.exp(-((f.v["x"] / 3) ** 2)) * sgn(f),
        {"F_s - F_c": 0.5, "v_s": 3},
        0.9,
    ),
    (
        "stribeck_friction",
        "x",
        lambda f: 0.5 * np.exp(-np.abs(f.v["x"]) / 6) * sgn(f),
        {"F_s - F_c": 0.5, "v_s": 6},
        0.9,
    ),
    (
        "stribeck_friction",
        "x",
        lambda f: 0.5 * np.exp(-((f.v["x"] / 3) ** 2)) * last_sign(f.v["x"]),
        {"F_s - F_c": 0.5, "v_s": 3, "rest": 1},
        0.9,
    ),
    ("stribeck_friction", "x", lambda f: 0.5 / (1 + (f.v["x"] / 4) ** 2) * sgn(f), {}, 0.85),
    ("standstill_friction", "x", lambda f: 0.3 * last_sign(f.v["x"]) * (f.v["x"] == 0), {"F_h": 0.3}, 0.95),
    ("friction_asymmetry", "x", lambda f: 0.3 * (f.v["x"] > 0), {"dF_c": 0.3}, 0.97),
    ("friction_asymmetry", "x", lambda f: -0.2 * (f.v["x"] < 0), {}, 0.97),
    ("friction_asymmetry", "x", lambda f: 0.15 * np.abs(sgn(f)), {"dF_c": 0.3}, 0.97),
    ("friction_asymmetry", "x", lambda f: 0.01 * np.maximum(f.v["x"], 0), {"dF_v": 0.01}, 0.97),
    ("load_dependent_friction", "x", lambda f: 0.002 * perp(f) * sgn(f), {"mu": 0.002}, 0.97),
    ("position_dependent_friction", "x", lambda f: 0.006 * (f.pos["x"] - 50) * sgn(f), {}, 0.97),
    ("position_dependent_friction", "x", lambda f: 1e-4 * (f.pos["x"] - 30) ** 2 * sgn(f), {}, 0.95),
    (
        "position_dependent_friction",
        "x",
        lambda f: 0.2 * np.sin(f.pos["x"] / 7 + 0.7) * sgn(f),
        {"L": 14 * np.pi},
        0.97,
    ),
    (
        "position_dependent_friction",
        "x",
        lambda f: 0.3 * np.exp(-((f.pos["x"] - 42) ** 2) / 72) * sgn(f),
        {"p_0": 42},
        0.95,
    ),
    ("position_dependent_friction", "x", lambda f: 0.3 * (np.abs(f.pos["x"] - 42) < 8) * sgn(f), {"form": 6}, 0.8),
    (  # a worn stretch that begins steeply and ends gently
        "position_dependent_friction",
        "x",
        lambda f: (0.1 + 0.3 / (1 + np.exp(-(f.pos["x"] - 35) / 2)) - 0.006 * np.maximum(f.pos["x"] - 45, 0)) * sgn(f),
        {"form": 6},
        0.95,
    ),
    (  # a ball screw of 8 mm lead, over a travel of many turns
        "position_dependent_friction",
        "x",
        lambda f: (0.1 + 0.1 * np.sin(2 * np.pi * f.pos["x"] / 8 + 0.7)) * sgn(f),
        {"L": 8},
        0.95,
    ),
    ("presliding_hysteresis", "x", lambda f: 0.4 * dahl(f, 0.05), {"F_p": 0.4}, 0.97),
    ("presliding_hysteresis", "x", lambda f: 0.4 * dahl(f, 0.4), {"F_p": 0.4, "x_0": 0.4}, 0.97),
    ("presliding_hysteresis", "x", lambda f: 0.4 * lugre(f, 0.1), {"F_p": 0.4}, 0.95),
    ("presliding_hysteresis", "x", lambda f: 0.4 * slip(f, 0.3), {"F_p": 0.4}, 0.95),
    ("presliding_hysteresis", "x", lambda f: 0.4 * (dahl(f, 0.3) - last_sign(f.v["x"])), {"F_p": 0.4, "x_0": 0.3}, 0.8),
    ("backlash", "x", lambda f: 0.5 * (after_reversal(f)[0] < 0.3) * last_sign(f.v["x"]), {"B": 0.5, "gap": 0.3}, 0.8),
    ("backlash", "x", lambda f: 0.5 * (after_reversal(f)[0] < 3.6) * last_sign(f.v["x"]), {"B": 0.5, "gap": 3.6}, 0.97),
    (
        "backlash",
        "x",
        lambda f: 0.5 * np.exp(-after_reversal(f)[0] / 0.3) * last_sign(f.v["x"]),
        {"B": 0.5, "gap": 0.3},
        0.85,
    ),
    (
        "backlash",
        "x",
        lambda f: 0.5 * (after_reversal(f)[1] < 0.25) * last_sign(f.v["x"]),
        {"B": 0.5, "gap": 0.25},
        0.8,
    ),
    ("backlash", "x", lambda f: 0.5 * np.exp(-after_reversal(f)[1] / 0.15) * last_sign(f.v["x"]), {"B": 0.5}, 0.85),
    ("inertia", "z", lambda f: 0.002 * f.a["z"], {"m": 0.002}, 0.97),
    ("gravity_load", "z", lambda f: 0.8 * np.ones_like(f.t), {"G": 0.8}, 0.97),
    ("gravity_load", "z", lambda f: 0.2 * f.mass, {"G": 0.2}, 0.97),
    ("axis_coupling", "x", lambda f: 0.002 * f.a["y"], {"k": 0.002, "source": 3}, 0.97),
    ("axis_coupling", "z", lambda f: 0.02 * f.v["x"], {"k": 0.02, "source": 1}, 0.97),
    ("axis_coupling", "x", lambda f: 0.2 * sgn(f, "y"), {"k": 0.2, "source": 5}, 0.97),
    ("torque_ripple", "x", lambda f: 0.2 * np.sin(2 * np.pi * f.pos["x"] / LEAD + 1), {"L": LEAD}, 0.97),
    ("torque_ripple", "x", lambda f: 0.2 * np.sin(2 * np.pi * f.pos["x"] / (LEAD / 3) + 1), {"L": LEAD / 3}, 0.95),
    ("torque_ripple", "x", lambda f: 0.2 * np.sin(2 * np.pi * f.pos["x"] / 7.37), {"L": 7.37}, 0.97),
    ("torque_ripple", "y", lambda f: 0.2 * np.cos(2 * np.pi * f.pos["y"] / 1.83), {"L": 1.83}, 0.9),
    (  # a cog that rises faster than it falls
        "torque_ripple",
        "x",
        lambda f: 0.2 * np.sin(2 * np.pi * f.pos["x"] / 7.37) + 0.09 * np.sin(4 * np.pi * f.pos["x"] / 7.37 + 0.5),
        {"L": 7.37},
        0.97,
    ),
    ("cutting_force", "y", lambda f: 0.004 * f.force["y"], {"k": 0.004}, 0.97),
    ("edge_force", "x", lambda f: 0.05 * f.a_p * (f.mrr > 0), {"K_e": 0.05}, 0.95),
    ("edge_force", "sp", lambda f: 0.3 * (f.mrr > 0), {"K_e": 0.3}, 0.95),
    ("edge_force", "x", lambda f: 0.05 * f.a_p * (f.mrr > 0) * sgn(f), {"K_e": 0.05}, 0.95),
    ("tool_wear", "sp", lambda f: 0.02 * wear_volume(f) * f.m_sp, {"W": 0.02}, 0.97),
    ("tool_wear", "x", lambda f: 1e-4 * wear_volume(f) * f.force["x"], {"W": 1e-4}, 0.97),
    ("tool_wear", "x", lambda f: 1e-5 * wear_volume(f) ** 1.6 * f.force["x"], {"power": 1.6}, 0.97),
    ("tool_wear", "x", lambda f: 1e-3 * wear_volume(f) ** 0.6 * f.force["x"], {"power": 0.6}, 0.97),
    ("tool_wear", "x", lambda f: 0.02 * wear_volume(f) * (f.mrr > 0), {"W": 0.02}, 0.95),
    ("material_hard_zone", "x", lambda f: 0.003 * f.force["x"] * zone(f, True), {"H": 0.003, "x_c": 10}, 0.93),
    ("material_hard_zone", "sp", lambda f: 0.3 * f.m_sp * zone(f, False), {"H": 0.3}, 0.93),
    ("coolant_load", "y", lambda f: 0.2 * f.coolant, {"C": 0.2}, 0.97),
    ("coolant_load", "y", lambda f: 0.2 * f.coolant * sgn(f, "y"), {"C": 0.2}, 0.95),
    ("spindle_viscous_drag", "sp", lambda f: 1e-4 * f.v_sp, {"k": 1e-4}, 0.97),
    ("spindle_windage", "sp", lambda f: 1e-8 * f.v_sp * np.abs(f.v_sp), {"k": 1e-8}, 0.97),
    ("spindle_inertia", "sp", lambda f: 1e-4 * f.a_sp, {"J": 1e-4}, 0.97),
    ("spindle_torque_load", "sp", lambda f: 0.3 * f.m_sp, {"k": 0.3}, 0.97),
    ("thermal_drift", "x", lambda f: 0.5 * np.exp(-f.t / 17.0), {"T": 0.5, "tau": 17}, 0.97),
    ("thermal_drift", "x", lambda f: 0.5 * (1 - np.exp(-f.t / 12.0)) * sgn(f), {"T": 0.5, "tau": 12}, 0.97),
    ("thermal_drift", "x", lambda f: 0.5 * (1 - cooled(f, 150.0)), {"T": 0.5, "tau": 150}, 0.97),
    ("thermal_drift", "x", lambda f: 0.5 * cooled(f, 60.0) * sgn(f), {"T": 0.5, "tau": 60}, 0.97),
    ("thermal_drift", "x", lambda f: 0.5 * np.exp(-(f.clock + f.t) / 200.0), {"T": 0.5, "tau": 200}, 0.97),
    ("thermal_drift", "x", lambda f: 0.02 * (1 - cooled(f, 100.0)) * f.v["x"], {"T": 0.02}, 0.97),
    (
        "current_saturation",
        "x",
        lambda f: 0.3 * np.sign(simulated(f)) * np.maximum(np.abs(simulated(f)) - 0.7, 0),
        {"s": 0.3},
        0.9,
    ),
    (
        "current_saturation",
        "x",
        lambda f: 0.3 * np.sign(simulated(f)) * np.maximum(np.abs(simulated(f)) - 0.5, 0) ** 2,
        {"form": 4},
        0.9,
    ),
    ("current_saturation", "x", lambda f: 0.1 * simulated(f) * np.abs(simulated(f)), {"s": 0.1}, 0.95),
    ("current_saturation", "x", lambda f: 0.05 * simulated(f) ** 3, {}, 0.75),
    (
        "current_saturation",
        "x",
        lambda f: 0.9 * np.tanh(simulated(f) / 0.9) - simulated(f),
        {"s": -1.0, "I_k": 0.9},
        0.9,
    ),
    ("sensor_gain", "x", lambda f: 0.15 * simulated(f), {"g - 1": 0.15}, 0.97),
    ("sensor_offset", "sp", lambda f: -0.25 * np.ones_like(f.t), {"I_0": -0.25}, 0.97),
    ("sensor_clipping", "x", lambda f: np.clip(simulated(f), -0.8, 0.8) - simulated(f), {"c": 1, "I_max": 0.8}, 0.9),
    (
        "sensor_clipping",
        "x",
        lambda f: np.minimum(simulated(f), 0.7) - simulated(f),
        {"c": 1, "I_max": 0.7, "side": 1},
        0.9,
    ),
    ("time_misalignment", "x", delayed(0.1), {"shift": 0.1}, 0.95),
    ("time_misalignment", "x", delayed(-0.04), {"shift": -0.04}, 0.9),
]


def named(mechanism, beta, shape):
    return {p.name: float(b) for p, b in zip(mechanism.amplitudes, beta, strict=False)} | shape


@pytest.mark.parametrize("rate", [500, 50])
@pytest.mark.parametrize("row", range(len(ROWS)), ids=lambda k: f"{ROWS[k][0]}-{k}")
def test_a_mechanism_recovers_its_own_textbook_effect(fine, row, rate):
    name, axis, effect, expected, least = ROWS[row]
    mechanism = BY_ID[name]
    recordings = recorded(fine, rate, simulated if name not in ("thermal_drift",) else None)
    states = axis_states(recordings, axis)
    assert mechanism.applies(states) is None
    clean = [sampled(effect(f), rate) for f in fine]
    size = np.sqrt(np.mean(np.concatenate(clean) ** 2))
    target = [c + np.random.default_rng(k).normal(0, 0.1 * size, len(c)) for k, c in enumerate(clean)]
    # How friction varies along the travel is told only beside its level.
    beside = (BY_ID["coulomb_friction"],) if name == "position_dependent_friction" else ()
    share, beta, shape = find(mechanism, states, target, beside)
    found = named(mechanism, beta, shape)
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=0.08 if rate == 500 else 0.12), (key, found)
    assert share > least - 0.01, (share, found)


def test_a_machine_that_warms_up_since_before_the_first_part_keeps_its_time_constant(fine):
    late = [replace(f, clock=f.clock + 120.0) for f in fine]
    states = axis_states(recorded(late, 50), "x")
    target = [sampled(0.5 * (1 - np.exp(-(f.clock + f.t) / 150.0)), 50) for f in late]
    share, beta, shape = find(BY_ID["thermal_drift"], states, target)
    assert share > 0.999
    assert named(BY_ID["thermal_drift"], beta, shape) == pytest.approx(
        {"T": 0.5, "tau": 150.0, "clock": 3.0, "along": 0.0, "rises": 1.0, "rest": 0.0, "cools": 1.0}, rel=0.02
    )
