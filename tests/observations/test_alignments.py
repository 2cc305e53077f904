"""Lines that share the placement of one artefact: exact geometry, reversal, and what their messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.hdf5_files import changed
from support.kinds import EXAMPLES, exact_readings, exact_truth, machine_of, plan_set, predictions

from volid.campaign import Alignment, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.streamed import fit_streamed
from volid.io import load_campaign, write_campaign, write_manifest
from volid.io.campaign.stream import CampaignStream
from volid.io.solutions import read_solution, write_solution
from volid.model.geometry import rotate_exactly
from volid.model.machine import Datum
from volid.observations.base import NuisanceTable
from volid.observations.component import COMPONENT
from volid.virtual.simulate import simulate

SQUARENESS = """format = "volid-machine/1"
name = "drilling machine"
structure = "w Y' b X Z t"
[axis.X]
travel = [0.0, 400.0]
[axis.Y]
travel = [0.0, 300.0]
[axis.Z]
travel = [-200.0, 0.0]
[model]
segments = 2
[model.functions]
"*" = false
EC0Y = true
"""
STRAIGHT = SQUARENESS.replace("EC0Y = true", "EC0Y = true\nEYX = true\nEXY = true")
X, Y = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
LEGS = {"leg_X": {"along": X, "normal": Y}, "leg_Y": {"along": Y, "normal": X}}
FLIPPED = {"leg_X": {"along": X, "normal": [0.0, -1.0, 0.0]}, "leg_Y": {"along": [0.0, -1.0, 0.0], "normal": X}}
N = 9


def positions(machine, axis: str, at: float = 100.0) -> np.ndarray:
    """A line of one axis over its whole travel, the others at `at` from their lower ends."""
    q = np.tile([a.travel[0] + at for a in machine.axes], (N, 1))
    own = machine.axes[machine.index(axis)]
    q[:, machine.index(axis)] = np.linspace(*own.travel, N)
    return q


def square(name: str, machine, lines=LEGS, **options) -> ObservationSet:
    """Both legs read over the travels, without readings."""
    q = np.concatenate([positions(machine, "X"), positions(machine, "Y")])
    labels = {"component": np.repeat(["Y", "X"], N), "line": np.repeat(["leg_X", "leg_Y"], N)}
    own = plan_set(name, "component", q, (0.0, 0.0, -100.0), labels, u=1e-3)
    return replace(own, options={"slope": False, "alignment": name, "lines": lines, **options})


def campaign(machine, *sets: ObservationSet, artefact: str = "") -> Campaign:
    return Campaign(machine, (), sets, alignments=tuple(Alignment(s.name, artefact=artefact) for s in sets))


def read(own: ObservationSet, machine, legs: dict, squareness: float, form=lambda line, s: 0.0) -> ObservationSet:
    """Exact readings in the plane, by intersection: where the ray of the gauge meets the leg.

    `legs`: by name a point and a unit direction in the plane; the tool stands at (x - EC0Y (y - y_ref), y), CONVENTIONS 3.
    """
    values = []
    for q, line, component in zip(own.positions, own.labels["line"], own.labels["component"], strict=True):
        x, y = q[machine.index("X")], q[machine.index("Y")]
        tool = np.array([x - squareness * (y - 150.0), y])
        point, direction = (np.asarray(v, dtype=float) for v in legs[str(line)])
        ray = np.array([1.0, 0.0]) if component == "X" else np.array([0.0, 1.0])
        # tool - value · ray = point + s · direction
        value, s = np.linalg.solve(np.stack([ray, direction], axis=1), tool - point)
        values.append(value - form(str(line), s))
    return replace(own, readings=np.array(values)[:, None])


# ------------------------------------------------------------------------------------------------------ exact geometry


@pytest.mark.parametrize("size", [1e-6, 0.03, 1.2])
def test_rotations_of_any_size_are_exact(size):
    """Against SciPy: the rotation by 2 arctan(|o|/2) about o; vectors keep their length."""
    o = size * np.array([0.48, -0.6, 0.64])
    x = np.random.default_rng(1).normal(size=(20, 3))
    expected = Rotation.from_rotvec(2.0 * np.arctan(size / 2.0) * o / size).apply(x)
    found = np.stack(rotate_exactly(tuple(o), tuple(x.T)), axis=1)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.028, 0.3])
def test_a_square_at_any_angle_gives_the_squareness_exactly(angle):
    """Readings by intersection of lines; 16 µm per degree of turn would be lost if the placement were taken as small."""
    machine = machine_of(SQUARENESS)
    c, s = np.cos(angle), np.sin(angle)
    corner = np.array([90.0, 95.0])
    legs = {"leg_X": (corner, (c, s)), "leg_Y": (corner, (-s, c))}
    own = read(square("square", machine), machine, legs, 350e-6)
    solution = fit(campaign(machine, own))
    assert solution.location("EC0Y").value == pytest.approx(350e-6, abs=1e-9)
    turn = {
        e.key[-1]: float(v)
        for e, v in zip(solution.nuisance_table, solution.nuisance, strict=True)
        if e.key[0] == "alignment"
    }
    assert 2.0 * np.arctan(turn["C"] / 2.0) == pytest.approx(angle, abs=1e-8) and turn["A"] == turn["B"] == 0.0


def test_u_of_the_squareness_is_that_of_two_slopes():
    machine = machine_of(SQUARENESS)
    solution = fit(
        campaign(
            machine, read(square("square", machine), machine, {"leg_X": ((0, 0), X[:2]), "leg_Y": ((0, 0), Y[:2])}, 0.0)
        )
    )
    slopes = [1e-3 / np.sqrt(np.sum((x - x.mean()) ** 2)) for x in (np.linspace(0, 400, N), np.linspace(0, 300, N))]
    assert solution.location("EC0Y").u == pytest.approx(np.hypot(*slopes), rel=1e-6)


def test_what_stands_on_the_square_as_a_whole_has_no_offsets_of_its_lines():
    """`offset = false`: both legs meet at one corner, whose place in X and Y is the placement's."""
    machine = machine_of(SQUARENESS)
    points = {name: {**leg, "point": [100.0, 100.0, -250.0]} for name, leg in LEGS.items()}
    angle, moved = 0.02, np.array([0.4, -0.3])
    c, s = np.cos(angle), np.sin(angle)
    corner = np.array([100.0, 100.0]) + moved
    own = square("square", machine, points, offset=False)
    solution = fit(
        campaign(machine, read(own, machine, {"leg_X": (corner, (c, s)), "leg_Y": (corner, (-s, c))}, -200e-6))
    )
    found = {e.key[-1]: float(v) for e, v in zip(solution.nuisance_table, solution.nuisance, strict=True)}
    assert solution.location("EC0Y").value == pytest.approx(-200e-6, abs=1e-9)
    np.testing.assert_allclose([found["X"], found["Y"]], moved, atol=1e-6)
    assert set(found) == set("ABCXYZ")


# ----------------------------------------------------------------------------------------------------------- reversal


def test_a_square_that_is_turned_over_loses_its_own_angle():
    """The leg along Y is turned by δ towards X; upright it adds δ to the squareness, turned over it takes δ away.

    One placement leaves u(EC0Y) at that of the angle; both together at that of the readings.
    """
    machine = machine_of(SQUARENESS)
    delta, squareness = 80e-6, -120e-6
    upright = {"leg_X": ((0.0, 0.0), (1.0, 0.0)), "leg_Y": ((0.0, 0.0), (np.sin(delta), np.cos(delta)))}
    over = {"leg_X": ((0.0, 300.0), (1.0, 0.0)), "leg_Y": ((0.0, 300.0), (np.sin(delta), -np.cos(delta)))}
    one = read(square("upright", machine, angle_u=1e-3), machine, upright, squareness)
    two = read(square("over", machine, FLIPPED, angle_u=1e-3), machine, over, squareness)
    alone = fit(campaign(machine, one, artefact="square"))
    assert alone.location("EC0Y").value == pytest.approx(squareness + delta, abs=2e-6)  # δ is drawn to 0 by its prior
    assert alone.location("EC0Y").u == pytest.approx(1e-3, rel=0.01)
    both = fit(campaign(machine, one, two, artefact="square"))
    assert both.location("EC0Y").value == pytest.approx(squareness, abs=1e-8)
    assert both.location("EC0Y").u < 1e-5
    (angle,) = [
        float(v)
        for e, v in zip(both.nuisance_table, both.nuisance, strict=True)
        if e.unit == "rad" and "angle" in e.name
    ]
    assert angle == pytest.approx(delta, abs=1e-6)


def test_a_straightedge_that_is_turned_over_loses_its_own_form():
    """Upright the form is subtracted from what the gauge sees, turned over it is added: half the sum is the straightness."""
    machine = machine_of(SQUARENESS.replace("EC0Y = true", "EYX = true"))
    s = np.linspace(0.0, 400.0, N)
    form, truth = 4e-3 * np.sin(2.0 * np.pi * s / 400.0), exact_truth(machine)
    q = positions(machine, "X")
    straight = np.asarray(truth.deviation(q, np.array([0.0, 0.0, -100.0])))[:, 1]
    sets = []
    for name, sense in (("up", 1.0), ("over", -1.0)):
        labels = {"component": np.full(N, "Y"), "line": np.full(N, "edge")}
        lines = {"edge": {"along": X, "normal": [0.0, sense, 0.0]}}
        own = plan_set(name, "component", q, (0.0, 0.0, -100.0), labels, u=1e-4)
        options = {"slope": False, "alignment": name, "lines": lines, "form_u": 5e-3}
        sets.append(replace(own, options=options, readings=(straight - sense * form + 1e-5 * s * sense)[:, None]))
    alone, both = (fit(campaign(machine, *chosen, artefact="edge")) for chosen in (sets[:1], sets))
    u = [max(f.u for f in s.functions() if f.name == "EYX") for s in (alone, both)]
    assert u[1] < 0.1 * u[0]
    other = positions(machine, "X")
    found = np.asarray(both.deviation(other, np.array([0.0, 0.0, -100.0])))[:, 1]
    line = np.polyfit(s, found - straight, 1)  # the slope of a straightedge is its placement
    assert np.abs(found - straight - np.polyval(line, s)).max() < 4.0 * u[1]


# ---------------------------------------------------------------------------------------------- simulation and files


@pytest.mark.parametrize("segments", ["segments = 2", ""], ids=["stated", "from the data"])
def test_a_simulated_square_is_found_again(segments, tmp_path):
    machine = machine_of(STRAIGHT.replace("segments = 2", segments))
    plan = campaign(machine, square("square", machine, form_u=2e-3, angle_u=1e-5))
    write_campaign(plan, tmp_path / "plan.h5")
    for again in (
        load_campaign(write_manifest(plan, tmp_path / "text"), plan=True),
        load_campaign(tmp_path / "plan.h5"),
    ):
        assert again.alignments == plan.alignments and again.sets[0].options == plan.sets[0].options
    found, truth = simulate(load_campaign(tmp_path / "plan.h5"), exact_truth(machine), seed=4)
    assert {"alignment square C", "angle square line leg_Y", "form square line leg_X at 0.000 mm"} <= set(
        truth.instruments
    )
    solution = fit(found)
    assert solution.location("EC0Y").u < 4e-5
    true = truth.constants.get("EC0Y", 0.0)
    assert abs(solution.location("EC0Y").value - true) < 4.0 * solution.location("EC0Y").u
    assert not solution.adequacy.rejected


def test_a_placement_stands_in_the_file_of_a_solution_and_follows_a_datum(tmp_path):
    """The offsets of legs answer with the normal as it was placed; read back, they answer the same."""
    found = exact_readings(EXAMPLES["component, one artefact"].plan())
    solution = fit(found)
    write_solution(solution, tmp_path / "s.h5")
    again = read_solution(tmp_path / "s.h5")
    assert again.nuisance_table == solution.nuisance_table and again.campaign.alignments == found.alignments
    assert {type(e.response).__name__ for e in again.nuisance_table} >= {"TurnOf", "GapOf"}
    moved = again.in_datum(Datum("Z", "X"))
    own = [e.key[0] in ("alignment", "offset") for e in again.nuisance_table]
    assert np.abs(np.asarray(moved.nuisance) - np.asarray(solution.nuisance))[own].max() > 1e-5, "nothing to follow"
    for before, after in zip(predictions(solution), predictions(moved), strict=True):
        np.testing.assert_allclose(after, before, rtol=0.0, atol=5e-6)  # products of two errors, 70 µrad over 1 m


def test_repeated_readings_share_the_form_of_their_place():
    machine = machine_of(SQUARENESS)
    own = square("square", machine, form_u=2e-3)
    twice = replace(own.rows_of(np.tile(np.arange(2 * N), 2)), rows=None)
    table = NuisanceTable()
    COMPONENT.groups(twice, campaign(machine, twice), table)
    assert sum(e.key[0] == "form of artefact" for e in table.entries) == 2 * N


# ------------------------------------------------------------------------------------------------------------ messages


def check(**options):
    machine = machine_of(SQUARENESS)
    COMPONENT.check(square("square", machine, **options))


def test_what_does_not_fit_is_named():
    check()
    with pytest.raises(InputError, match="slope = true beside alignment"):
        check(slope=True)
    with pytest.raises(InputError, match="lines belong to an alignment; add alignment"):
        check(alignment="")
    with pytest.raises(InputError, match=r"line 'leg_Y': found nothing among leg_X; expected where it lies"):
        check(lines={"leg_X": LEGS["leg_X"]})
    with pytest.raises(InputError, match="line 'leg_X': along and normal are not at right angles"):
        check(lines={**LEGS, "leg_X": {"along": X, "normal": [0.1, 1.0, 0.0]}})
    with pytest.raises(InputError, match=r"line 'leg_Y': normal is \[0, 0\]; expected three numbers"):
        check(lines={**LEGS, "leg_Y": {"along": Y, "normal": [0, 0]}})


def test_a_component_in_the_surface_is_named():
    machine = machine_of(SQUARENESS)
    lines = {**LEGS, "leg_X": {"along": [0.0, 0.0, 1.0], "normal": X}}
    with pytest.raises(
        InputError, match=r"component Y lies in the surface of line 'leg_X', whose normal is \[1, 0, 0\]"
    ):
        fit(exact_readings(campaign(machine, square("square", machine, lines))))


def test_rotations_of_an_artefact_are_refused():
    machine = machine_of(SQUARENESS)
    own = square("square", machine)
    with pytest.raises(InputError, match=r"component C of a set with an alignment; expected X, Y or Z"):
        COMPONENT.check(replace(own, labels={**own.labels, "component": np.full(2 * N, "C")}))


@pytest.mark.parametrize(
    "text", ['{"name": "square"}', "[1]", '[{"body": "bed"}]', '[{"name": 1}]', '[{"name": "a", "place": "b"}]']
)
def test_alignments_of_a_damaged_file_are_named(text, tmp_path):
    machine = machine_of(SQUARENESS)
    write_campaign(campaign(machine, square("square", machine)), tmp_path / "c.h5")
    with changed(tmp_path / "c.h5") as file:
        file.attrs["alignments"] = text
    with pytest.raises(InputError, match=r"c\.h5, attribute alignments: .*expected a list( of tables| in JSON)"):
        load_campaign(tmp_path / "c.h5")


def test_lines_of_an_artefact_are_not_fitted_part_by_part(tmp_path):
    machine = machine_of(STRAIGHT)
    found, _ = simulate(campaign(machine, square("square", machine)), exact_truth(machine), seed=4)
    write_campaign(found, tmp_path / "c.h5")
    with pytest.raises(InputError, match="set 'square': its rows refer to each other"):
        fit_streamed(CampaignStream(tmp_path / "c.h5"))


def test_alignments_in_files_are_checked(tmp_path):
    machine = machine_of(SQUARENESS)
    own = read(square("square", machine), machine, {"leg_X": ((0, 0), X[:2]), "leg_Y": ((0, 0), Y[:2])}, 0.0)
    path = write_manifest(campaign(machine, own), tmp_path / "c")
    text = path.read_text()
    for old, new, said in (
        ('alignment = "square"', 'alignment = "sqare"', "alignment 'sqare' is unknown.*alignments: square; add"),
        (
            'body = "workpiece"',
            'body = "tool"',
            "alignment 'square': body is 'tool'.*expected one of workpiece, bed, Y, X, Z",
        ),
        ('body = "workpiece"', "placed = 1", "unknown key 'placed'"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=said):
            load_campaign(path)
