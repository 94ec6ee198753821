"""File names from identifiers that people chose: a part may be called anything, a path may not leave its folder."""

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
    if any(unicodedata.category(letter) in {"Cc", "Cs", "Zl", "Zp"} for letter in identifier):
        return "holds a line break or another character without a letter"
    if (length := len(file_name(identifier))) > LONGEST:
        return f"is too long: {length} characters as a file name, {LONGEST} at most (one outside ASCII takes several)"
    return ""
