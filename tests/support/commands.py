"""A fixture that runs commands in the process of the tests."""

import pytest

from volid.cli import main


@pytest.fixture
def run(capsys):
    """Runs a command in this process; returns exit status, standard output and standard error."""

    def run(*arguments):
        status = main([str(a) for a in arguments])
        return status, *capsys.readouterr()

    return run
