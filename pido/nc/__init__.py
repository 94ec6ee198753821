"""2a: NC program (SINUMERIK dialect, plain ISO) -> toolpath."""

from pido.nc.interpreter import interpret
from pido.nc.toolpath import ARC, DWELL, FEED, KINDS, RAPID, Toolpath

__all__ = ["ARC", "DWELL", "FEED", "KINDS", "RAPID", "Toolpath", "interpret"]
