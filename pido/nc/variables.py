"""Variables of an NC program: DEF, arrays, R parameters, and the system variables that can be written.

In:  names and indices as they stand in the program, values of expressions. Out: values.
"""

from __future__ import annotations

import math
from typing import Any, Protocol


class Shared(Protocol):
    """What the variables of one call share with all others."""

    r: dict[int, float]

    def system(self, name: str, index: tuple[Any, ...]) -> Any: ...
    def set_offset(self, number: float, axis: str, value: float) -> None: ...


class Scope:
    """Variables of one program call; R parameters are shared by all."""

    def __init__(self, run: Shared) -> None:
        self.run = run
        self.local: dict[str, Any] = {}
        self.kinds: dict[str, str] = {}

    def value(self, name: str, index: tuple[Any, ...]) -> Any:
        if name in self.local:
            held = self.local[name]
            return held.get(_index(index), 0.0) if isinstance(held, dict) else held
        if name[0] == "R" and (name[1:].isdigit() or name == "R"):
            return self.run.r.get(int(name[1:]) if name != "R" else int(index[0]), 0.0)
        return self.run.system(name, index)

    def set(self, name: str, index: tuple[Any, ...], value: Any) -> bool:
        """False where `name` is no variable."""
        if name in self.local:
            kind = self.kinds[name]
            if index or isinstance(value, list):
                array = dict(self.local[name]) if isinstance(self.local[name], dict) else {}
                if isinstance(value, list):
                    array |= {(i,): typed(kind, v) for i, v in enumerate(value)}
                else:
                    array[_index(index)] = typed(kind, value)
                self.local[name] = array
            else:
                self.local[name] = typed(kind, value)
            return True
        if name == "R" or (name[0] == "R" and name[1:].isdigit()):
            self.run.r[int(name[1:]) if name != "R" else int(index[0])] = float(value)
            return True
        if name == "$P_UIFR":
            self.run.set_offset(float(index[0]), str(index[1]), float(value))
            return True
        return False


def _index(index: tuple[Any, ...]) -> tuple[int, ...]:
    return tuple(int(i) for i in index)


def typed(kind: str, value: Any) -> Any:
    """`value` as a variable of this kind holds it; INT rounds."""
    if kind == "INT":
        return float(math.floor(value + 0.5))
    if kind == "BOOL":
        return bool(value)
    return float(value) if kind == "REAL" else value
