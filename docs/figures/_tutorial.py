"""The solution of the tutorial: its own commands, run once in a temporary folder."""

import io
import os
import tempfile
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path

import volid
from volid.cli import main

ROOT = Path(__file__).parents[2]
COMMANDS = (
    f"plan {ROOT}/models/wXYbZt_vertical.toml standard --points 200 -o plan.toml",
    f"simulate {ROOT}/models/wXYbZt_vertical.toml --plan plan.toml --seed 7 -o campaign.h5",
    "fit campaign.h5 -o solution.h5",
)


@cache
def solution() -> volid.Solution:
    """What the tutorial's fit finds."""
    silent = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(silent), redirect_stderr(silent):
        for command in COMMANDS:
            if status := main(command.split()):
                raise RuntimeError(f"volid {command}: exit status {status}{os.linesep}{silent.getvalue()}")
        return volid.load_solution("solution.h5")
