"""From a solution to files: which types by default, over which positions, in which steps, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import AT, MACHINE, TOOL, crossed, error_table
from support.control_cases import job as job_for
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import GRID, TABLES
from volid.controllers import CONTROLS
from volid.controllers.axes import Axes, kept_to
from volid.controllers.base import (
    EQUAL,
    ERROR,
    FREE,
    HELD,
    NO_REVERSAL,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Written,
)
from volid.controllers.export import ExportRequest, controller, export_of, sampling_for
from volid.controllers.exported import write
from volid.exceptions import InputError, NotDeterminedError

FIVE = volid.load_machine("models/wCAYXbZt_trunnion.toml")


def declaration(carries, **fields) -> Declaration:
    """A control of the tests."""
    plain = {
        "sign": ERROR,
        "units": "mm",
        "reversal": NO_REVERSAL,
        "outside": HELD,
        "zero": "nowhere",
        "switching": "not",
    }
    steps = Commissioning(("a",), ("b",), ("c",), ("d",))
    return Declaration(
        "toy", "a toy", carries, "take another", commissioning=steps, facts=(Fact("t", OPEN),), **{**plain, **fields}
    )


class Toy(Controller):
    """It holds what it is given, as it is; it refuses what `refuse` names."""

    def __init__(self, carries, refuse=(), **fields):
        self.declaration, self.refuse, self.jobs = declaration(carries, **fields), refuse, []

    def write(self, job: Job) -> Written:
        self.jobs.append(job)
        bad = [t.type for t in job.compensation.tables if t.type in self.refuse]
        if bad:
            raise InputError(f"toy: no room for {bad[0]}")
        return Written((ControlFile("toy.txt", "toy", "everything"),))

    def read(self, files, machine, options) -> Compensation:
        made = self.jobs[-1].compensation
        return made if self.declaration.model else replace(made, tables=(), axis_tables=self.jobs[-1].axis_tables())


def types(solution, carries, refuse=(), **asked):
    return export_of(solution, Toy(carries, refuse), ExportRequest(**asked))


def test_the_most_complete_type_is_taken_and_what_it_contains_is_not_taken_again():
    carries = {"L-VOL": GRID, "L-POS": TABLES, "L-STR": TABLES, "R-VOL": GRID}
    assert types(made_up(MACHINE), carries).types == ("L-VOL",)
    assert types(made_up(FIVE), carries).types == ("L-VOL", "R-VOL")


def test_what_the_data_do_not_determine_is_left_out_with_the_reason():
    """Of the published interferometer runs only the positioning of X and Z is known."""
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    made = types(solution, {"L-VOL": TABLES, "L-POS": TABLES, "L-STR": TABLES})
    assert made.types == ("L-POS",)
    left = [note for note in made.notes if " left out: " in note]
    assert sorted(name for note in left for name in note.split(" left")[0].split(", ")) == ["L-STR", "L-VOL"]
    with pytest.raises(
        InputError, match=r"toy: nothing that it carries can be made. L-VOL left out: .*measured 100 mm alone"
    ):
        types(solution, {"L-VOL": GRID})


def test_a_volume_is_not_claimed_where_positioning_alone_was_measured():
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    made = types(solution, {"L-VOL": TABLES, "L-POS": TABLES})
    assert made.types == ("L-POS",)
    (note,) = [n for n in made.notes if n.startswith("L-VOL left out")]
    assert note.endswith("the model has no function of straightness, squareness, angular; smaller types hold the rest")


def test_a_grid_of_zeros_is_no_volume():
    """The R-test campaign models the rotary axes alone: a grid of the linear axes would hold nothing."""
    solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    made = types(solution, {"L-VOL": GRID, "R-POS": TABLES})
    assert made.types == ("R-POS",) and "L-VOL left out: the model has no function that it corrects" in made.notes


def test_directions_that_the_data_leave_open_are_left_out():
    """With one tool vector the angular errors of a three-axis machine are not all determined; positions along the lines are."""
    solution = volid.fit(volid.load_campaign("tests/cases/30_half_of_a_travel/campaign.h5"))
    open_data = replace(solution, null_space=np.eye(solution.model.n_parameters))
    with pytest.raises(
        NotDeterminedError, match=r"nothing that it carries can be made. L-POS left out: the data do not"
    ):
        types(open_data, {"L-POS": TABLES})


def test_what_the_control_cannot_hold_beside_the_rest_is_left_out():
    made = types(
        made_up(MACHINE), {"L-POS": TABLES, "L-STR": TABLES, "L-SQU": TABLES}, refuse=("L-STR", "L-STR + L-SQU")
    )
    assert made.types == ("L-POS", "L-SQU")
    assert "L-STR left out: no room for L-STR" in made.notes
    with pytest.raises(InputError, match=r"nothing that it carries can be made.*no room"):
        types(made_up(MACHINE), {"L-STR": TABLES}, refuse=("L-STR",))


def test_types_that_are_asked_for_are_checked():
    with pytest.raises(InputError, match=r"`type=L-SQU`: toy cannot carry L-SQU: take another. It carries L-POS"):
        types(made_up(MACHINE), {"L-POS": TABLES}, types=("L-SQU",))
    with pytest.raises(InputError, match="no compensation type"):
        types(made_up(MACHINE), {"L-POS": TABLES}, types=("L-XYZ",))
    with pytest.raises(InputError, match="corrected twice"):
        types(made_up(MACHINE), {"L-POS": TABLES, "L-VOL": GRID}, types=("L-POS", "L-VOL"))
    with pytest.raises(InputError, match="no axis for any"):
        types(made_up(MACHINE), {"R-POS": TABLES})


@pytest.mark.parametrize(
    "name, words",
    [
        ("sinumerik-vcs", "take sinumerik-cec"),
        ("Okuma", "csv and hdf5"),
        ("haas-ngc", "csv and hdf5"),
        ("QIF", "no element for the errors of a machine's axes.*etalon and isg-volcomp"),
        ("grbl", "volid apply"),
        ("nothing", "available: linuxcnc"),
    ],
)
def test_controls_that_there_are_not_are_named_with_what_serves_instead(name, words):
    with pytest.raises(InputError, match=words):
        controller(name)


def test_steps_are_equal_where_the_control_knows_no_others():
    """A step of 70 mm does not divide 1000 mm: 15 equal steps of 66.7 mm do; a polygon with unequal knots is evened."""
    asked = sampling_for(declaration({"L-POS": TABLES}, spacing=EQUAL), Sampling(step=70.0))
    made = export_of(made_up(MACHINE), Toy({"L-POS": TABLES}, spacing=EQUAL), ExportRequest(sampling=asked))
    for t in made.job.compensation.tables:
        assert np.ptp(np.diff(t.positions)) < 2.1e-6  # positions are whole nanometres
    x = next(t for t in made.job.compensation.tables if t.function == "EXX")
    assert len(x.positions) == 16 and (x.positions[0], x.positions[-1]) == (0.0, 1000.0)
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    for t in export_of(solution, Toy({"L-POS": TABLES}, spacing=EQUAL), ExportRequest()).job.compensation.tables:
        assert np.ptp(np.diff(t.positions)) < 2.1e-6  # positions are whole nanometres


def test_all_functions_of_an_axis_stand_at_the_same_points_and_keep_the_bound():
    carries = {"L-POS": TABLES, "L-STR": TABLES}
    made = types(made_up(MACHINE), carries, sampling=Sampling(max_error=0.0002)).job.compensation
    for letter in "XYZ":
        points = {t.positions.tobytes() for t in made.tables if t.axis == letter}
        assert len(points) == 1
    assert max(t.interpolation for t in made.tables) <= 0.0002


def test_no_more_positions_than_the_control_holds():
    assert sampling_for(declaration({}, most_points=12), None).max_points == 12
    assert sampling_for(declaration({}, most_points=128), None).max_points == 21
    assert sampling_for(declaration({}, most_points=128), Sampling(max_error=0.001)).max_points == 128
    assert sampling_for(declaration({}, spacing=FREE), Sampling(spacing="free")).spacing == "free"


def test_values_beyond_what_was_measured_are_refused_unless_intended():
    """The campaign of the half travel knows Y over half of its travel alone."""
    solution = volid.fit(volid.load_campaign("tests/cases/30_half_of_a_travel/campaign.h5"))
    letter = next(
        a.letter
        for a, (low, high) in zip(solution.campaign.machine.axes, solution.measured_range(), strict=True)
        if a.is_linear and high - low < 0.9 * a.length
    )
    travel = solution.campaign.machine.axis(letter).travel
    carries = {"L-POS": TABLES}
    made = types(solution, carries, types=("L-POS",))
    table = next(t for t in made.job.compensation.tables if t.axis == letter)
    assert table.positions[-1] - table.positions[0] < travel[1] - travel[0]
    assert any(note.startswith(f"{letter} ") and "of the travel" in note for note in made.notes)
    with pytest.raises(InputError, match="`extrapolate`"):
        types(solution, carries, types=("L-POS",), ranges={letter: travel})
    whole = types(solution, carries, types=("L-POS",), extrapolate=True)
    assert next(t for t in whole.job.compensation.tables if t.axis == letter).positions[-1] == travel[1]


def test_constants_of_the_tool_frame_are_named_where_no_table_holds_them():
    solution = made_up(MACHINE)
    base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    made = types(solution, {"L-VOL": TABLES}, base=base)
    assert all(t.axis != "S" for t in made.job.compensation.tables)
    (note,) = [n for n in made.notes if "constants of the tool frame" in n]
    names = {
        f.name: float(np.asarray(solution.parameters)[f.parameters][0])
        for f in solution.model.functions
        if "0S" in f.name
    }
    turn = np.array([names.get(f"E{d}0S", 0.0) for d in "ABC"])
    # the grid and the tables hold for the base tool, so that nothing is left out there
    assert (
        f"displaced by 0.00 µm everywhere, and 100 mm of another tool by up to {1e5 * np.linalg.norm(turn):.2f} µm"
        in note
    )


def job(made: Compensation) -> Job:
    return Job(MACHINE, made, AT, TOOL, ERROR)


def test_a_clamped_axis_is_not_moved_and_the_loss_is_named():
    kept, notes = kept_to(Axes(clamped=("Z",)), job(crossed()), declaration({"L-POS": TABLES}))
    q = np.stack([MACHINE.order(X=500.0, Y=0.0, Z=-100.0)])
    step = kept.compensation.control(MACHINE).command(q, TOOL)[0] - q[0]
    assert step[MACHINE.index("Z")] == 0.0 and step[MACHINE.index("X")] == pytest.approx(-0.010 + 0.006)
    assert notes == ("Z is clamped: its table over X (EZX) is left out, which leaves up to 3.00 µm",)
    with pytest.raises(InputError, match="`clamped=Z`: tables of error functions move X, Y, Z through"):
        kept_to(Axes(clamped=("Z",)), job(crossed()), declaration({"L-POS": TABLES}, model=True))


def test_helping_axes_keep_to_whole_increments_and_few_turns():
    """Z over X wavers: in whole micrometres without a turn 0 1 1 2 2 2 are nearest, 0.7 µm off at the fifth."""
    x, e = np.linspace(0.0, 1000.0, 6), np.array([0.0, 0.0012, 0.0006, 0.0018, 0.0013, 0.0022])
    made = Compensation((), (), (), (AxisTable("Z", "X", x, e, e), AxisTable("X", "X", x, 10 * e, 10 * e)))
    axes = Axes({"X": 0.001, "Y": 0.001, "Z": 0.001}, most_turns=0)
    kept, notes = kept_to(axes, job(made), declaration({"L-POS": TABLES}))
    steady, own = kept.compensation.axis_tables
    assert np.all(np.diff(steady.forward) >= 0.0)
    np.testing.assert_allclose(steady.forward, np.round(steady.forward / 0.001) * 0.001, atol=1e-12)
    np.testing.assert_allclose(steady.forward, [0.0, 0.001, 0.001, 0.002, 0.002, 0.002], atol=1e-12)
    np.testing.assert_array_equal(own.forward, 10 * e)  # the axis that moves itself does not help
    assert "Z over X: steady values, at most 0.70 µm" in notes[0]
    with pytest.raises(
        InputError, match="needs the least increment of every axis that may help; `increment` lacks Y, X"
    ):
        kept_to(Axes({"Z": 0.001}, most_turns=0), job(made), declaration({"L-POS": TABLES}))


def test_what_files_cannot_keep_is_refused_with_the_pair_of_axes():
    axes = Axes({a: 0.0005 for a in "XYZ"}, most_turns=0)
    with pytest.raises(InputError, match=r"`most_turns=0` cannot be kept: while [XYZ] moves, [XYZ] is moved by up to"):
        types(made_up(MACHINE), {"L-VOL": GRID}, axes=axes)


def test_helping_axes_of_steady_files_are_reported():
    axes = Axes({a: 0.001 for a in "XYZ"}, most_turns=1, reversal={"Z": 0.002})
    made = types(made_up(MACHINE), {"L-POS": TABLES, "L-STR": TABLES}, axes=axes)
    assert made.helping and all(h.turns <= 1 and not h.too_small for h in made.helping)
    assert {h.reversal for h in made.helping if h.helping == "Z"} == {0.002}
    loose = types(made_up(MACHINE), {"L-POS": TABLES, "L-STR": TABLES})
    assert max(h.turns for h in loose.helping) > 1


@pytest.mark.parametrize(
    "name", ["linuxcnc", "sinumerik-enc-comp", "heidenhain-com", "fanuc-pitch", "heidenhain-kinematicscomp"]
)
def test_files_that_would_move_no_axis_are_refused_in_plain_words(name):
    nothing = () if CONTROLS[name].declaration.model else (error_table("EXX", [0, 1000], [0.0, 0.0]),)
    made = Compensation(("L-POS",), nothing, ())
    sign = "error" if CONTROLS[name].declaration.sign == "open" else None
    with pytest.raises(InputError, match=f"{name}: nothing to write; what L-POS would correct is 0 everywhere"):
        write(CONTROLS[name], job_for(name, made, sign), ("L-POS",))
