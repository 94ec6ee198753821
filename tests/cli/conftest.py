"""What the tests of the command line share."""

import sys

import pytest

from pido.cli import main


@pytest.fixture
def call(monkeypatch, capsys):
    """`call("diagnose", ...)` is what a shell sees: exit code, stdout, stderr."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["pido", *map(str, words)])
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
        out = capsys.readouterr()
        return code, out.out, out.err

    return run
