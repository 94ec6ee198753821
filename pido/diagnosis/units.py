"""The unit of each parameter of a finding, where it depends on the form that was chosen or on the axis.

In:  a mechanism, its shape, the axis. Out: one unit per parameter: a reader of a diagnosis has only that.
"""

from __future__ import annotations

from collections.abc import Mapping

from pido.diagnosis.mechanisms.base import Mechanism


def units(mechanism: Mechanism, shape: Mapping[str, float], axis: str) -> dict[str, str]:
    """Name of a parameter -> its unit, for those of which the catalogue names several.

    >>> from pido.diagnosis.mechanisms.drive import Backlash
    >>> units(Backlash(), {"gap": 0.4, "edge": 1.0, "per": 1.0}, "x")
    {'gap': 's'}
    """
    choice = {name: round(value) for name, value in shape.items()}
    force, speed = ("N·m", "deg/s") if axis == "sp" else ("N", "mm/s")
    match mechanism.id:
        case "gravity_load":
            return {"G": ("A", "A/kg")[choice["by_tool"]]}
        case "backlash":
            return {"gap": ("mm", "s")[choice["per"]]}
        case "axis_coupling":
            return {"k": ("A/(mm/s²)", "A/(mm/s)", "A")[choice["source"] % 3]}
        case "edge_force":
            lever = axis == "sp" and choice["along"] == 2
            return {"K_e": ("A", "A/mm", "A/mm²")[(choice["length"] > 0) + lever]}
        case "tool_wear":
            used = ("cm³", "min")[choice["by"]] + (f"^{shape['power']:.3g}" if choice.get("grows") else "")
            per = (force, "", "", "N·m")[choice["of"]]
            return {"W": f"A/({used}·{per})" if per else f"A/{used}"}
        case "material_hard_zone":
            return {"H": "A/(N·m)" if axis == "sp" else "A/N"}
        case "thermal_drift":
            return {"T": ("A", "A", f"A/({speed})")[choice["along"]]}
        case "current_saturation":
            return {"s": ("–", "1/A", "1/A²", "–", "1/A")[choice["form"]]}
        case _:
            return {}
