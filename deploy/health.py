"""Is a service well? Exit code 0 or 1: for an address, whether it answers; for a file, whether it is fresh.

Worker and watcher have no address: they touch a file at least every 30 s while they do their work.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from flows.server import answers

FRESH_S = 120.0


def well(what: str) -> bool:
    """Whether the address answers, or the file was touched within the last two minutes."""
    if what.startswith("http"):
        return answers(what)
    path = Path(what)
    return path.exists() and time.time() - path.stat().st_mtime < FRESH_S


if __name__ == "__main__":
    sys.exit(0 if well(sys.argv[1]) else 1)
