"""What `volid inspect` and sums ask of every control: its files are recognised, described, and added to themselves."""

import json

import numpy as np
import pytest
from support.control_contract import ALL

from volid.controllers import CONTROLS
from volid.controllers.base import OPEN, Controller
from volid.controllers.existing.conversion import on_top
from volid.controllers.existing.looks import looks, oddities
from volid.controllers.existing.reading import read_existing, recognised
from volid.controllers.exported import write
from volid.report.text.inspection import inspection_data, inspection_lines
from volid.report.text.summary import plain

SECOND_ORDER = 1e-3  # of the correction: a control that multiplies (a matrix) does not add
DIGITS = 1e-7  # mm or °: of the files
KNOWN = [case for case in ALL if type(CONTROLS[case.control]).recognises is not Controller.recognises]


def written(case):
    """What is written for a case, and its files."""
    job = case.job()
    made = write(CONTROLS[case.control], job, (case.type,))
    return made, {f.name: f.content if isinstance(f.content, bytes) else f.content.encode() for f in made.written.files}


def existing(case):
    made, files = written(case)
    sign = case.sign if made.declaration.sign == OPEN else None
    return made, read_existing(files, case.machine, case.control, sign=sign, options=made.job.options)


@pytest.mark.parametrize("case", KNOWN, ids=str)
def test_its_files_are_known_by_their_content(case):
    """Of controls that know their files; those of others are read where the control is named.

    Two controls of one vendor may have the same files; then both must make the same motion of them.
    """
    made, files = written(case)
    found = recognised(files).declaration.name
    if found != case.control:
        sign = case.sign if CONTROLS[found].declaration.sign == OPEN else None
        other = read_existing(files, case.machine, found, sign=sign)
        q = np.random.default_rng(2).uniform(
            *np.array([a.travel for a in case.machine.axes]).T, (50, len(case.machine.axes))
        )
        moves = [c.control().command(q, made.job.tool, np.ones_like(q)) for c in (made, other)]
        np.testing.assert_allclose(*moves, atol=DIGITS)


@pytest.mark.parametrize("case", ALL, ids=str)
def test_its_files_are_described_and_nothing_is_odd(case):
    _, found = existing(case)
    lines = inspection_lines(found, case.machine.name)
    assert any(case.control in line for line in lines)
    assert len(json.loads(json.dumps(plain(inspection_data(found))))["tables"]) == len(looks(found))
    assert oddities(found) == []


@pytest.mark.parametrize("case", ALL, ids=str)
def test_the_sum_with_itself_moves_the_axes_twice_as_far(case):
    made, found = existing(case)
    job = on_top(CONTROLS[case.control], made.job, [found]).job
    both = write(CONTROLS[case.control], job, (case.type,))
    axes = case.machine.axes
    q = np.random.default_rng(1).uniform(*np.array([a.travel for a in axes]).T, (50, len(axes)))
    for way in (1.0, -1.0):
        once, twice = (c.control().command(q, job.tool, np.full_like(q, way)) - q for c in (made, both))
        allowed = DIGITS + 3 * both.written.rounding * 180.0 / np.pi + SECOND_ORDER * np.abs(once).max()
        np.testing.assert_allclose(twice, 2.0 * once, atol=allowed)
