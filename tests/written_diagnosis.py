"""A diagnosis of one finding, written as the contract has it, for tests of what is done with one."""

import json


def term_of(mechanism, shape, amplitudes=1, gates=()):
    """A term as model.json has it."""
    about = {"id": mechanism.removeprefix("miscalibrated:")}
    return {"name": mechanism, "mechanism": about, "shape": shape, "gates": [*gates], "amplitudes": [0.3] * amplitudes}


def diagnosis(
    folder, mechanism="stribeck_friction", kind="missing_physics", shape=None, axis="x", gates=(), amplitudes=1, **more
):
    """A diagnosis of one finding, written as the contract has it. more : of model.json"""
    folder.mkdir(exist_ok=True, parents=True)
    finding = {"axis": axis, "mechanism": mechanism, "kind": kind, "equation": "dI = ..."}
    term = term_of(mechanism, {"v_s": 2.0, "delta": 2.0} if shape is None else shape, amplitudes, gates)
    about = {"noise_level": 0.05, "delay": [0.0, 0.0], "limits": {}, "equation": None, "terms": [term]}
    (folder / "diagnosis.json").write_text(json.dumps({"schema": "pido.diagnosis/1", "findings": [finding]}))
    (folder / "model.json").write_text(json.dumps({"schema": "pido.diagnosis.model/1", "axes": {axis: about}, **more}))
    return folder
