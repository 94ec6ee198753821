"""The catalogue of this edition's laws outside the vocabulary, by name."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.newcomer.third.cuts import CUTS
from benchmarks.newcomer.third.drives import DRIVES
from benchmarks.newcomer.third.guides import GUIDES
from benchmarks.newcomer.third.mechanics import MECHANICS
from benchmarks.newcomer.world import Concealed

LAWS: Mapping[str, Concealed] = {**MECHANICS, **GUIDES, **DRIVES, **CUTS}
