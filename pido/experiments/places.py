"""Where the results of a run go, and that they are never taken for, or replaced by, those of another one.

In:  the data that are named, a folder, what is asked for. Out: names of folders; `experiment.json`, which says from the
     start whose results a folder holds, or SettingsError.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pido.core.errors import SettingsError
from pido.core.files import write_atomically
from pido.experiments.data import VIRTUAL

ABOUT = "experiment.json"
_GROW = ("repeats", "cases")  # more of them is the same run, continued


def place_digest(source: str) -> str:
    """sha256 of where the data lie, however they are named; of a virtual machine, its name."""
    return hashlib.sha256((source if source in VIRTUAL else str(Path(source).resolve())).encode()).hexdigest()


def folder_names(sources: Sequence[str]) -> dict[str, str]:
    """A folder per source: its last name in full, with a short digest of its place where two places share one.

    >>> folder_names(["worn", "made/mill.v1", "made/mill.v2"])
    {'worn': 'worn', 'made/mill.v1': 'mill.v1', 'made/mill.v2': 'mill.v2'}
    """
    names = {source: _as_name(source if source in VIRTUAL else Path(source).resolve().name) for source in sources}
    places: dict[str, set[str]] = {}
    for source, name in names.items():
        places.setdefault(name, set()).add(place_digest(source))
    return {s: n if len(places[n]) == 1 else f"{n}-{place_digest(s)[:8]}" for s, n in names.items()}


def claim(folder: Path, facts: Mapping[str, Any], *, fresh: bool = False) -> None:
    """Write into the folder that its results are of this run.

    facts : `experiment`, `data` in words, `data_digest`, `seed`, `options`; further ones are kept beside them
    fresh : in place of whatever the folder holds
    A run that was stopped goes on, and so does one with more repeats or cases. Raises SettingsError, naming what
    differs, where the folder holds another run, or more of this one.
    """
    file = folder / ABOUT
    if file.exists() and not fresh and (others := _differences(_held(file), json.loads(json.dumps(facts)))):
        raise SettingsError(
            f"{folder}: holds another run: {'; '.join(others)}. Name another --out, or --fresh to replace it."
        )
    write_atomically(file, json.dumps(facts, indent=1))


def _differences(held: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """What of a held run is not as asked, in words; of what an earlier version did not write nothing is said."""
    said = [
        f"its {name} is {held[name]}, not {asked[name]}"
        for name in ("experiment", "seed")
        if held.get(name, asked[name]) != asked[name]
    ]
    if held.get("data_digest", asked["data_digest"]) != asked["data_digest"]:
        said.append(f"its data ({held.get('data')}) are not these ({asked['data']})")
    options = held.get("options", {})
    for name, value in asked["options"].items():
        was = options.get(name, value)
        if was != value and not (name in _GROW and isinstance(was, int) and was < value):
            said.append(f"its {name} is {was}, not {value}")
    return said


def _held(file: Path) -> dict[str, Any]:
    try:
        held = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        held = None
    if not isinstance(held, dict) or not isinstance(held.get("options", {}), dict):
        raise SettingsError(f"{file}: says of no run what it was. Name another --out, or --fresh to replace it.")
    return held


def _as_name(words: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in words) or "data"
