"""The real rows that an iteration works on: of all its parts, from files, never more than the settings allow.

In:  a workspace, digests of parts in production order, a limit. Out: `Samples`, the same for the same set of parts.

Below the limit: every row. Above it: bins with too many rows are thinned (`pido.sampling.thin`). What was kept is
written beside the derived rows, so that the next part is added to it and the parts before are not read again.

    derived/<part>-<settings>.parquet      rows of a part              (pido.parts)
    derived/<part>-<settings>.bins.npz     how many of them in which bin
    derived/kept-<key>.parquet, .json      rows kept for a set of parts; which set, and its rows per bin
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pido.core.files import write_atomically
from pido.core.samples import Samples
from pido.feature_space.grid import Grid
from pido.files.samples import load_samples, save_samples
from pido.parts import recipe_of, samples_of
from pido.sampling.thin import BinCounts, kept
from pido.workspace import Workspace, code_version, digest_of

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rows:
    """Rows of parts under one state of the settings.

    folder : where counts and kept rows are written
    state : all that decides the rows of a part beside the part itself, as a digest
    load : digest of a part -> its rows
    """

    folder: Path
    state: str
    grid: Grid
    load: Callable[[str], Samples]

    def of(self, parts: Sequence[str], limit: int) -> Samples:
        """At most about `limit` rows of `parts`, in the order of `parts` and of their rows."""
        place = self._place(parts, limit)
        if place.exists() and place.with_suffix(".json").exists():
            os.utime(place)
            return _ordered(load_samples(place), parts)
        known, before, kept_before = self._nearest(set(parts), limit)
        fresh = [part for part in parts if part not in known]
        counts = BinCounts.sum([before, *(self.counts(part) for part in fresh)])
        if counts.rows <= limit:
            return Samples.concat([self.load(part) for part in parts])
        log.info("%d rows in %d parts, limit %d: %d part(s) to read", counts.rows, len(parts), limit, len(fresh))
        pieces = [] if kept_before is None else [self._thinned(load_samples(kept_before), counts, limit)]
        pieces += [self._thinned(self.load(part), counts, limit) for part in fresh]
        rows = _ordered(Samples.concat(pieces), parts)
        save_samples(rows, place)
        about = {"parts": sorted(parts), "bins": counts.bins.tolist(), "count": counts.count.tolist()}
        write_atomically(place.with_suffix(".json"), json.dumps(about))
        self._tidy(place)
        return rows

    def _thinned(self, rows: Samples, counts: BinCounts, limit: int) -> Samples:
        return rows.take(kept(rows, counts, limit, self.grid))

    def counts(self, part: str) -> BinCounts:
        """Rows per bin of one part."""
        place = self.folder / f"{part[:24]}-{digest_of([self.state, self.grid.width])[:12]}.bins.npz"
        if not place.exists():
            found = BinCounts.of(self.load(part).reduced, self.grid)
            place.parent.mkdir(parents=True, exist_ok=True)
            temporary = place.with_name(f".{os.getpid()}.{place.name}")
            np.savez(temporary, bins=found.bins, count=found.count)
            temporary.replace(place)
            return found
        with np.load(place, allow_pickle=False) as stored:
            return BinCounts(stored["bins"], stored["count"])

    def _place(self, parts: Sequence[str], limit: int) -> Path:
        return self.folder / f"kept-{self._family(limit)}-{digest_of(sorted(parts))[:24]}.parquet"

    def _family(self, limit: int) -> str:
        return digest_of([self.state, self.grid.width, limit])[:12]

    def _nearest(self, parts: set[str], limit: int) -> tuple[set[str], BinCounts, Path | None]:
        """The largest set within `parts` for which rows are kept already, its rows per bin, and where they are."""
        best: tuple[set[str], BinCounts, Path | None] = (set(), BinCounts.sum([]), None)
        for file in sorted(self.folder.glob(f"kept-{self._family(limit)}-*.json")):
            about, place = json.loads(file.read_text(encoding="utf-8")), file.with_suffix(".parquet")
            known = set(about["parts"])
            if known <= parts and len(known) > len(best[0]) and place.exists():
                counts = BinCounts(np.array(about["bins"], np.int64), np.array(about["count"], np.int64))
                best = known, counts, place
        return best

    def _tidy(self, newest: Path, keep: int = 4) -> None:
        """Forget what has not been asked for lately: it can be made again."""
        found = sorted(self.folder.glob("kept-*.parquet"), key=lambda p: p.stat().st_mtime_ns, reverse=True)
        for old in [p for p in found if p != newest][keep:]:
            old.unlink(missing_ok=True)
            old.with_suffix(".json").unlink(missing_ok=True)


def training_rows(workspace: Workspace, machine: str, parts: Sequence[str], limit: int) -> Samples:
    """Real rows of `parts` (digests) of one machine, as the workspace's settings have them now."""
    under = [workspace.settings_digest(machine), code_version(), workspace.excluded(machine)]
    rows = Rows(workspace.derived, digest_of(under), recipe_of(workspace).method.grid, partial(samples_of, workspace))
    return rows.of(parts, limit)


def _ordered(samples: Samples, parts: Sequence[str]) -> Samples:
    """Parts in the order given, rows ascending within each."""
    at = {part: k for k, part in enumerate(parts)}
    names, inverse = np.unique(samples.part.astype(str), return_inverse=True)
    order = np.array([at[name] for name in names], np.int64)
    return samples.take(np.lexsort((samples.row, order[inverse] if len(names) else inverse)))
