"""Scripts called from the command line."""

import sys

import pytest

from experiments.command_line import SMOKE_TEST, main


@pytest.fixture
def script(monkeypatch, capsys):
    """Return a function that runs a script and returns exit code, standard output and error.

    The notice of a smoke test is removed from standard error.
    """

    def run(command, *arguments):
        monkeypatch.setattr(sys, "argv", ["script", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main(command, None)
        printed = capsys.readouterr()
        return stopped.value.code, printed.out, printed.err.replace(f"{SMOKE_TEST}\n", "")

    return run
