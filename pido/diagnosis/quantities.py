"""What the quantities are called that a current could depend on: by what the signals' names stand for, with units.

In:  text that names signals as formulas do (v_x, |a_sp|, MRR; see `pido.diagnosis.signals`).
Out: the same in words, and what each name of a formula means. Formulas and conditions keep the names.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import NamedTuple

from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import UNITS


class Quantity(NamedTuple):
    """What a signal is: in words, its unit, and as a definition where that says more than the words."""

    words: str
    unit: str
    means: str = ""


_OF_AN_AXIS = {  # {} is the axis, {of} what an operator calls it; s stands for mm, or deg of the spindle
    "v_{}": Quantity("speed of {of}", "s/s"),
    "a_{}": Quantity("acceleration of {of}", "s/s²"),
    "held_{}": Quantity("direction of the last motion of {of}", "–", "direction of the last motion"),
    "speeding_{}": Quantity("speeding up of {of}", "–", "1 while v_{} * a_{} > 0, else 0"),
    "braking_{}": Quantity("slowing down of {of}", "–", "1 while v_{} * a_{} < 0, else 0"),
    "d_{}": Quantity("way of {of} since its last reversal", "s", "way since the last reversal"),
    "way_{}": Quantity("way of {of} since the part began", "s", "way since the part began"),
    "j_{}": Quantity("jerk of {of}", "s/s³", "jerk, da_{}/dt"),
    "t_go_{}": Quantity(
        "time since {of} began to move", "s!", "time since the axis began to move, at most 10 s, 0 at rest"
    ),
    "stood_{}": Quantity("time since {of} stopped", "s!", "time since the axis stopped, at most 10 s, 0 in motion"),
    "rested_{}": Quantity(
        "time that {of} stood before it moved",
        "s!",
        "how long the axis stood before it moved, at most 60 s, 0 at rest",
    ),
    "I_{}": Quantity("simulated current of {of}", "A", "simulated current"),
}
_OF_A_PLACE = {
    "pos_{}": Quantity("position of {of}", "mm"),
    "from_{}": Quantity("way of {of} from where it began", "mm", "pos_{} less where it was as the part began"),
    "f_{}": Quantity("process force along {}", "N", "process force along {}, column f_{}_sim"),
}
_OF_ALL = {
    "way_all": Quantity("way of all linear axes together since the part began", "mm"),
    "I_all": Quantity(
        "simulated currents of all axes together", "A", "simulated currents of all axes together, without their signs"
    ),
    "removed": Quantity("volume removed since the part began", "mm³"),
    "feed": Quantity("speed along the path", "mm/s"),
    "feed_rev": Quantity(
        "feed per revolution of the spindle", "mm", "feed per revolution of the spindle, 0 while it stands"
    ),
    "a_n": Quantity("acceleration across the path", "mm/s²"),
    "kappa": Quantity(
        "curvature of the path", "1/mm", "curvature of the path in the x-y plane, positive to the left, at most 1"
    ),
    "t_block": Quantity("time in the NC block", "s", "time in the NC block, at most 10 s"),
    "t_cut": Quantity("time in this cut", "s", "time in this cut, at most 10 s, 0 outside"),
    "uptime": Quantity("time on the machine's clock", "s", "the machine's clock"),
    "t_part": Quantity("time since the part began", "s"),
    "M_sp": Quantity("cutting torque on the spindle", "N·m", "cutting torque on the spindle, column m_sp_sim"),
    "MRR": Quantity("material removal rate", "mm³/s", "material removal rate, column mrr_sim"),
    "AR": Quantity("engaged area", "mm²", "engaged area, the removal rate over the speed along the path"),
    "coolant": Quantity("coolant", "–"),
    "pos_sp": Quantity("angle of the spindle", "deg"),
    "f_sp": Quantity("tangential force on the spindle", "N", "tangential force on the spindle, column f_sp_sim"),
}
_NO_ARTICLE = ("coolant",)


def _named(axis: str, table: Mapping[str, Quantity]) -> dict[str, Quantity]:
    of, way = ("the spindle", "deg") if axis == "sp" else (f"the {axis} axis", "mm")

    def put(text: str) -> str:
        return text.replace("{of}", of).replace("{}", axis)

    def unit(text: str) -> str:
        return {"s!": "s", "s": way}.get(text) or re.sub(r"^s/", f"{way}/", text)

    return {name.replace("{}", axis): Quantity(put(q.words), unit(q.unit), put(q.means)) for name, q in table.items()}


QUANTITIES: Mapping[str, Quantity] = {
    **{name: q for axis in AXES for name, q in _named(axis, _OF_AN_AXIS).items()},
    **{name: q for axis in LINEAR_AXES for name, q in _named(axis, _OF_A_PLACE).items()},
    **_OF_ALL,
}
"""Every signal by its name."""

_OF_THE_CUT = ("MRR", "AR")  # no columns, and limits of where a law acts
_FORMS = (  # of a name in text; longest first. What is zero or one, and signs, have words of their own
    (r"√\|{u}\|·sgn\({u}\)", "the square root of {said}, with its sign"),
    (r"{u}·\|{u}\|", "the square of {said}, with its sign"),
    (r"√\|{u}\|", "the square root of {said}"),
    (r"sgn\({u}\)", "{sign}"),
    (r"\|{u}\|", "{size}"),
    (r"{u}²", "the square of {said}"),
    (r"{u}³", "the cube of {said}"),
)
_NUMBER = r"-?\d[\d.]*+(?:e[-+]?\d++)?+"  # whole: none of its first digits alone


def in_words(text: str, names: Collection[str]) -> str:
    """`text` with words in place of the signals `names`, and units behind ranges that have none.

    >>> in_words("depending on v_x from -20 to 30 and AR from 0 to 4", ["v_x", "AR"])
    'depending on the speed of the x axis from -20 to 30 mm/s and the engaged area from 0 to 4 mm²'
    >>> in_words("where pos_x from 129.9 to 189.9 mm", ["pos_x"])
    'where the position of the x axis from 129.9 to 189.9 mm'
    >>> in_words("around |v_sp| = 1.8e+04 deg/s", ["v_sp"])
    'where the speed of the spindle, either way, is about 18000 deg/s (3000 rpm)'
    """
    said: list[str] = []  # put in last: words of one signal may be the name of another
    for name in sorted(names, key=len, reverse=True):
        if name in QUANTITIES:
            text = _one_in_words(text, name, said)
    text = re.sub(r"\x00(\d+)\x00", lambda m: said[int(m[1])], text).replace(",,", ",")
    text = re.sub(r"-?\d[\d.]*e\+0[1-5]\b", lambda m: f"{float(m[0]):.6g}", text)
    return re.sub(rf"({_NUMBER}) deg/s(?![²³])", lambda m: f"{m[0]} ({float(m[1]) / 6:.4g} rpm)", text)


def _one_in_words(text: str, name: str, said: list[str]) -> str:
    """`text` with the place in `said`, where its words are added, in place of one signal and its forms."""

    def put(words: str) -> str:
        said.append(words)
        return f"\x00{len(said) - 1}\x00"

    unit, words, moves = QUANTITIES[name].unit, the(name), name.startswith("v_")
    size = f"{words}, either way," if moves or name.startswith("a_") else f"the size of {words}"
    sign = f"the direction of motion of {words.removeprefix('the speed of ')}" if moves else f"the sign of {words}"
    u = rf"(?<![\w|]){re.escape(name)}(?![\w|(])"
    if unit != "–":
        text = re.sub(rf"({u} from {_NUMBER} to {_NUMBER})(?! *{re.escape(unit)})", rf"\1 {unit}", text)
    text = re.sub(rf"turning with {u}", f"turning with {put(sign)}", text)
    text = re.sub(rf"how far from somewhere {u} is", f"how far {put(_whose(name))} is from some place", text)
    text = re.sub(rf"the further {u} is", f"the larger {put(words)} is", text)
    text = re.sub(rf"what {u} lost as heat in some ({_NUMBER}) s", rf"the heat of {put(words)} over some \1 s", text)
    for form, of in (*((f.format(u=re.escape(name)), of) for f, of in _FORMS), (u, "{said}")):
        spoken = put(of.format(said=words, size=size, sign=sign))
        text = re.sub(rf"around {form} = ({_NUMBER})", rf"where {spoken} is about \1", text)
        text = re.sub(rf"{form} > ({_NUMBER})", rf"{spoken} is above \1", text)
        text = re.sub(rf"{form} < ({_NUMBER})", rf"{spoken} is below \1", text)
        text = re.sub(form, spoken, text)
    return text


def _whose(name: str) -> str:
    """What is at a place: the axis of a position."""
    stem, _, axis = name.partition("_")
    return (f"the {axis} axis" if axis != "sp" else "the spindle") if stem in ("pos", "from") else the(name)


def the(name: str) -> str:
    """A signal in words, with its article.

    >>> the("a_sp"), the("coolant"), the("pos_y")
    ('the acceleration of the spindle', 'coolant', 'the position of the y axis')
    """
    words = QUANTITIES[name].words
    return words if name in _NO_ARTICLE else f"the {words}"


def label(name: str) -> str:
    """Of an axis of a plot: words and unit.

    >>> label("v_x"), label("coolant")
    ('speed of the x axis (v_x), mm/s', 'coolant')
    """
    words, unit, _ = QUANTITIES[name]
    return f"{words}{'' if words == name else f' ({name})'}{'' if unit == '–' else f', {unit}'}"


def meanings(text: str) -> list[str]:
    """What the signals in a formula mean that are no columns, in the order of this page.

    >>> meanings("dI = k * a_x * speeding_x")
    ['speeding_x = 1 while v_x * a_x > 0, else 0']
    >>> meanings("dI = k * MRR")
    ['MRR = material removal rate, column mrr_sim, mm³/s']
    """
    return [f"{name} = {_definition(name)}" for name in _in_text(text) if name not in UNITS]


def columns_meant(text: str) -> list[str]:
    """What the columns in a formula are, for one who does not know their names.

    >>> columns_meant("dI_x = k * v_x, only where MRR > 2640")
    ['v_x: speed of the x axis, mm/s', 'MRR: material removal rate, mm³/s']
    >>> columns_meant("dI_x = k * MRR; MRR = material removal rate, column mrr_sim, mm³/s")
    []
    """
    named = [n for n in _in_text(text) if (n in UNITS and n != "coolant") or n in _OF_THE_CUT]
    return [f"{n}: {QUANTITIES[n].words}, {QUANTITIES[n].unit}" for n in named if f"{n} = " not in text]


def _in_text(text: str) -> list[str]:
    return [name for name in QUANTITIES if re.search(rf"\b{name}\b", text)]


def _definition(name: str) -> str:
    words, unit, means = QUANTITIES[name]
    return f"{means or words}{'' if unit == '–' else f', {unit}'}"
