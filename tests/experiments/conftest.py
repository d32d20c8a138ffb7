"""Scripts called as a user calls them."""

import sys

import pytest

from experiments.command_line import main


@pytest.fixture
def script(monkeypatch, capsys):
    """Run a script; returns exit code, standard output and standard error."""

    def run(command, *arguments):
        monkeypatch.setattr(sys, "argv", ["script", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main(command, None)
        printed = capsys.readouterr()
        return stopped.value.code, printed.out, printed.err

    return run
