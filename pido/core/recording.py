"""One part's samples, in the contract's columns, with what the plant knows about the part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from pido.core.arrays import Array1D, Float1D
from pido.core.columns import TIME
from pido.core.errors import RecordingError
from pido.core.part import PartInfo


def usual_step(time: Float1D) -> float:
    """Median of the steps forward, s; 0 where time nowhere advances."""
    step = np.diff(time)
    forward = step[step > 0]
    return float(np.median(forward)) if len(forward) else 0.0


@dataclass(frozen=True)
class Recording:
    """Samples of one part. Numeric columns are float64 (n,); a missing value is NaN and stays NaN.

    `tool_id` may hold text. `notes` is what a reader did or found on the way (one sentence each): units converted,
    packets put in order, columns that were not there. `judged` is what was found about these very samples, which never
    change: it goes where the recording goes, into another process too, and a changed copy begins without.
    """

    part: PartInfo
    columns: Mapping[str, Array1D]
    notes: tuple[str, ...] = field(default=())
    judged: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if TIME not in self.columns:
            raise RecordingError(f"part {self.part.part}: column 'time' is missing; it is needed in every recording.")
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise RecordingError(f"part {self.part.part}: columns have different lengths: {lengths}.")
        object.__setattr__(self, "columns", MappingProxyType(dict(self.columns)))

    def __getstate__(self) -> dict[str, Any]:
        """What goes into another process, where a read-only view of a mapping cannot."""
        return {**self.__dict__, "columns": dict(self.columns)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, columns=MappingProxyType(state["columns"]))

    def __len__(self) -> int:
        return len(self.columns[TIME])

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Array1D:
        try:
            return self.columns[name]
        except KeyError:
            raise RecordingError(
                f"part {self.part.part}: column '{name}' is missing; it has {', '.join(self.columns)}."
            ) from None

    @property
    def time(self) -> Float1D:
        """(n,), s, from the recording's first sample."""
        return self.columns[TIME]

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second: the reciprocal of the usual step. Raises RecordingError where no time goes by."""
        if (step := usual_step(self.time)) == 0:
            raise RecordingError(
                f"part {self.part.part}: no time goes by in its {len(self)} sample(s); a rate needs at least two. "
                "Export the recording again with its time in s."
            )
        return 1.0 / step

    def with_columns(self, **columns: Array1D) -> Recording:
        """The same recording with columns added or replaced."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, which: slice | Array1D) -> Recording:
        """The samples that `which` (slice, mask or indices) selects; time is kept as it is."""
        return replace(self, columns={name: values[which] for name, values in self.columns.items()})
