"""What stands on Prefect's pages: text from outside as it is, keys of artifacts, calls that can be typed in as shown.

In:  names, sentences and words of a call. Out: Markdown.
"""

from __future__ import annotations

import re
import shlex

from pido.workspace import Workspace, digest_of

_MARKS = re.compile(r"[\\`*_{}\[\]<>#|&~!]")


def in_markdown(text: str) -> str:
    """Text from outside that is shown as it is, also in a heading or in a table.

    By backslashes: Prefect's pages show entities such as `&#124;` letter for letter.
    """
    return _MARKS.sub(r"\\\g<0>", " ".join(text.splitlines()))


def key(kind: str, machine: str) -> str:
    """The key of artifacts of a kind about one machine: lower case, digits, dashes. Whose they are on a server that
    several workspaces share is added by `flows.ownership.key`.

    >>> key("iteration", "cmx600v"), key("iteration", "Mill 1")
    ('iteration-cmx600v', 'iteration-mill-1-047f9d')
    """
    plain = re.sub("[^a-z0-9]+", "-", machine.lower()).strip("-")
    return "-".join(filter(None, (kind, plain, "" if plain == machine else digest_of(machine)[:6])))


def call(workspace: Workspace, machine: str, *words: str) -> str:
    """A call of the command line about a machine of a workspace, as a block to copy. NAME and TEXT are for a person."""
    words = ("pido", *words, "--by", "NAME", "--reason", "TEXT", "--workspace", str(workspace.root))
    return f"```\n{shlex.join([*words, '--machine', machine])}\n```"
