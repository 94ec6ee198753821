"""The time that logs carry: UTC, ISO 8601, whole seconds."""

from __future__ import annotations

from datetime import UTC, datetime


def utc_now() -> str:
    """Now, as every log of a workspace writes it."""
    return utc(datetime.now(UTC).timestamp())


def utc(seconds: float) -> str:
    """A moment, s since 1970.

    >>> utc(0.0)
    '1970-01-01T00:00:00+00:00'
    """
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")
