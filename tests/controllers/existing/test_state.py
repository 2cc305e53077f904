"""Which state of the machine results refer to: what would be replaced, and what of an old file the model cannot describe."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import spatial
from support.places import ROOT

import volid
from volid.campaign import ActiveFiles
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.controllers.existing.reading import ExistingCompensation
from volid.controllers.existing.state import in_place, not_described, would_replace


@pytest.fixture(scope="module")
def solution():
    """EXX and EZZ with reversal, and nothing else."""
    return volid.fit(volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml"))


def with_record(campaign, *active, files=()):
    return replace(campaign, conditions={"active_compensations": list(active)}, active_files=files)


def existing(machine, *tables, grids=(), cnc="linuxcnc"):
    return ExistingCompensation(cnc, machine, Compensation((), (), grids, tables), {"old": b""})


def table(output, argument, up, down=None, factor=None):
    x, up = np.array([0.0, 100.0, 300.0]), np.array(up, dtype=float)
    return AxisTable(output, argument, x, up, up if down is None else np.array(down, dtype=float), factor)


def test_the_same_type_replaces_what_the_record_states_in_words(solution):
    campaign = with_record(solution.campaign, "L-POS: old tables")
    (said,) = would_replace(campaign, ["L-POS"], "linuxcnc")
    assert "they REPLACE it" in said and "`add_to`" in said
    assert would_replace(campaign, ["L-STR"], "linuxcnc") == []
    assert would_replace(with_record(solution.campaign, "thermal compensation"), ["L-POS"], "linuxcnc") == []


def test_files_of_the_same_control_are_replaced_by_all_that_corrects_the_same(solution):
    """L-VOL contains L-POS; of another control both may be loaded side by side."""
    files = (ActiveFiles("L-POS: x.comp for linuxcnc", "linuxcnc", {"x.comp": b""}),)
    campaign = with_record(solution.campaign, files[0].text, files=files)
    assert len(would_replace(campaign, ["L-VOL"], "linuxcnc")) == 1
    assert would_replace(campaign, ["L-VOL"], "isg-volcomp") == []
    assert len(would_replace(campaign, ["L-POS"], "isg-ssfk")) == 1


def test_what_the_model_describes_is_not_named(solution):
    old = existing(
        solution.machine, table("X", "X", [0.0, 0.01, 0.0], [0.002, 0.012, 0.002]), table("Y", "Y", [0.01] * 3)
    )
    assert not_described(solution, [old]) == []  # EXX has a reversal; a constant shift of Y needs no function


def test_functions_that_the_model_lacks_are_named(solution):
    ramp = Factor("Z", np.array([0.0, 325.0]), np.array([-100.0, 225.0]))
    tables = (table("Y", "X", [0.0, 0.01, 0.0]), table("Y", "Y", [0.0, 2e-5, 0.0], factor=ramp))
    lever, straight = not_described(solution, [existing(solution.machine, *tables)])
    assert "the table of Y over Y grows with Z; the model describes that by an angular error motion alone" in lever
    assert "acts like EYX, which the model does not have" in straight


def test_a_grid_that_bends_needs_angles_in_the_model(solution):
    (grid,) = spatial().grids
    assert (
        not_described(solution, [existing(solution.machine, grids=(grid,))]) == []
    )  # a sum of functions of one axis each
    values = grid.values.copy()
    values[:, 2] = 0.008 * (grid.positions[:, 0] / 1000) * (grid.positions[:, 1] / 600)
    (said,) = not_described(solution, [existing(solution.machine, grids=(replace(grid, values=values),))])
    assert "the grid is up to 8.0 µm off any sum of functions of single axes" in said


def test_loaded_files_stand_in_the_place_of_those_of_the_same_control_alone(solution):
    machine = solution.machine
    old = existing(machine, table("X", "X", [0.0, 0.01, 0.0]))
    whole = existing(machine, table("X", "X", [0.0, 0.03, 0.0]))
    q = np.zeros((1, 3))
    q[0, machine.index("X")] = 100.0
    for cnc, size in (("linuxcnc", 0.02), ("isg-ssfk", 0.03)):
        made, notes = in_place(whole.compensation, [replace(whole, cnc=cnc)], [old])
        moved = made.control(machine).command(q, None) - q
        assert moved[0, machine.index("X")] == pytest.approx(-size, abs=1e-12)
        assert len(notes) == 1
