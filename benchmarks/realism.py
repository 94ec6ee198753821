"""How like a real machine the virtual one is: an air cut of a DMC 60H beside a virtual one.

    python -m benchmarks.realism --data ../shared/data --out realism.png

In:  the real recording, and a virtual one of the same NC program, run three times as in the recording.
Out: a table (noise, autocorrelation, what plain friction leaves), one figure, and the score of a classifier that is to
     tell real from virtual windows of current (0.5: it cannot, 1: it always can), trained on one half of the time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

AXES = ("x", "y")
WINDOW = 50


def residual_of_plain_friction(v: np.ndarray, a: np.ndarray, current: np.ndarray) -> np.ndarray:
    """What Coulomb (held sign), viscous friction, inertia and an offset leave, A."""
    moving = np.abs(v) > 0.02
    last = np.maximum.accumulate(np.where(moving, np.arange(len(v)), 0))
    held = np.sign(v[last]) * (np.cumsum(moving) > 0)
    terms = np.column_stack([held, v, a, np.ones(len(v))])
    return current - terms @ np.linalg.lstsq(terms, current, rcond=None)[0]


def autocorrelation(values: np.ndarray, lags: int = 50) -> np.ndarray:
    values = values - values.mean()
    power = np.array([np.mean(values[: len(values) - k] * values[k:]) for k in range(lags)])
    return power / power[0]


def repeatability(columns: dict[str, np.ndarray], axis: str) -> np.ndarray:
    """Difference between neighbouring runs of the same program, over sqrt(2), A: noise without any model.

    Runs are laid on each other by position and speed; only samples in steady motion count, where a shift of a sample
    changes nothing.
    """
    current, v = columns[f"curr_{axis}"], columns[f"v_{axis}"]
    steady = (np.abs(v) > 1) & (np.abs(columns[f"a_{axis}"]) < 20)
    lag = _period(v)
    both = steady[lag:] & steady[:-lag] & (np.abs(v[lag:] - v[:-lag]) < 0.05)
    return ((current[lag:] - current[:-lag]) / np.sqrt(2))[both]


def _period(v: np.ndarray) -> int:
    """Samples after which the program comes again: best match of the speed between 60 and 100 s."""
    spectrum = np.fft.rfft(v, 2 * len(v))
    likeness = np.fft.irfft(np.abs(spectrum) ** 2)[: len(v)] / np.arange(len(v), 0, -1)
    return 3000 + int(np.argmax(likeness[3000:5000]))


def windows(columns: dict[str, np.ndarray]) -> np.ndarray:
    """(m, features): statistics of windows of one second: of current and of what plain friction leaves."""
    rows = []
    parts = {a: residual_of_plain_friction(columns[f"v_{a}"], columns[f"a_{a}"], columns[f"curr_{a}"]) for a in AXES}
    for start in range(0, len(columns["v_x"]) - WINDOW, WINDOW // 2):
        cut = slice(start, start + WINDOW)
        row: list[float] = []
        for a in AXES:
            for signal in (columns[f"curr_{a}"][cut], parts[a][cut]):
                step = np.diff(signal)
                centred = signal - signal.mean()
                row += [
                    signal.std(),
                    step.std(),
                    np.abs(step).max(),
                    np.mean(centred[1:] * centred[:-1]) / (signal.var() + 1e-12),
                ]
        rows.append(row)
    return np.array(rows)


def separation(real: np.ndarray, virtual: np.ndarray) -> float:
    """Area under the ROC curve of a forest trained on the first half of the time, judged on the second."""
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.metrics import roc_auc_score

    half_r, half_v = len(real) // 2, len(virtual) // 2
    X = np.concatenate([real[:half_r], virtual[:half_v]])
    y = np.r_[np.ones(half_r), np.zeros(half_v)]
    forest = RandomForestClassifier(200, min_samples_leaf=3, random_state=0).fit(X, y)
    truth = np.r_[np.ones(len(real) - half_r), np.zeros(len(virtual) - half_v)]
    return float(roc_auc_score(truth, forest.predict_proba(np.concatenate([real[half_r:], virtual[half_v:]]))[:, 1]))


def real_columns(data: Path) -> dict[str, np.ndarray]:
    from pido.recordings import read_recording

    recording = read_recording(data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv", machine="dmc60h")
    return {k: np.asarray(recording[k], float) for a in AXES for k in (f"v_{a}", f"a_{a}", f"curr_{a}")}


def virtual_columns(data: Path, seed: int = 0) -> dict[str, np.ndarray]:
    from pido.core.machining import Tool
    from pido.synthetic.machine import produce
    from pido.synthetic.mills import worn_horizontal
    from pido.synthetic.parts import PartJob

    once = (data / "kit_dmc60h" / "V_S235JR_VALIDATION.MPF").read_bytes().decode("utf-8", "replace")
    body = "\n".join(line for line in once.splitlines() if not line.strip().upper().startswith(("M30", "M2")))
    mill = worn_horizontal()
    tools = {"FRAESER_10St": Tool("FRAESER_10St", 10.0, 4, mass_kg=1.6)}
    job = PartJob("AIRCUT", "\n".join([body] * 3 + ["M30", ""]), tools, zero_mm=(200.0, 200.0, 300.0))
    recording = produce(mill, mill.plan([job]), seed=seed)[0].recording
    return {k: np.asarray(recording[k], float) for a in AXES for k in (f"v_{a}", f"a_{a}", f"curr_{a}")}


def measure(columns: dict[str, np.ndarray], axis: str) -> dict[str, float]:
    rest = residual_of_plain_friction(columns[f"v_{axis}"], columns[f"a_{axis}"], columns[f"curr_{axis}"])
    noise = repeatability(columns, axis)
    r = autocorrelation(rest, 26)
    n = autocorrelation(noise, 26)
    return {
        "current sd, A": float(columns[f"curr_{axis}"].std()),
        "repeatability, A": float(noise.std()),
        "its autocorrelation at 0.1 s": float(n[5]),
        "left by plain friction, A": float(rest.std()),
        "its autocorrelation at 0.1 s ": float(r[5]),
        "its autocorrelation at 0.5 s": float(r[25]),
    }


def figure(real: dict[str, np.ndarray], virtual: dict[str, np.ndarray], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from scipy.signal import welch

    fig, grid = plt.subplots(4, 2, figsize=(12, 14), layout="constrained")
    for column, axis in enumerate(AXES):
        for name, data, colour in (("real", real, "black"), ("virtual", virtual, "tab:orange")):
            v, a, i = (data[f"{k}_{axis}"] for k in ("v", "a", "curr"))
            rest = residual_of_plain_friction(v, a, i)
            noise = repeatability(data, axis)
            limits = tuple(np.array([-1.5, 1.5]) + (np.median(i) if axis == "y" else 0.0))
            show = slice(200, 3200)
            grid[0, column].plot(np.arange(3000) / 50, i[show], colour, lw=0.7, label=name)
            grid[0, column].set(title=f"current {axis}", xlabel="s", ylabel="A", ylim=limits)
            grid[1, column].plot(v, i, ".", color=colour, ms=1, alpha=0.3, label=name)
            grid[1, column].set(title="current over speed", xlabel="mm/s", ylabel="A", xlim=(-12, 12), ylim=limits)
            grid[2, column].plot(
                np.arange(50) / 50, autocorrelation(rest), color=colour, label=f"{name}, left by plain friction"
            )
            grid[2, column].plot(
                np.arange(50) / 50, autocorrelation(noise), "--", color=colour, label=f"{name}, between runs"
            )
            grid[2, column].set(title="autocorrelation", xlabel="s")
            f, power = welch(noise, 50, nperseg=256)
            grid[3, column].loglog(f[1:], power[1:], color=colour, label=name)
            grid[3, column].set(title="spectrum of the difference between runs", xlabel="Hz", ylabel="A²/Hz")
    for ax in grid.flat:
        ax.legend(fontsize=8)
    fig.savefig(path, dpi=110)
    plt.close(fig)


def compare(data: Path) -> tuple[dict[str, Any], dict[str, np.ndarray], dict[str, np.ndarray]]:
    real, virtual = real_columns(data), virtual_columns(data)
    table = {axis: {"real": measure(real, axis), "virtual": measure(virtual, axis)} for axis in AXES}
    return {"axes": table, "separation": separation(windows(real), windows(virtual))}, real, virtual


@click.command()
@click.option("--data", type=click.Path(path_type=Path, exists=True, file_okay=False), default=Path("../shared/data"))
@click.option("--out", type=click.Path(path_type=Path), default=Path("realism.png"))
def main(data: Path, out: Path) -> None:
    """Print the comparison and draw it."""
    result, real, virtual = compare(data)
    for axis, both in result["axes"].items():
        click.echo(f"{axis:36s}{'real':>10s}{'virtual':>10s}")
        for name, value in both["real"].items():
            click.echo(f"  {name.strip():34s}{value:10.4f}{both['virtual'][name]:10.4f}")
    click.echo(f"classifier, area under ROC: {result['separation']:.3f}  (0.5: cannot tell them apart)")
    figure(real, virtual, out)
    click.echo(f"figure: {out}", err=True)


if __name__ == "__main__":
    main()
