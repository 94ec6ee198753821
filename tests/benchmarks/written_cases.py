"""What holds for the written cases of every generator: checks that their tests share."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.sealed_truth import Case
from pido.core.columns import CURRENT, CURRENT_SIM, MOTION, PROCESS, TIME, UNITS
from pido.recordings import read_recording


def assert_they_keep_the_contract_of_columns(places: Sequence[Path]) -> None:
    for place in places:
        recording = read_recording(place)
        assert {TIME, *MOTION, *PROCESS, *CURRENT.values(), *CURRENT_SIM.values()} <= set(recording.columns)
        assert set(recording.columns) <= set(UNITS)
        assert np.all(np.diff(recording.time) > 0)
        assert all(np.isfinite(values).all() for values in recording.columns.values())


def assert_nothing_that_is_shown_names_the_case(case: Case, places: Sequence[Path]) -> None:
    for place in places:
        assert sorted(p.name for p in place.iterdir()) == ["part.json", "recording.parquet"]
        text = (place / "part.json").read_text(encoding="utf-8")
        assert not any(word and word in text for word in (case.task.what, case.task.group, case.task.key))


def assert_two_have_the_same_bytes(write: Callable[[Path, Path], Sequence[Path]], folder: Path) -> None:
    """write : (folder of the parts, folder of the truth) -> part folders"""
    written = [write(folder / name, folder / f"truth {name}") for name in ("one", "two")]
    for one, two in zip(*written, strict=True):
        assert all((one / n).read_bytes() == (two / n).read_bytes() for n in ("recording.parquet", "part.json"))
    truths = [(folder / f"truth {name}" / "truth.json").read_bytes() for name in ("one", "two")]
    assert truths[0] == truths[1]
