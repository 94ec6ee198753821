"""The page of an iteration says what its numbers say."""

import re

import numpy as np
import pandas as pd

from pido.reports.iteration import best_rival, iteration_page, verdict
from pido.reports.page import render
from pido.tracking.report_files import RunFiles


def _measured(rmse: float) -> dict[str, float]:
    return {"rmse": rmse, "r2": 0.9, "mae": rmse / 2, "error_99": 3 * rmse, "peak": 2 * rmse}


def _files(name: str = "p02", passed: bool = True) -> RunFiles:
    models = {"constant": 4.0, "friction line": 2.0, "real": 1.0, "pia": 0.9, "pie": 0.8, "both": 0.75}
    summary = {
        "run_key": "k", "machine": "m1", "part": {"digest": "d2", "name": name}, "parts": ["d1", "d2"],
        "settings": {"equations": {"x": "printed"}}, "seed": 0, "code": "0.1", "bundle": "b" * 64,
        "data": {n: {"digest": n, "rows": 10} for n in ("real", "pia", "pie")},
        "balance": {"before": 9.0, "after": 4.0, "relevant_bins": 2, "report": "refused: 3"},
        "metrics": {"x": {name: _measured(value) for name, value in models.items()}},
        "gate": {"passed": passed, "words": "may be promoted", "change": {"x": -0.25}}, "seconds": {"refit": 1.0},
    }  # fmt: skip
    n = 20_000
    trace = {"time": np.arange(n) / 50} | {
        f"{m}_x": np.random.default_rng(0).normal(size=n) for m in ("measured", "both", "real")
    }
    generated = pd.DataFrame({"origin": ["pia", "pie"], "v_x": [1.0, 2.0], "v_y": [0.0, 1.0]})
    bins = pd.DataFrame({"v_x": [0.0, 1.0], "v_y": [0.0, 0.0], "ar": [1.0, 1.0], "before": [40, 0], "after": [40, 40]})
    return RunFiles(summary, generated, bins, pd.DataFrame(trace))


def test_the_verdict_names_the_error_what_generated_rows_did_to_it_and_what_the_gate_says():
    said = verdict(_files().summary)
    assert "x 0.75 A" in said
    assert "generated rows made it smaller on x (-25%)." in said
    assert "may be approved" in said
    assert "not offered" in verdict(_files(passed=False).summary)


def test_the_best_rival_is_the_one_with_the_smallest_error_and_never_one_of_our_models():
    assert best_rival(_files().summary["metrics"]["x"]) == ("friction line", 2.0)


def test_a_first_part_has_a_page_although_nothing_could_be_compared():
    files = _files()
    files.summary["metrics"] = {}
    files.summary["gate"] = {"passed": False, "words": "no part yet that was not trained on; the next part decides"}
    page = iteration_page(RunFiles(files.summary, files.generated, files.bins, pd.DataFrame({"time": []})))
    assert "First part" in page.verdict
    assert "the next part decides" in render(page)


def test_the_page_is_one_small_file_that_loads_nothing_and_runs_no_names():
    name = "</script><img src=x onerror=alert(1)>"
    files = _files(name)
    files.summary["part"]["digest"] = "d2"
    other = _files("p03").summary | {"part": {"digest": "d3", "name": "p03"}}
    html = render(iteration_page(files, 2, [files.summary, other]))
    assert len(html.encode()) < 3e6
    assert "<img src=x" not in html
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", html)
