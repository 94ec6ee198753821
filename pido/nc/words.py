"""The words that are understood, and the words that change nothing about path, feed, spindle, tool or coolant.

A word that stands in none of these tables is an error, never skipped.
Source: SINUMERIK 840D sl "Fundamentals" (table of G functions), ISO 6983 / Fanuc-like use of G73, G81-G89, G98, G99.
"""

from __future__ import annotations

MOTION_G = frozenset({0, 1, 2, 3, 33, 63, 331, 332})
ISO_CYCLES_G = frozenset({73, 81, 82, 83, 85, 86, 89})
OFFSETS_G = frozenset({54, 55, 56, 57, 500, *range(505, 600)})
SMOOTHING_G = frozenset({64, 641, 642, 643, 644, 645})
UNITS_G = {
    **dict.fromkeys((20, 700), (25.4, 25.4)),
    70: (25.4, 1.0),
    **dict.fromkeys((21, 71, 710), (1.0, 1.0)),
}
"""mm per programmed unit, of lengths and of the F words that follow: feedrates are not influenced by G70 and G71."""
FEED_G = frozenset({93, 94, 95})
SPINDLE_G = frozenset({96, 97, 961, 962, 971, 972, 973})
NEUTRAL_G = frozenset(
    {43, 44, 49, 50, 51, 290, 291, 450, 451, 460, 461, 462, 601, 602, 603, 621, 810, 811, 820, 821}
    - {50, 51}  # ISO scaling changes the path
)  # tool length (positions are those of the tool's tip), language mode, exact-stop windows, corner deceleration
KNOWN_G = (
    MOTION_G | ISO_CYCLES_G | OFFSETS_G | SMOOTHING_G | frozenset(UNITS_G) | FEED_G | SPINDLE_G | NEUTRAL_G
    | {4, 9, 17, 18, 19, 25, 26, 28, 40, 41, 42, 53, 58, 59, 60, 61, 74, 80, 90, 91, 98, 99, 110, 111, 112, 153}
)  # fmt: skip

STOPS_M = frozenset({0, 1})
ENDS_M = frozenset({2, 17, 30, 99})
SPINDLE_M = {3: 1.0, 4: -1.0, 5: 0.0, 19: 0.0, 13: 1.0, 14: -1.0}
COOLANT_M = {7: True, 8: True, 9: False, 13: True, 14: True}
NEUTRAL_M = frozenset({*range(40, 46), 10, 11, 48, 49})  # gear stages, clamps, override switches
KNOWN_M = STOPS_M | ENDS_M | frozenset(SPINDLE_M) | frozenset(COOLANT_M) | NEUTRAL_M | {6, 98}

LINEAR = ("X", "Y", "Z")
ROTARY = ("A", "B", "C")
ADDRESSES = frozenset("XYZIJKFSTDHABCLMPRQ") | {"O", "E"}
NAMED_ADDRESSES = frozenset(
    {"CR", "AR", "TURN", "I1", "J1", "K1", "ADIS", "ADISPOS", "RND", "RNDM", "CHF", "CHR", "FRC", "FRCM"}
    | {"RPL", "AP", "RP", "S1", "M1", "SPOS", "LIMS", "OVR", "DISR", "DISCL", "OFFN", "SF", "CTOL", "OTOL", "SVC", "P"}
    | {"DISC", "PUTFTOC", "ACC"}
)
NEUTRAL_ASSIGNED = frozenset({"LIMS", "CTOL", "OTOL", "ACC", "DISC", "ADISPOS", "DISR", "DISCL"})

FRAME_NAMES = frozenset({"TRANS", "ATRANS", "ROT", "AROT", "SCALE", "ASCALE", "MIRROR", "AMIRROR"})
MOTION_NAMES = frozenset({"CIP", "CT"})
NEUTRAL_NAMES = frozenset(
    {"SOFT", "SOFTA", "BRISK", "BRISKA", "DRIVE", "FFWON", "FFWOF", "NORM", "KONT", "KONTC", "KONTT", "STOPRE"}
    | {"CFC", "CFTCP", "CFIN", "COMPON", "COMPOF", "COMPCURV", "COMPCAD", "COMPSURF", "CDON", "CDOF", "CDOF2"}
    | {"DYNNORM", "DYNPOS", "DYNROUGH", "DYNSEMIFIN", "DYNFINISH", "DYNPREC", "UPATH", "SPATH", "FNORM", "FLIN"}
    | {"WALIMON", "WALIMOF", "TRAFOOF", "DIAMOF", "ORIWKS", "ORIMKS", "ORIAXES", "CPRECON", "CPRECOF", "OST", "OSOF"}
    | {"FIFOCTRL", "STARTFIFO", "STOPFIFO", "DISPLOF", "DISPLON", "SBLOF", "SBLON", "SAVE", "RTLION", "RTLIOF"}
)
NEUTRAL_CALLS = frozenset(
    {"MSG", "FGROUP", "SETMS", "CYCLE832", "GROUP_BEGIN", "GROUP_END", "GROUP_ADDEND", "WORKPIECE", "STOPRE"}
    | {"F_HEAD", "E_HEAD", "F_END", "E_END", "SOFT", "BRISK", "WAITM", "CLEARM", "SETPIECE"}
)
COMMANDS = FRAME_NAMES | MOTION_NAMES | NEUTRAL_NAMES | {"SUPA", "MCALL", "CALL", "ENDLABEL", "SPCON", "SPCOF"}
SYSTEM_VARIABLES = frozenset({"$AA_IW", "$AA_IM", "$P_EP", "$P_TOOLR", "$P_UIFR", "$P_TOOLNO", "$P_F", "$P_S", "$PI"})
