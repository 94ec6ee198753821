"""The time that logs carry: UTC, ISO 8601, whole seconds."""

from __future__ import annotations

from datetime import UTC, datetime


def utc_now() -> str:
    """Now, as every log of a workspace writes it."""
    return datetime.now(UTC).isoformat(timespec="seconds")
