"""What R-test data determine, in words and in numbers: the rank decision of five-axis machines.

Numbers are checked against a Jacobian by finite differences of the exact chain, which knows nothing of the package.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from exact_chain import apply as carried
from support.machines import STRUCTURES, exact_machine, resolved
from support.rtests import SPHERES, TOOLS, RTest, r_test, r_test_campaign

from volid.fitting.datum import split_null_space
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.problem import build_problem
from volid.model.error_model import build_model
from volid.planning import iso10791_path

TILTING = STRUCTURES["tilting table C'A'"]
FORK = STRUCTURES["fork head CA"]
MOTIONS_OFF = '"E??" = false\n'
LINEAR_OFF = '"E?0[XYZ]" = false\n'
FEW = {"A": 7, "B": 7, "C": 9}


def decide(structure, functions, *, spheres=SPHERES, tools=TOOLS, counts=None, **options):
    """Rank decision for the R-test of a layout, and what must be known to check it."""
    exact = exact_machine(structure)
    machine = resolved(exact, functions, segments=4)
    counts = FEW | (counts or {})
    data = r_test(exact, Truth(), np.random.default_rng(0), spheres=spheres, tools=tools, counts=counts, noise=0.0)
    campaign = r_test_campaign(machine, data, off_by=0.0, spheres=spheres, **options)
    model = build_model(machine, {f"E{d}{a}": (4,) for d in "XYZABC" for a in machine.letters})
    found = analyse(build_problem(campaign, model), campaign)
    return model, found, (exact, data)


def defect(model, found):
    """Undetermined directions of the constants and functions, those of the tool frame held at 0 included."""
    return found.null_space.shape[1] + found.tool_rotation.shape[1]


def defect_by_differences(exact, data, names, spheres, nest):
    """The same from the exact chain: constants `names`, sphere places and the nest as unknowns; central differences."""
    step = 1e-4

    def readings(constants=None, moved=None):
        places = {k: np.asarray(v, float) for k, v in spheres.items()}
        for label, change in (moved or {}).items():
            places[label] = places[label] + change
        place = np.array([places[s] for s in data.sphere])
        return carried(np.linalg.inv(exact.pose(data.q, Truth({}, constants or {}))), place).ravel()

    columns = [(readings({n: step}) - readings({n: -step})) / (2 * step) for n in names]
    columns = [c / 1e3 if n[1] in "ABC" else c for n, c in zip(names, columns, strict=True)]  # mrad beside mm
    nuisance = [
        (readings(moved={label: step * e}) - readings(moved={label: -step * e})) / (2 * step)
        for label in spheres
        for e in np.eye(3)
    ]
    if nest:
        nuisance += [np.tile(e, len(data.q)) for e in np.eye(3)]
    N, J = np.stack(nuisance, axis=1), np.stack(columns, axis=1)
    Q, s, _ = np.linalg.svd(N, full_matrices=False)
    Q = Q[:, s > 1e-9 * s[0]]
    values = np.linalg.svd(J - Q @ (Q.T @ J), compute_uv=False)
    assert not np.any((values > 1e-9 * values[0]) & (values < 1e-4 * values[0])), values  # the decision is clear
    return int(np.sum(values < 1e-6 * values[0]))


def check_against_differences(model, found, seen, spheres, nest=False):
    exact, data = seen
    assert defect(model, found) == defect_by_differences(exact, data, model.names, spheres, nest)


def test_three_spheres_with_three_tool_vectors_determine_the_tilting_table():
    model, found, seen = decide(TILTING, MOTIONS_OFF + LINEAR_OFF)
    assert len(model.names) == 11 and found.full_rank and found.statements == ()
    check_against_differences(model, found, seen, SPHERES)
    model, found, _ = decide(TILTING, '"E?[XYZ]" = false\n' + LINEAR_OFF)
    assert found.full_rank  # with all twelve error motions


def test_one_sphere_only():
    one = {"P1": SPHERES["P1"]}
    _model, found, _ = decide(TILTING, '"E?[XYZ]" = false\n' + LINEAR_OFF, spheres=one, tools=TOOLS[:1])
    assert not found.full_rank
    text = " ".join(found.statements)
    assert "one sphere place only; use three that do not lie on one line" in text
    assert "a single tool vector" in text
    # one point on the table: its translations are seen, not which of translation, tilt and rotation of C made them
    assert {"EXC", "EYC", "EZC", "EAC", "EBC"} <= set(found.undetermined)


def test_sphere_on_the_axis_of_c():
    x, y, z = exact_machine(TILTING).point["C"]
    on_axis = {"P1": (x, y, z + 80.0)}
    model, found, seen = decide(TILTING, MOTIONS_OFF + LINEAR_OFF, spheres=on_axis, tools=TOOLS[:1])
    assert "every sphere lies on the axis line of C; add one far from it" in " ".join(found.statements)
    check_against_differences(model, found, seen, on_axis)
    off_axis = {"P1": (x + 90.0, y, z + 80.0)}
    _, better, seen = decide(TILTING, MOTIONS_OFF + LINEAR_OFF, spheres=off_axis, tools=TOOLS[:1])
    assert "axis line of C" not in " ".join(better.statements)
    assert defect(model, better) < defect(model, found)
    # the positioning of C does nothing to a sphere on its axis
    _, found, _ = decide(TILTING, '"E?[XYZ]" = false\n' + LINEAR_OFF, spheres=on_axis, tools=TOOLS[:1])
    assert any("ECC (all" in s or ("ECC" in s and "all" in s) for s in found.statements)


@pytest.mark.parametrize("locked", ["A", "C"])
def test_one_rotary_axis_locked(locked):
    model, found, seen = decide(TILTING, MOTIONS_OFF + LINEAR_OFF, counts={locked: 1})
    assert not found.full_rank
    assert f"axis {locked} was measured at 1 position only" in " ".join(found.statements)
    assert any(name.endswith(f"0{locked}") for name in found.undetermined)
    check_against_differences(model, found, seen, SPHERES)


def test_bk1_alone():
    """BK1 of ISO 10791-6: only the tilting axis turns, one sphere, one tool vector: what C lacks is named, and why."""
    exact = exact_machine(TILTING)
    machine = resolved(exact, MOTIONS_OFF + LINEAR_OFF, segments=4)
    plan = iso10791_path(machine, "BK1", (100.0, 30.0, 40.0), TOOLS[0], n=37)
    one = plan.sets[0]
    assert np.ptp(one.positions[:, exact.column("C")]) == 0.0 < np.ptp(one.positions[:, exact.column("A")])
    campaign = replace(plan, sets=(replace(one, readings=np.zeros((len(one), 3))),))
    model = build_model(machine, {f"E{d}{a}": (4,) for d in "XYZABC" for a in machine.letters})
    found = analyse(build_problem(campaign, model), campaign)
    text = " ".join(found.statements)
    assert "axis C was measured at 1 position only" in text and "one sphere place only" in text
    assert {"EX0C", "EY0C", "EA0C", "EB0C"} <= set(found.undetermined)
    data = RTest(one.positions, one.tool, one.labels["sphere"], one.readings)
    spheres = {"P1": (100.0, 30.0, 40.0)}
    assert defect(model, found) == defect_by_differences(exact, data, model.names, spheres, False) >= 4


def test_one_tool_vector_on_a_fork_head():
    tools = (TOOLS[0],) * 3
    model, found, seen = decide(FORK, MOTIONS_OFF + LINEAR_OFF, tools=tools)
    _, three, seen3 = decide(FORK, MOTIONS_OFF + LINEAR_OFF)
    assert defect(model, found) > defect(model, three)
    reasons = " ".join(found.statements)
    assert "a single tool vector (0, 0, -150) mm was used" in reasons
    assert "single tool vector" not in " ".join(three.statements)
    check_against_differences(model, found, seen, SPHERES)
    check_against_differences(model, three, seen3, SPHERES)
    # what remains with three tool vectors: the place of the head in the machine is that of the workpiece
    assert set(three.undetermined) == {"EX0C", "EY0C", "EZ0A"}
    datum, data = split_null_space(model, three.null_space)
    assert (datum.shape[1], data.shape[1]) == (3, 0)
    # with one, tool-frame constants are lost too, and held at 0
    assert found.tool_rotation.shape[1] > three.tool_rotation.shape[1] == 0
    # angular positioning of A about its own axis, tool vector across it: seen; rotations about the tool vector: not
    _, motions, _ = decide(FORK, '"E?[XYZ]" = false\n' + LINEAR_OFF, tools=tools)
    assert {"ECA", "ECC"} & set(motions.undetermined)


def test_unknown_nest():
    model, found, seen = decide(TILTING, MOTIONS_OFF + LINEAR_OFF, nest_u=float("inf"))
    assert not found.full_rank
    assert "the place of the nest of set R-test is unknown (nest_u = inf)" in " ".join(found.statements)
    assert {"EX0C", "EY0A", "EZ0A"} & set(found.undetermined)
    check_against_differences(model, found, seen, SPHERES, nest=True)


@pytest.mark.parametrize(
    "layout",
    ["tilting table C'A'", "tilting table C'B'", "table and head", "fork head CA", "fork head CB", "mill-turn"],
)
def test_eight_of_thirteen_location_errors_are_determined_with_sphere_and_nest_unknown(layout):
    """Abbaszadeh-Mir, Mayer, Cloutier and Fortin 2002: the minimal set of a five-axis machine has eight members.

    Thirteen: three squarenesses, four location errors of each rotary axis, two spindle tilts. One tool vector along the spindle,
    three spheres, places of spheres and nest unknown, error motions off. The five that are lost: three positions (where the
    rotary axes stand: spheres and nest) and the two tilts of a spindle that a tool vector along it does not show.
    """
    functions = MOTIONS_OFF + 'EC0S = false\n"E[XYZ]0S" = false\n'
    one_tool = (TOOLS[0],) * 3
    model, found, seen = decide(STRUCTURES[layout], functions, tools=one_tool, nest_u=float("inf"))
    assert len(model.names) == 13
    assert 13 - defect(model, found) == 8
    check_against_differences(model, found, seen, SPHERES, nest=True)


def test_one_sphere_and_one_tool_length_do_not_tell_the_tilt_of_a_head_from_squareness():
    """C' … B: with one sphere Z only follows the swing of the tool, so EA0B and EA0Z are one: seven of thirteen."""
    functions = MOTIONS_OFF + 'EC0S = false\n"E[XYZ]0S" = false\n'
    one = {"P1": SPHERES["P1"]}
    model, found, seen = decide(
        STRUCTURES["table and head"], functions, spheres=one, tools=TOOLS[:1], nest_u=float("inf")
    )
    assert 13 - defect(model, found) == 7 and {"EA0B", "EA0Z"} <= set(found.undetermined)
    check_against_differences(model, found, seen, one, nest=True)


def test_squareness_alone_is_seen_by_turning_the_table():
    """The three squarenesses are among the eight: none is undetermined."""
    functions = MOTIONS_OFF + "EC0S = false\n"
    one = {"P1": SPHERES["P1"]}
    _, found, _ = decide(TILTING, functions, spheres=one, tools=TOOLS[:1], nest_u=float("inf"))
    assert not {"EC0Y", "EA0Z", "EB0Z"} & set(found.undetermined)


def test_place_of_a_head_is_named_as_the_place_of_the_sphere():
    _model, found, _ = decide(FORK, MOTIONS_OFF + LINEAR_OFF)
    (statement,) = found.statements
    assert statement.startswith("EX0C, EY0C, EZ0A: same as the unknown place of the sphere on the workpiece")
    assert "set EX0C = false" in statement and "one sphere" not in statement


def test_too_many_segments_for_the_positions_are_named():
    """13 positions of the tilting axis cannot carry 12 cubic segments, 15 coefficients."""
    exact = exact_machine(TILTING)
    machine = resolved(exact, '"E?[XYZ]" = false\n' + LINEAR_OFF, segments=12)
    data = r_test(exact, Truth(), np.random.default_rng(0), counts={"A": 13, "C": 15}, noise=0.0)
    campaign = r_test_campaign(machine, data, off_by=0.0)
    model = build_model(machine, {f"E{d}{a}": (12,) for d in "XYZABC" for a in machine.letters})
    found = analyse(build_problem(campaign, model), campaign)
    text = " ".join(found.statements)
    assert not found.full_rank
    assert "12 segments on axis A need at least 15 positions and 13 were measured" in text
    assert "axis C need" not in text  # periodic: 12 coefficients for 14 positions of a turn
