"""The contract of controls: what every control in the table keeps, whatever its files look like."""

import time

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, spatial
from support.control_contract import (
    ALL,
    BY_HAND,
    NEEDED,
    SMALL,
    TRUNNION,
    Case,
    allowance,
    asked,
    between,
    deviation,
    held,
    left,
    places,
    shifts,
    signs_of,
    ways,
)
from support.machines import exact_of
from support.made_up import made_up
from support.mutated_text import mutated

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import TABLES, TYPES
from volid.controllers import CONTROLS
from volid.controllers.base import (
    ABSOLUTE,
    COLUMNS,
    CONTINUES,
    DOCUMENTED,
    EQUAL,
    FREE,
    HELD,
    INCREMENTAL,
    INFERRED,
    NO_REVERSAL,
    NOT_KNOWN,
    ONE_VALUE,
    OPEN,
    POSITION,
    ROLLS_OVER,
    RUN,
    options_of,
    sign_of,
)
from volid.controllers.export import export, write
from volid.controllers.handover.explain import explained
from volid.controllers.handover.sheet import checks_of, commissioning_sheet
from volid.exceptions import InputError, VolidError

NAMES = list(CONTROLS)
EACH = pytest.mark.parametrize("case", ALL, ids=str)
CONTROL = pytest.mark.parametrize("name", NAMES)


def files_of(case: Case, job=None) -> dict[str, str | bytes]:
    return {f.name: f.content for f in CONTROLS[case.control].write(case.job() if job is None else job).files}


def read(case: Case, files) -> Compensation:
    return CONTROLS[case.control].read(files, case.machine, {**case.job().options, "sign": case.sign})


def with_text(files, change) -> dict[str, str | bytes]:
    return {n: change(c) if isinstance(c, str) else c for n, c in files.items()}


@CONTROL
def test_something_is_written_for_it(name):
    assert [c for c in ALL if c.control == name], "no small case of tests/support/control_contract.py fits its types"


@CONTROL
def test_it_declares_everything(name):
    d = CONTROLS[name].declaration
    assert d.name == name and d.title and d.units and d.zero and d.switching and d.nearest
    assert d.sign in ("error", "compensation", POSITION, OPEN) and d.rows in (ABSOLUTE, INCREMENTAL)
    assert d.reversal in (COLUMNS, ONE_VALUE, NO_REVERSAL) and d.outside in (HELD, ROLLS_OVER, CONTINUES, NOT_KNOWN)
    assert d.spacing in (EQUAL, FREE) and all(q is None or q > 0 for q in d.quantum)
    assert d.most_points or d.limits, "what bounds the number of positions is said"
    assert d.carries and all(form in TYPES[kind].forms for kind, form in d.carries.items())
    assert d.commissioning.backup and d.commissioning.load and d.commissioning.activate and d.commissioning.remove


@CONTROL
def test_facts_have_a_basis_and_a_source(name):
    facts = CONTROLS[name].declaration.facts
    assert facts
    for fact in facts:
        assert fact.text and fact.basis in (DOCUMENTED, RUN, INFERRED, OPEN), fact
        assert fact.source or fact.basis == OPEN, f"no source: {fact.text}"
        assert "recalled" not in fact.text


@CONTROL
def test_options_have_a_meaning_and_are_checked(name):
    d = CONTROLS[name].declaration
    found = options_of(d, NEEDED.get(name, {}))
    assert set(found) == {o.name for o in d.options}
    with pytest.raises(InputError, match=f"{name}: option 'no_such_option' is unknown"):
        options_of(d, {"no_such_option": "1"})
    for option in d.options:
        assert option.meaning
        if option.convert is not str:
            with pytest.raises(InputError, match=f"option {option.name}"):
                options_of(d, {option.name: "\x01 no such thing"})


@CONTROL
def test_the_sign_is_stated_or_asked_for(name):
    d = CONTROLS[name].declaration
    if d.sign == OPEN:
        with pytest.raises(InputError, match=f"{name}: .*state `sign="):
            sign_of(d, None)
    else:
        with pytest.raises(InputError, match=f"{name}: `sign=nonsense`"):
            sign_of(d, "nonsense")


@CONTROL
def test_other_types_are_refused_and_the_nearest_named(name):
    d = CONTROLS[name].declaration
    solution = made_up(MACHINE)
    sign = None if d.sign != OPEN else "error"
    for kind in (k for k in TYPES if k not in d.carries):
        with pytest.raises(InputError) as caught:
            export(solution, name, [kind], sign=sign, options=NEEDED.get(name, {}))
        assert kind in str(caught.value) and d.nearest in str(caught.value)
        here, _, elsewhere = str(caught.value).partition(f"{kind} itself is carried by ")
        assert elsewhere.split(", ") == [n for n in NAMES if kind in CONTROLS[n].declaration.carries]
        part = {"L-VOL": "L-POS", "L-VOL+": "L-POS", "R-VOL": "R-POS", "R-VOL+": "R-POS"}.get(kind)
        if part in d.carries:
            assert "The nearest that it carries: " in here


@EACH
def test_it_moves_as_before_once_read_back(case):
    job = case.job()
    before, after = asked(case, job), held(case, job).control(case.machine)
    q = places(case.machine)
    shift = shifts(case, after.command(q, job.tool) - before.command(q, job.tool))
    for way in ways(case, *q.shape):
        if CONTROLS[case.control].declaration.reversal == ONE_VALUE and way.any():
            continue  # one value for the axis: see the test of it below
        off = np.abs(after.command(q, job.tool, way) - before.command(q, job.tool, way) - shift).max(axis=0)
        assert (off <= allowance(case, job)).all(), f"off by {off} in direction {way[0, 0]:+g}"


@pytest.mark.parametrize(
    "case", [c for c in ALL if CONTROLS[c.control].declaration.reversal == ONE_VALUE and c.type == "L-POS"], ids=str
)
def test_one_value_of_reversal_lies_between_those_of_the_table(case):
    job = case.job()
    after, q = held(case, job).control(case.machine), places(case.machine)
    up, down = (after.command(q, job.tool, np.full_like(q, w)) for w in (1.0, -1.0))
    for t in job.axis_tables():
        lost = (down - up)[
            :, case.machine.index(t.output)
        ]  # error(+) - error(-), because the command is minus the error
        assert np.ptp(lost) < 1e-8, "one value over the whole travel"
        values = t.forward - t.reverse
        quantum = CONTROLS[case.control].declaration.quantum[0] or 1e-8
        assert values.min() - quantum <= lost[0] <= values.max() + quantum


@EACH
def test_the_exact_chain_says_that_the_deviation_is_gone(case):
    """The sign, closed against a chain that shares no code: errors in, the files' motion, nothing left at the nodes."""
    d = CONTROLS[case.control].declaration
    if case.make is SMALL["R-POS", TABLES][0]:
        pytest.skip("angular positioning has no functional point of its own; see the next test")
    job = case.job()
    control, rng = held(case, job).control(case.machine), np.random.default_rng(2)
    q = np.stack([rng.choice(np.linspace(*a.travel, 3), 30) for a in case.machine.axes], axis=1)
    if not (d.products or d.model):  # tables without lever arms hold on their lines
        q[:, case.machine.index("Z")] = job.at[case.machine.index("Z")]
    shift = shifts(
        case, left(case, control, q, np.zeros_like(q))
    )  # of X, Y, Z, as the axes of this machine are directed
    for way in ways(case, *q.shape):
        if d.reversal != COLUMNS and way.any():
            continue
        rest = np.abs(left(case, control, q, way) - shift).max()
        # 5e-7 mm: the error at the moved place, slopes up to 40 µrad over 12 µm; where all is shifted, over as much again
        slope = 5e-7 * (1 + d.zero_fixed)
        assert rest <= 3 * allowance(case, job).max() + slope, f"{1e3 * rest:.4f} µm left, direction {way[0, 0]:+g}"


@pytest.mark.parametrize("case", [c for c in ALL if c.rotary], ids=str)
def test_a_rotary_axis_is_turned_back(case):
    """C shall stand at 180° and is 40 µrad too far: the command is 40 µrad less, in degrees."""
    control = held(case, case.job()).control(case.machine)
    q = case.machine.order(X=0.0, Y=0.0, Z=275.0, A=0.0, C=180.0)[None]
    i = case.machine.index("C")
    step = control.command(q, None)[0, i] - 180.0
    along = case.machine.axes[i].unit_vector[2]
    assert step == pytest.approx(-np.rad2deg(40e-6) * along, abs=allowance(case, case.job())[i])


@EACH
def test_what_was_read_is_written_again_as_the_same(case):
    first = held(case, case.job())
    again = held(case, case.job(first))
    q = places(case.machine)
    for way in ways(case, *q.shape):
        ones, others = (c.control(case.machine).command(q, case.job().tool, way) for c in (first, again))
        np.testing.assert_allclose(ones, others, rtol=0, atol=2e-9)


@EACH
def test_values_are_multiples_of_the_quantum(case):
    length, angle = CONTROLS[case.control].declaration.quantum
    found = held(case, case.job())
    for t in (t for t in found.axis_tables if t.factor is None):
        least = length if case.machine.axis(t.output).is_linear else angle
        if least is not None:
            both = CONTROLS[case.control].declaration.reversal == COLUMNS
            held_as = [(t.forward, t.reverse)] if both else [(t.mean,), (t.forward,)]  # with one value beside: either
            off = [max(np.abs(v / least - np.round(v / least)).max() for v in values) for values in held_as]
            assert min(off) < 1e-4
    for grid in found.grids:
        if length is not None:
            steps = grid.values[:, :3] / length
            np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)


@CONTROL
def test_too_many_positions_are_refused(name):
    d = CONTROLS[name].declaration
    if d.most_points is None:
        pytest.skip("it has no limit of positions")
    case = next(c for c in ALL if c.control == name)
    n = d.most_points + 1
    x = np.linspace(0.0, 1000.0, n)
    function = next((f for k, f in {"L-POS": "EXX", "L-STR": "EZX"}.items() if d.carries.get(k) == TABLES), None)
    many = spatial((x, (0.0, 600.0), (-500.0, 0.0)))
    if function is not None:
        many = Compensation(("L-POS",), (error_table(function, x, 1e-5 * x),), ())
    with pytest.raises(InputError, match=rf"{name}: .*{n:,}|{name}: .*{n}"):
        CONTROLS[name].write(case.job(many))


@CONTROL
def test_ends_are_held_as_declared(name):
    d = CONTROLS[name].declaration
    if d.outside != HELD or d.carries.get("L-POS") != TABLES:
        pytest.skip(f"beyond the ends: {d.outside}; tables of positions: {d.carries.get('L-POS')}")
    for sign in signs_of(d):
        case = Case(name, "L-POS", SMALL["L-POS", TABLES][0], sign)
        part = Compensation(("L-POS",), (error_table("EXX", [200, 500, 800], [0.004, 0.010, -0.006]),), ())
        control = held(case, case.job(part)).control(MACHINE)
        i, allowed = MACHINE.index("X"), allowance(case, case.job(part)).max()
        q = np.stack([MACHINE.order(X=x, Y=300.0, Z=-250.0) for x in (0.0, 199.0, 801.0, 1000.0)])
        step, wanted = control.command(q, case.job().tool)[:, i] - q[:, i], np.array([-0.004, -0.004, 0.006, 0.006])
        np.testing.assert_allclose(step - (step - wanted)[0] * d.zero_fixed, wanted, atol=allowed)


@EACH
def test_carriage_returns_change_nothing(case):
    files = files_of(case)
    once, twice = read(case, files), read(case, with_text(files, lambda text: text.replace("\n", "\r\n")))
    q = places(case.machine)
    for way in ways(case, *q.shape):
        same = [c.control(case.machine).command(q, case.job().tool, way) for c in (once, twice)]
        np.testing.assert_array_equal(*same)


@EACH
def test_damaged_files_are_refused_or_read_never_anything_else(case):
    rng, files = np.random.default_rng(11), files_of(case)
    as_bytes = {n: c if isinstance(c, bytes) else c.encode() for n, c in files.items()}
    begin = time.process_time()
    for _ in range(40):
        name = sorted(files)[rng.integers(len(files))]
        damaged = {**as_bytes, name: mutated(as_bytes[name], rng)}
        try:
            found = read(case, damaged)
        except VolidError as error:
            assert str(error)
            continue
        values = [v for t in found.axis_tables for v in (t.positions, t.forward, t.reverse)]
        values += [v for t in found.tables for v in (t.positions, t.forward, t.reverse)]
        assert all(np.isfinite(v).all() and (np.abs(v) < 1e9).all() for v in values)
        assert all(np.all(np.diff(t.positions) > 0) for t in (*found.axis_tables, *found.tables))
    assert time.process_time() - begin < 20.0


@EACH
def test_an_empty_file_and_one_of_letters_are_refused(case):
    files = files_of(case)
    data = {n: c for n, c in files.items() if isinstance(c, str)}
    for content in ("", "lorem ipsum dolor sit amet\n" * 3):
        with pytest.raises(InputError):
            read(case, {**files, **dict.fromkeys(data, content)} if data else dict.fromkeys(files, content.encode()))


@CONTROL
def test_files_written_out_by_hand_from_its_documentation_move_the_axes_so(name):
    """A sign that is wrong in writing and in reading alike shows here alone."""
    folder = BY_HAND / name
    assert (folder / "case.txt").exists(), f"write {folder}: the files as the documentation wants them, and case.txt"
    words = (folder / "case.txt").read_text(encoding="utf-8").split()
    case = next(
        c for c in ALL if c.control == name and c.make.__name__ == words[0] and c.sign in (words[1:] or [c.sign])
    )
    files = {p.name: p.read_bytes() for p in folder.iterdir() if p.name != "case.txt"}
    found, q = read(case, files).control(case.machine), places(case.machine)
    tool = case.job().tool
    shift = shifts(case, found.command(q, tool) - asked(case, case.job()).command(q, tool))
    for way in ways(case, *q.shape):
        if CONTROLS[name].declaration.reversal == COLUMNS or not way.any():
            wanted = asked(case, case.job()).command(q, tool, way)
            off = np.abs(found.command(q, tool, way) - wanted - shift).max(axis=0)
            assert (off <= allowance(case, case.job())).all()


@EACH
def test_the_sheet_has_one_sign_check_for_each_table_that_takes_the_deviation_off(case):
    """What the sheet says an axis must move by is minus what the exact chain finds there along that axis."""
    job = case.job()
    made = write(CONTROLS[case.control], job, case.make().names)
    checks = checks_of(made)
    moving = [t for t in made.held.axis_tables if np.any(t.forward) or np.any(t.reverse)]
    assert len(checks) >= len(moving) + bool(made.held.grids) + bool(made.held.tables)
    exact, machine = exact_of(case.machine), case.machine
    own = held(case, job).control(machine)
    for check in checks:
        q = machine.order(**check.at)[None]
        way = np.full_like(q, check.way)
        i = machine.index(check.axis)
        if machine.axes[i].is_linear:
            error = deviation(case, exact, q, way)[0] if made.held.tables else between(case, exact, q, way)[0]
            along = (
                exact.functional_point(q + np.eye(len(q[0]))[i], job.tool)[0] - exact.functional_point(q, job.tool)[0]
            )
            nodes = machine.order(**{a.letter: a.travel[0] for a in machine.axes})[None]
            shift = shifts(case, left(case, own, nodes, np.zeros_like(q)))
            assert check.together == pytest.approx((shift - error) @ along, abs=5e-7 + 3 * allowance(case, job)[i])
        seen = check.together if check.is_together else check.alone
        assert f"{seen:+.4f}" in commissioning_sheet(made) or not machine.axes[i].is_linear


@EACH
def test_grids_are_called_by_the_type_and_tool_vector_that_they_were_written_for(case):
    made = write(CONTROLS[case.control], case.job(), case.make().names)
    for grid in (g for g in made.held.grids if not np.any(g.values[:, 3:])):
        assert grid.type in case.make().names and tuple(grid.tool) == tuple(case.job().tool)


@EACH
def test_an_open_sign_is_never_called_known(case):
    """What the user stated stands in the files' papers as stated: nobody knows what the control does with it."""
    made = write(CONTROLS[case.control], case.job(), case.make().names)
    rows = [line for line in commissioning_sheet(made).splitlines() if line.startswith("| sign ")]
    opened = made.declaration.sign == OPEN
    assert len(rows) == 1 and opened == ("as it was stated" in rows[0])
    assert not opened or ("takes them off" not in rows[0] and "adds them" not in rows[0])


@EACH
def test_the_sheet_says_everything_that_one_person_needs(case):
    made = write(CONTROLS[case.control], case.job(), case.make().names)
    text, d = commissioning_sheet(made), made.declaration
    for part in (*d.commissioning.backup, *d.commissioning.load, *d.commissioning.activate, *d.commissioning.remove):
        assert part in text
    assert all(f.name in text for f in made.written.files)
    assert all(name in text and value in text for name, value, _ in made.written.parameters)
    assert all(f.basis[1:] in text for f in d.facts) and d.switching[1:] in text
    assert all(len(line) < 1200 for line in text.splitlines())


@CONTROL
def test_it_is_explained(name):
    d, text = CONTROLS[name].declaration, explained(CONTROLS[name])
    assert text.startswith(f"# {name}: ") and all(kind in text for kind in d.carries) and d.nearest in text
    assert all(o.name in text for o in d.options) and all(f.basis[1:] in text and f.text in text for f in d.facts)


@CONTROL
def test_a_whole_solution_is_exported_and_held(name):
    d = CONTROLS[name].declaration
    machine = volid.load_machine("models/wCAYXbZt_trunnion.toml") if all(k[0] == "R" for k in d.carries) else MACHINE
    made = export(made_up(machine), name, sign="error" if d.sign == OPEN else None, options=NEEDED.get(name, {}))
    assert made.written.files and made.types and all(f.what for f in made.written.files)
    job = made.job
    case = Case(name, made.types[0], spatial, job.sign)
    tools = np.tile(job.tool, (len(places(machine)), 1))
    before, after = asked(case, job).command(places(machine), tools), made.control().command(places(machine), tools)
    off = after - before
    assert (np.abs(off - shifts(case, off)).max(axis=0) <= allowance(case, job)).all()


# what holds a machine with few errors, but not one with all of them, and what is said then
FULL = {("isg-crosscomp", "L-ANG"): "one table over one axis and one over two for each axis. isg-volcomp carries this"}
EVERY = [(name, kind) for name, c in CONTROLS.items() for kind in c.declaration.carries]


@pytest.mark.slow
@pytest.mark.parametrize("name, kind", EVERY, ids=lambda text: text)
def test_every_type_that_it_declares_is_written_and_held(name, kind):
    """On a five-axis machine with random errors, at few points: what the files hold moves the axes as what was written."""
    d = CONTROLS[name].declaration
    machine = TRUNNION if kind.startswith("R-") or "+" in kind or kind == "FOR" else MACHINE
    solution = made_up(machine)
    functions = {"L-SPEC": ["EXX", "EYX"], "R-SPEC": ["EXC", "EAC"]}.get(kind, [])
    base = volid.compensation_base(solution, (0.0, 0.0, -150.0), functions=functions)
    sign = "error" if d.sign == OPEN else None
    asked_for = {"base": base, "sampling": Sampling(max_points=5), "sign": sign, "options": NEEDED.get(name, {})}
    ranges = {"A": (0.0, 30.0)} if machine is TRUNNION else None
    if (name, kind) in FULL:
        with pytest.raises(InputError, match=FULL[name, kind]):
            export(solution, name, [kind], ranges=ranges, **asked_for)
        return
    made = export(solution, name, [kind], ranges=ranges, **asked_for)
    assert made.types == (kind,) and made.written.files
    case, q = Case(name, kind, spatial, made.job.sign), places(machine)
    q[:, [machine.index(a) for a in "AC" if a in machine.letters]] = 17.0
    before, after = (c.command(q, made.job.tool) for c in (asked(case, made.job), made.control()))
    off = after - before
    assert (np.abs(off - shifts(case, off)).max(axis=0) <= allowance(case, made.job)).all()
