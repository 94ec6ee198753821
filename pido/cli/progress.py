"""A progress bar on stderr that is silent when nobody watches."""

from __future__ import annotations

import sys
from types import TracebackType

from tqdm import tqdm


class Progress:
    """Call it with (done, total, what); use it as a context."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._bar: tqdm | None = None

    def __enter__(self) -> Progress:
        self._bar = tqdm(desc=self._label, total=0, disable=not sys.stderr.isatty(), leave=False, file=sys.stderr)
        return self

    def __call__(self, done: int, total: int, what: str = "") -> None:
        if self._bar is not None:
            self._bar.total = total
            self._bar.n = done
            self._bar.set_postfix_str(what)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()
