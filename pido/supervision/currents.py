"""The currents of a followed part beside those of the machine's stored parts, as an arriving one's are.

In:  rows as they come. Out: StoreError where their unit slipped, as soon as that is sure; at the end, what else is odd.

The comparison is that of `pido.store.sizes`, on the first KEPT_S of the part. A slip of the unit is looked for once all
axes that the stored parts moved have moved here too, for that is what tells it from a single axis' fault.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pido.core.columns import TIME
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.store import Store
from pido.store.sizes import COLUMNS, sizes

LEAST_S = 10.0
"""Of a part, before its currents say how large they are."""
KEPT_S = 600.0


class Followed:
    """One part on its way."""

    def __init__(self, store: Store, part: str, machine: str) -> None:
        self._store, self._part = store, PartInfo(part=part, machine=machine)
        self._axes = {axis for found in store.newest_sizes(machine).values() for axis in found}
        self._rows: list[dict[str, np.ndarray]] = []
        self._looked = not self._axes

    def push(self, rows: Mapping[str, np.ndarray]) -> None:
        """Raises StoreError where the currents are in another unit than those of the machine's stored parts."""
        if not self._axes or (self._rows and rows[TIME][-1] - self._rows[0][TIME][0] > KEPT_S):
            return
        self._rows.append({name: np.asarray(rows[name], float) for name in (TIME, *COLUMNS) if name in rows})
        if self._looked or self._rows[-1][TIME][-1] - self._rows[0][TIME][0] < LEAST_S:
            return
        so_far = self._so_far()
        if sizes(so_far).keys() >= self._axes:
            self._looked = True
            self._store.beside_stored(so_far)

    def end(self) -> str:
        """What is odd about the currents, '' where nothing is. Raises StoreError as `push`, also after a short part."""
        return self._store.beside_stored(self._so_far()) if self._rows else ""

    def _so_far(self) -> Recording:
        joined = {name: np.concatenate([rows[name] for rows in self._rows]) for name in self._rows[0]}
        return Recording(self._part, joined)
