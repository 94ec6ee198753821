"""What an operator calls each mechanism and each figure: identifiers in plain words."""

import re

MECHANISMS = {
    "coulomb_friction": "constant friction against the motion",
    "viscous_friction": "friction that grows with speed",
    "stribeck_friction": "friction that rises as the axis slows down",
    "standstill_friction": "friction that the axis goes on holding while it stands still",
    "friction_asymmetry": "friction that differs between the two directions",
    "load_dependent_friction": "guideway friction that grows with the process load",
    "position_dependent_friction": "friction that varies along the travel",
    "presliding_hysteresis": "friction that builds up over a short distance after each reversal",
    "backlash": "a transient after each reversal while lost motion is taken up",
    "inertia": "force needed to accelerate the axis",
    "gravity_load": "weight that the axis carries",
    "axis_coupling": "a reaction to another axis' motion",
    "torque_ripple": "a current that repeats along the axis position",
    "cutting_force": "the process force while cutting",
    "edge_force": "rubbing of the engaged cutting edge, however thin the chip",
    "tool_wear": "cutting load that grows as the tool wears",
    "material_hard_zone": "a region of the workpiece that cuts differently",
    "coolant_load": "a load while coolant is on",
    "spindle_viscous_drag": "spindle drag that grows with its speed",
    "spindle_windage": "spindle drag that grows with the square of its speed",
    "spindle_inertia": "torque needed to accelerate the spindle",
    "spindle_torque_load": "cutting torque on the spindle",
    "thermal_drift": "a load or a friction that settles as the machine warms up or cools down",
    "current_saturation": "a current that is no longer proportional to torque",
    "external_force": "a force over separate stretches of time, tied to nothing that was measured",
    "time_misalignment": "recording and simulation are shifted in time",
    "sensor_gain": "the measured current is scaled",
    "sensor_offset": "the measured current is shifted by a constant",
    "sensor_clipping": "the measured current is limited",
    "input_fault": "a motion signal that the simulation used is wrong",
    "unknown": "a systematic mismatch that no known mechanism explains",
}


OF_A_RUN = {
    "duration_s": "duration, s",
    "in_cut_s": "time in cut, s",
    "removed_mm3": "removed, mm³",
    "largest_mrr_mm3_s": "largest removal rate, mm³/s",
    "median_ar_mm2": "median engaged area AR, mm²",
    "largest_f_sp_n": "largest cutting force, N",
    "largest_m_sp_nm": "largest spindle torque, N·m",
    "share_of_the_part_in_known_bins": "share of the part in known bins",
    "pia_would_generate": "PiA would generate in them",
    "pie_would_generate": "PiE would generate in them",
    "would_generate_in_other_bins": "in other bins, between recorded rows",
}
"""Figures of a simulated run and of a plan, with their units."""


def of_a_run(key: str) -> str:
    """A figure's key as a person reads it.

    >>> of_a_run("removed_mm3"), of_a_run("relevant_bins")
    ('removed, mm³', 'relevant bins')
    """
    return OF_A_RUN.get(key, key.replace("_", " "))


def shortened(name: str, most: int = 24) -> str:
    """A name as the title of a plot can show it, its beginning and its end: names of one series differ at either.

    >>> shortened("p01"), shortened("gearbox cover, batch 2024-11, part 0017")
    ('p01', 'gearbox cov…1, part 0017')
    """
    return name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-most // 2 :]}"


_SAID_ALREADY = re.compile(
    r"whenever the (\w+ axis|spindle) moves, against its direction"
    r"|in motion of the (\w+ axis|spindle), more at higher feed"
    r"|at standstill, (?=with the sign)"
    r"|friction differs between \+ and - direction"
    r"|in motion, friction changes along the travel"
    r"|while the (\w+ axis speeds up or slows down|spindle runs up or down)"
    r"|while the spindle turns, (in proportion to|with the square of) its speed"
    r"|while cutting, in proportion to the (process force|cutting torque)"
    r"|whenever the tool is engaged, however thin the chip"
    r"|while cutting, growing with what the tool has cut"
    r"|while coolant is on"
    r"|at all times, in proportion to the whole current"
    r"|over single intervals of time"
    r"|for \S+ s every \S+ s (?=on the machine|from the start)"
    r"|(a load|friction( that goes with the speed)?) (falls|grows|fades|builds up) (?=by |with )"
)
"""Of where a mechanism acts, what its plain words have said."""


def beside_its_words(where: str, words: str) -> str:
    """What is left to say of where a mechanism acts, beside its axis and its plain words; '' where that is nothing.

    >>> beside_its_words("y axis, while coolant is on", "a load while coolant is on")
    ''
    >>> beside_its_words("y axis, over single intervals of time; it comes again every 40 s", "a force over stretches")
    'it comes again every 40 s'
    >>> beside_its_words("z axis, for 8 s every 40 s on the machine's clock", "a force every 40 s for 8 s")
    "on the machine's clock"
    >>> beside_its_words("x axis in motion: more friction while it cuts", "more friction while it cuts")
    ''
    """
    where = re.sub(r"^([xyz] axis|spindle)(, | in motion: |: | (?=in motion))", "", where)
    phrases = [phrase.strip(" ,:") for phrase in _SAID_ALREADY.sub("", where).split("; ")]
    return "; ".join(phrase for phrase in phrases if phrase not in words)


def in_words(mechanism: str) -> str:
    """Plain words for a mechanism's identifier.

    >>> in_words("miscalibrated:inertia")
    'a wrong coefficient for: force needed to accelerate the axis'
    """
    head, _, inner = mechanism.partition(":")
    if head == "miscalibrated":
        return f"a wrong coefficient for: {in_words(inner)}"
    return MECHANISMS.get(mechanism, mechanism)
