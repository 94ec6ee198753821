"""Parts on disk: append-only, content-addressed, seen once."""

from pido.store.store import Entry, Store

__all__ = ["Entry", "Store"]
