"""What an experiment is: a list of units of work, a pure function that measures one, and a summary of all rows.

A unit is a key and plain values. Its measurement depends on the data, those values and a generator that is seeded by
the key: so it does not matter where, when and beside how many others it is made.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pido.core.errors import SettingsError
from pido.experiments.data import Fleet

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Unit:
    """key : unique within the experiment, also the name of its result; params : plain values (JSON)"""

    key: str
    params: Mapping[str, Any]


@dataclass(frozen=True)
class Options:
    """repeats : how often what is random is repeated (30 in the paper); quick : a small version of everything.

    estimators : 'default' (extra trees for all axes) or 'paper' (boosting for the spindle, five times the time)
    percents : of a file that are trained on, in place of 10 to 100 and of adding files; of ablation and rivals
    delivered : only PiDO as delivered, its baseline and its null; of ablation
    """

    repeats: int = 30
    quick: bool = False
    seed: int = 0
    estimators: str = "default"
    percents: tuple[int, ...] = ()
    delivered: bool = False


@dataclass(frozen=True, eq=False)
class Shown:
    """A table of the report, and what there is to say about it."""

    title: str
    table: pd.DataFrame
    text: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Outcome:
    """verdict : one or two sentences; tables : the published one beside ours first; differs : what differs and why."""

    verdict: str
    tables: tuple[Shown, ...]
    differs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Experiment:
    """One experiment of the paper, or one past it.

    family : what a virtual machine makes for it, 'impellers' or 'design'
    plan : units for a fleet; measure : rows of one unit; summarise : of the rows of all
    """

    id: str
    title: str
    source: str
    family: str
    plan: Callable[[Fleet, Options], Sequence[Unit]]
    measure: Callable[[Fleet, Mapping[str, Any], np.random.Generator], Rows]
    summarise: Callable[[pd.DataFrame], Outcome]
    quick_repeats: int = field(default=3)


MODULES = {
    "importance": "which inputs an axis' current depends on (figure 4)",
    "weighting": "alpha, beta and sigma of the weights (section IV-B, table 2)",
    "shares": "how many PiA and PiE samples are best (section IV-C, table 3)",
    "local-vs-global": "one equation for all samples, or one per bin (section VII-B.1, table 4)",
    "ablation": "what PiA and PiE do to a model (section VII-B.2, table 5)",
    "rivals": "generated samples beside other ways to do with few data",
}
"""Experiments by name; each is `EXPERIMENT` of the module of that name."""


def experiment(name: str) -> Experiment:
    """An experiment by its name. SettingsError lists the known ones."""
    if name not in MODULES:
        raise SettingsError(f"no experiment '{name}'; there are {', '.join(MODULES)}.")
    return importlib.import_module(f"pido.experiments.{name.replace('-', '_')}").EXPERIMENT
