"""2a: NC program (SINUMERIK dialect, plain ISO) -> toolpath.

Understood: G0-G3, CIP, CT, I/J/K (also AC), CR=, R, AR=, TURN=; G17-G19; G40-G42; G53-G57, G500, G505-G599, SUPA,
G58, G59, $P_UIFR; G90/G91, AC(), IC(); G93-G97; G60, G61, G9, G64, G641-G645 with ADIS; G4; G70/G71/G700/G710,
G20/G21; polar AP=, RP=, G110-G112; T, M6, D; M0-M9, M13, M14, M17, M19, M30, M98, M99; R parameters, DEF, arrays,
expressions; IF, CASE, WHILE, FOR, LOOP, REPEAT, GOTO; subprograms with parameters; TRANS, ROT, SCALE, MIRROR and
their additive forms; CYCLE81-CYCLE89, CYCLE840, POCKET3, POCKET4, HOLES1, HOLES2, MCALL; G73, G81-G89. The tables
are in `pido.nc.words`.

Refused, with line and text: RND=, CHF=, rotary axes that leave zero, CYCLE800 that turns the plane, splines,
macros (#), and every word that is not in a table. A machine's own words that change nothing are named in
`neutral`.
"""

from pido.nc.interpreter import interpret
from pido.nc.toolpath import ARC, DWELL, FEED, KINDS, RAPID, Toolpath

__all__ = ["ARC", "DWELL", "FEED", "KINDS", "RAPID", "Toolpath", "interpret"]
