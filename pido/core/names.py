"""File names, and lines on a terminal, from what people chose to write: a part may be called anything, a path may not
leave its folder, nor a reason its line."""

import unicodedata
from urllib.parse import quote

LONGEST = 200
"""Characters of a name as a file name, so that what is put before and after it fits into the 255 of a file system."""


def file_name(identifier: str) -> str:
    """`identifier` as one path component; ordinary names stay as they are.

    >>> file_name("IMP 01"), file_name("../p01"), file_name("a/b")
    ('IMP 01', '%2E%2E%2Fp01', 'a%2Fb')
    """
    name = quote(identifier, safe=" ()+,=@")
    return name.replace(".", "%2E") if name.startswith(".") else name


def unusable(identifier: str) -> str:
    """Why this cannot be the name of a part or machine, as words that follow it; empty where it can.

    >>> unusable("IMP 01"), unusable(" "), unusable("a\\nb")
    ('', 'is blank', 'holds a line break or another character without a letter')
    """
    if not identifier.strip():
        return "is blank"
    if any(map(_without_a_letter, identifier)):
        return "holds a line break or another character without a letter"
    if (length := len(file_name(identifier))) > LONGEST:
        return f"is too long: {length} characters as a file name, {LONGEST} at most (one outside ASCII takes several)"
    return ""


def one_line(text: str) -> str:
    """What somebody wrote, as one line that a terminal shows and does not obey.

    >>> print(one_line("worn\\n  approve 3"), one_line("Größe \\x1b[2J"))
    worn\\n  approve 3 Größe \\x1b[2J
    """
    return "".join(letter.encode("unicode_escape").decode() if _without_a_letter(letter) else letter for letter in text)


def _without_a_letter(letter: str) -> bool:
    return unicodedata.category(letter) in {"Cc", "Cs", "Zl", "Zp"}
