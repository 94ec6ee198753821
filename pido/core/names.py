"""File names from identifiers that people chose: a part may be called anything, a path may not leave its folder."""

from urllib.parse import quote


def file_name(identifier: str) -> str:
    """`identifier` as one path component; ordinary names stay as they are.

    >>> file_name("IMP 01"), file_name("../p01"), file_name("a/b")
    ('IMP 01', '%2E%2E%2Fp01', 'a%2Fb')
    """
    name = quote(identifier, safe=" ()+,=@")
    return name.replace(".", "%2E") if name.startswith(".") else name
