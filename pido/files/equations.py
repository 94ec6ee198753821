"""Fitted equations, and what they rest on, as bytes and back, bit for bit: .npz files with a header, no pickle.

In:  `AxisEquations` or `Judgement`. Out: bytes, and back. The machine and accepted physics (extra terms) are not in a
file: they are given when it is read, and must be those that it was fitted with.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
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
from pido.iteration import Judgement

Extras = Sequence[tuple[ExtraTerm, int]]

_LOCAL = ("bins", "coefficients", "effective", "global_share", "noise", "rank", "locality")
_OVERALL = ("coefficients", "factor", "effective", "noise", "rank")


def dump(equations: AxisEquations) -> bytes:
    """The same equations give the same bytes."""
    arrays: dict[str, np.ndarray] = {"occupied": equations.occupied, "coverage": np.array(equations.coverage.width)}
    sides = {"near": equations.near} | ({} if equations.beyond is equations.near else {"beyond": equations.beyond})
    for side, members in sides.items():
        for k, (axes, member) in enumerate(members):
            arrays[f"{side}_{k}_axes"], arrays[f"{side}_{k}"] = np.array(axes, np.int64), _bytes(_dump_local(member))
    return _pack(arrays)


def load(data: bytes, machine: Machine, extras: Extras = ()) -> AxisEquations:
    """The equations in `data`. FitError if they were fitted for another machine or with other terms."""
    arrays = _unpack(data)

    def side(name: str) -> tuple[tuple[tuple[int, ...], LocalEquations], ...]:
        count = sum(n.startswith(f"{name}_") and n.endswith("_axes") for n in arrays)
        return tuple(
            (tuple(arrays[f"{name}_{k}_axes"].tolist()), _load_local(arrays[f"{name}_{k}"].tobytes(), machine, extras))
            for k in range(count)
        )

    near = side("near")
    return AxisEquations(near, side("beyond") or near, arrays["occupied"], Grid(tuple(arrays["coverage"].tolist())))


def dump_judgement(judgement: Judgement) -> bytes:
    """Choice and held-out errors."""
    choice = judgement.choice
    header = {
        side: [[c.terms.id, asdict(c.kernel)] for c in getattr(choice, side)] for side in ("near", "beyond")
    } | {"tried": list(choice.tried)}  # fmt: skip
    arrays = {"header": _bytes(json.dumps(header).encode()), "scores": choice.scores}
    arrays |= _dump_held_out(choice.held_out, "equation") | _dump_held_out(judgement.model_error, "model")
    return _pack(arrays)


def load_judgement(data: bytes, extras: Extras = ()) -> Judgement:
    """The same, back."""
    arrays = _unpack(data)
    header = json.loads(arrays["header"].tobytes())

    def side(name: str) -> tuple[Candidate, ...]:
        return tuple(Candidate(_term_set(terms, extras), Kernel(**kernel)) for terms, kernel in header[name])

    choice = Choice(
        side("near"), side("beyond"), _load_held_out(arrays, "equation"), arrays["scores"], tuple(header["tried"])
    )
    return Judgement(choice, _load_held_out(arrays, "model"))


def _dump_local(equations: LocalEquations) -> bytes:
    header = {
        "terms": equations.terms.id,
        "names": list(equations.terms.names),
        "grid": list(equations.grid.width),
        "kernels": [asdict(k) for k in equations.kernels],
        "blend": equations.blend,
        "dropped": list(equations.overall.dropped),
        "machine": equations.machine.id,
    }
    arrays = {name: getattr(equations, name) for name in _LOCAL}
    arrays |= {f"overall_{name}": getattr(equations.overall, name) for name in _OVERALL}
    arrays |= {f"factor_{i}": values for i, values in enumerate(equations._factor)}
    arrays["header"] = np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8)
    return _pack(arrays)


def _load_local(data: bytes, machine: Machine, extras: Extras) -> LocalEquations:
    arrays = _unpack(data)
    header = json.loads(arrays["header"].tobytes())
    terms = _terms(header, extras)
    if header["machine"] != machine.id:
        raise FitError(f"these equations are of machine '{header['machine']}', not of '{machine.id}'.")
    overall = {name: arrays[f"overall_{name}"] for name in _OVERALL}
    return LocalEquations(
        terms=terms,
        machine=machine,
        grid=Grid(tuple(header["grid"])),
        kernels=tuple(Kernel(**k) for k in header["kernels"]),
        blend=header["blend"],
        overall=GlobalEquation(terms=terms, machine=machine, dropped=tuple(header["dropped"]), **overall),
        _factor=tuple(arrays[f"factor_{i}"] for i in range(sum(n.startswith("factor_") for n in arrays))),
        **{name: arrays[name] for name in _LOCAL},
    )


def _dump_held_out(errors: HeldOut | None, name: str) -> dict[str, np.ndarray]:
    return {} if errors is None else {f"{name}_{f.name}": getattr(errors, f.name) for f in fields(HeldOut)}


def _load_held_out(arrays: dict[str, np.ndarray], name: str) -> HeldOut | None:
    found = {f.name: arrays[f"{name}_{f.name}"] for f in fields(HeldOut) if f"{name}_{f.name}" in arrays}
    return HeldOut(**found) if found else None


def _pack(arrays: dict[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _unpack(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _bytes(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8)


def _terms(header: dict[str, Any], extras: Extras) -> TermSet:
    terms = _term_set(header["terms"], extras)
    if list(terms.names) != header["names"]:
        raise FitError(
            f"these equations have the terms {', '.join(header['names'])}; give the accepted physics that they were "
            f"fitted with (got {', '.join(terms.names)})."
        )
    return terms


def _term_set(name: str, extras: Extras) -> TermSet:
    base, *added = name.split("+")
    terms = CONSTANT if base == CONSTANT.id else term_set(base)
    known = {term.name: (term, size) for term, size in extras}
    for more in added:
        if more not in known:
            raise FitError(f"the equation was fitted with '{more}', which is not among the accepted physics given.")
        terms = terms.extended(*known[more])
    return terms
