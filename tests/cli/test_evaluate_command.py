"""`volid evaluate`: every standard is known to the command and to the library, and its help shows how it is used."""

import pytest

from volid.cli.evaluate import STANDARDS
from volid.io.evaluations import evaluate


def test_the_command_has_the_standards_of_the_library():
    assert STANDARDS.keys() == evaluate.STANDARDS.keys()


@pytest.mark.parametrize("standard", STANDARDS)
def test_help_has_an_example_and_the_exit_status(standard, run):
    status, out, _ = run("evaluate", standard, "--help")
    assert status == 0 and f"\n  volid evaluate {standard} " in out and "exit status: 0 good; 1" in out
