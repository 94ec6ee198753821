"""What differs from one edition of the cases to the next: machines, laws outside the vocabulary, shares of the groups.

In:  nothing. Out: `EDITIONS` by number. All else is the same for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from benchmarks.newcomer.boxes import Region, draw_box
from benchmarks.newcomer.catalogue import CONCEALED, MENU
from benchmarks.newcomer.foreign import FOREIGN
from benchmarks.newcomer.machines import KINDS, Kind
from benchmarks.newcomer.second import machines
from benchmarks.newcomer.second.laws import LAWS
from benchmarks.newcomer.third import forms, regions
from benchmarks.newcomer.third import laws as third
from benchmarks.newcomer.third import machines as third_machines
from benchmarks.newcomer.world import Concealed


@dataclass(frozen=True)
class Edition:
    """shares : cases of each group in a hand; strengths : of a group that has its own, rms of effect over rms of noise

    textbook : whether all of the vocabulary together is held against what is to lie outside of it
    concealed : the vocabulary in this edition's forms; wider : what a group draws from, where it is not the usual menu;
    region : draws where what is confined holds
    """

    kinds: tuple[Kind, ...]
    outside: Mapping[str, Concealed]
    shares: Mapping[str, int]
    strengths: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    textbook: bool = False
    concealed: Mapping[str, Concealed] = field(default_factory=lambda: CONCEALED)
    wider: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    region: Region = draw_box

    @property
    def menu(self) -> Mapping[str, tuple[str, ...]]:
        """What each group of a plan may draw."""
        return {**MENU, **self.wider, "outside the vocabulary": tuple(self.outside)}


_LATER: Mapping[str, int] = {
    "single": 9, "pair": 5, "wrong coefficient": 3, "data fault": 3, "confined to a region": 10,
    "outside the vocabulary": 17, "confounded": 2, "clean": 2,
}  # fmt: skip
"""Shares of the second edition and of what came after it."""

EDITIONS: Mapping[int, Edition] = {
    1: Edition(
        KINDS,
        FOREIGN,
        {
            "single": 14,
            "pair": 7,
            "wrong coefficient": 4,
            "data fault": 4,
            "confined to a region": 8,
            "outside the vocabulary": 8,
            "confounded": 2,
            "clean": 3,
        },
    ),
    2: Edition(
        machines.KINDS,
        LAWS,
        _LATER,
        {"outside the vocabulary": (1.2, 2.0, 3.0, 5.0)},
        textbook=True,
    ),
    3: Edition(
        third_machines.KINDS,
        third.LAWS,
        _LATER,
        {"outside the vocabulary": (1.2, 2.0, 3.0, 5.0)},
        textbook=True,
        concealed=forms.CONCEALED,
        wider=forms.WIDER,
        region=regions.draw_region,
    ),
}

OUTSIDE: Mapping[str, Concealed] = {n: law for edition in EDITIONS.values() for n, law in edition.outside.items()}
"""Of all editions."""
