"""The catalogue of this edition's laws outside the vocabulary, by name."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.newcomer.second.plain import PLAIN
from benchmarks.newcomer.second.remembered import REMEMBERED
from benchmarks.newcomer.second.shaped import SHAPED
from benchmarks.newcomer.world import Concealed

LAWS: Mapping[str, Concealed] = {**PLAIN, **SHAPED, **REMEMBERED}
