"""Fitted equations, and what they rest on, as bytes and back, bit for bit: one .npz file, no pickle.

In:  `AxisEquations` or `Adaptation`. Out: bytes, and back. The same values give the same bytes.

The file holds plain arrays and a header that says which of a closed list of value classes they are fields of. The
machine and accepted physics (extra terms) are not in it: they are given when it is read, and must be those of the fit.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.equations.choose import AxisEquations, Candidate, Choice
from pido.equations.fit import GlobalEquation, LocalEquations
from pido.equations.terms import CONSTANT, ExtraTerm, TermSet, term_set
from pido.equations.weights import Kernel
from pido.feature_space.grid import Grid
from pido.feature_space.regional import HeldOut
from pido.sampling.method import Adaptation
from pido.sampling.shares import SHARES, ShareRule
from pido.sampling.trust import Spacing, Trust

Extras = Sequence[tuple[ExtraTerm, int]]
_VALUES = (
    AxisEquations,
    LocalEquations,
    GlobalEquation,
    Adaptation,
    Choice,
    Candidate,
    Kernel,
    Grid,
    HeldOut,
    ShareRule,
    Spacing,
    Trust,
)
_CLASSES: dict[str, Any] = {c.__name__: c for c in _VALUES}


def dump(value: AxisEquations | Adaptation) -> bytes:
    """All of it; a value that several fields share is written once and shared again when it is read."""
    arrays: list[np.ndarray] = []
    seen: dict[int, int] = {}

    def encode(item: Any) -> Any:
        if item is None or isinstance(item, bool | int | float | str):
            return item
        if isinstance(item, np.generic):
            return encode(item.item())
        if id(item) in seen:
            return {"again": seen[id(item)]}
        number = seen[id(item)] = len(seen)
        if isinstance(item, np.ndarray):
            arrays.append(np.ascontiguousarray(item))
            return {"n": number, "array": len(arrays) - 1}
        if isinstance(item, tuple | list):
            return {"n": number, "tuple": [encode(i) for i in item]}
        if isinstance(item, dict):
            return {"n": number, "dict": [[encode(k), encode(v)] for k, v in item.items()]}
        if callable(item) and item in SHARES.values():
            return {"n": number, "share": next(name for name, share in SHARES.items() if share is item)}
        if isinstance(item, TermSet):
            return {"n": number, "terms": item.id, "names": list(item.names)}
        if isinstance(item, Machine):
            return {"n": number, "machine": item.id}
        if is_dataclass(item) and type(item).__name__ in _CLASSES:
            return {"n": number, "class": type(item).__name__,
                    "fields": {f.name: encode(getattr(item, f.name)) for f in fields(item)}}  # fmt: skip
        raise FitError(f"a {type(item).__name__} has no place in a file of equations.")

    header = np.frombuffer(json.dumps(encode(value)).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, header=header, **{f"array_{k}": array for k, array in enumerate(arrays)})  # type: ignore[arg-type]
    return buffer.getvalue()


def load(data: bytes, machine: Machine, extras: Extras = ()) -> Any:
    """The value in `data`. FitError if it was fitted for another machine or with other terms."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    seen: dict[int, Any] = {}

    def decode(item: Any) -> Any:
        if not isinstance(item, dict):
            return item
        if "again" in item:
            return seen[item["again"]]
        if "array" in item:
            value = arrays[f"array_{item['array']}"]
        elif "tuple" in item:
            value = tuple(decode(i) for i in item["tuple"])
        elif "dict" in item:
            value = {decode(k): decode(v) for k, v in item["dict"]}
        elif "share" in item:
            value = SHARES[item["share"]]
        elif "terms" in item:
            value = _terms(item["terms"], item["names"], extras)
        elif "machine" in item:
            if item["machine"] != machine.id:
                raise FitError(f"these equations are of machine '{item['machine']}', not of '{machine.id}'.")
            value = machine
        else:
            value = _CLASSES[item["class"]](**{name: decode(i) for name, i in item["fields"].items()})
        seen[item["n"]] = value
        return value

    return decode(json.loads(arrays["header"].tobytes()))


def _terms(name: str, names: list[str], extras: Extras) -> TermSet:
    base, *added = name.split("+")
    terms = CONSTANT if base == CONSTANT.id else term_set(base)
    known = {term.name: (term, size) for term, size in extras}
    for more in added:
        if more not in known:
            raise FitError(f"the equation was fitted with '{more}', which is not among the accepted physics given.")
        terms = terms.extended(*known[more])
    if list(terms.names) != names:
        raise FitError(f"these equations have the terms {', '.join(names)}; here '{name}' is {', '.join(terms.names)}.")
    return terms
