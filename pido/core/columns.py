"""Column names and units of a recording: the contract, letter for letter (one row per sample, one file per part)."""

from pido.core.axes import AXES, LINEAR_AXES

TIME = "time"
CURRENT = {axis: f"curr_{axis}" for axis in AXES}
CURRENT_SIM = {axis: f"curr_{axis}_sim" for axis in AXES}
POSITION = {axis: f"pos_{axis}" for axis in AXES}
VELOCITY = {axis: f"v_{axis}" for axis in AXES}
ACCELERATION = {axis: f"a_{axis}" for axis in AXES}
FORCE_SIM = {axis: f"f_{axis}_sim" for axis in AXES}

MOTION = tuple(c[a] for c in (POSITION, VELOCITY, ACCELERATION) for a in AXES)
PROCESS = (*FORCE_SIM.values(), "m_sp_sim", "mrr_sim")
OPTIONAL = (*CURRENT_SIM.values(), "nc_line", "tool_id", "coolant")

UNITS: dict[str, str] = {
    TIME: "s",
    **{POSITION[a]: "mm" for a in LINEAR_AXES},
    **{VELOCITY[a]: "mm/s" for a in LINEAR_AXES},
    **{ACCELERATION[a]: "mm/s²" for a in LINEAR_AXES},
    "pos_sp": "deg",
    "v_sp": "deg/s",
    "a_sp": "deg/s²",
    **{c: "A" for c in (*CURRENT.values(), *CURRENT_SIM.values())},
    **{c: "N" for c in FORCE_SIM.values()},
    "m_sp_sim": "N·m",
    "mrr_sim": "mm³/s",
    "nc_line": "–",
    "tool_id": "–",
    "coolant": "–",
}

INPUTS = (
    "v_x", "v_y", "v_z", "a_x", "a_y", "a_z", "v_sp", "a_sp",
    "f_x_sim", "f_y_sim", "f_z_sim", "m_sp_sim", "mrr_sim",
)  # fmt: skip
"""The 13 entries of the input vector In (paper, eq. 4), in its order."""

ALIASES = {
    "materialremoved_sim": "mrr_sim",
    "materialremoved": "mrr_sim",
    "f_x": "f_x_sim",
    "f_y": "f_y_sim",
    "f_z": "f_z_sim",
    "f_sp": "f_sp_sim",
    "m_sp": "m_sp_sim",
}
"""Names in the published data sets, and the column that each is."""
