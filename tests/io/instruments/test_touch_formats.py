"""MSR files and LinuxCNC logs of touches: from the simulated machine through file, import and fit to its location errors."""

import numpy as np
import pytest
from exact_chain import Truth, machine_toml
from support.machines import STRUCTURES, VERTICAL, exact_machine
from support.probe_centres import ONLY_LOCATIONS, TRUE
from support.touch_files import ORIGIN, linuxcnc, msr, msr_positions, save
from support.touch_probe import touch

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io.campaign.imported import import_files

TABLE = {"EY0C": 0.02, "EB0C": 50e-6, "EZ0A": -0.03, "EB0A": -40e-6, "EC0A": 60e-6}  # what one tool vector tells
KEYS = {"tool": [0.0, 0.0, -230.0], "origin": ORIGIN.tolist()}
POSES = {"A": 4, "B": 5, "C": 6}


def played(structure, truth):
    exact = exact_machine(STRUCTURES[structure])
    return exact, touch(exact, Truth({}, truth), np.random.default_rng(21), POSES)


@pytest.fixture(scope="module")
def head():
    return played("fork head CB", TRUE)


@pytest.fixture(scope="module")
def table():
    return played("tilting table C'A'", TABLE)


def imported(folder, exact, name, lines, **keys):
    machine = folder / "machine.toml"
    machine.write_text(machine_toml(exact, extra=ONLY_LOCATIONS))
    return import_files([save(folder / name, lines)], machine, KEYS | keys)


def recovers(campaign, truth):
    solution = fit(campaign)
    assert not solution.adequacy.rejected
    for name, true in truth.items():
        found = location_parameter(solution, name)
        second_order = (
            5e-8 if "0" in name and name[1] in "ABC" else 2e-5
        )  # products of location errors of some 100 µrad
        assert abs(found.value - true) < 3.5 * found.u + second_order, name
        assert found.u < (3e-6 if name[1] in "ABC" else 1.5e-3), name


def test_msr_of_a_table_gives_its_location_errors(table, tmp_path):
    exact, data = table
    save(tmp_path / "poses.csv", msr_positions(exact, data))
    campaign = imported(tmp_path, exact, "spheres.msr", msr(exact, data), positions=str(tmp_path / "poses.csv"))
    (readings,) = campaign.sets
    assert len(readings) == 48 and campaign.conditions["imported"]["spheres"]["as"] == "msr"
    assert campaign.conditions["imported"]["spheres"]["timestamp"] == "261128 101500"
    recovers(campaign, TABLE)


def test_linuxcnc_log_of_a_head_gives_its_location_errors(head, tmp_path):
    exact, data = head
    campaign = imported(tmp_path, exact, "probe.txt", linuxcnc(exact, data), coordinates="tip", gap=40.0)
    assert campaign.conditions["imported"]["probe"]["as"] == "linuxcnc"
    recovers(campaign, TRUE)


@pytest.mark.parametrize(("form", "unit", "factor"), [("axes", "mm", 1.0), ("tip", "inch", 1 / 25.4)])
def test_forms_and_units_of_a_log_give_the_same_centres(head, form, unit, factor, tmp_path):
    exact, data = head
    lines = linuxcnc(exact, data, form, factor)
    (found,) = imported(tmp_path, exact, "probe.txt", lines, coordinates=form, unit=unit, gap=40.0).sets
    (plain,) = imported(tmp_path, exact, "probe.txt", linuxcnc(exact, data), coordinates="tip", gap=40.0).sets
    np.testing.assert_allclose(found.positions, plain.positions, atol=3e-5)  # 1e-6 inch in a touch
    np.testing.assert_allclose(found.u, plain.u, rtol=0.02)


def test_msr_in_inches_and_with_windows_line_ends(table, tmp_path):
    exact, data = table
    poses = save(tmp_path / "poses.csv", msr_positions(exact, data))
    (plain,) = imported(tmp_path, exact, "a.msr", msr(exact, data), positions=str(poses)).sets
    lines = [line + "\r" for line in msr(exact, data, 1 / 25.4)]
    keys = {"positions": str(poses), "unit": "inch", "sphere_diameter": 25.4}
    (found,) = imported(tmp_path, exact, "a.msr", lines, **keys).sets
    np.testing.assert_allclose(found.positions, plain.positions, atol=1e-3)  # 1e-5 inch in a touch


def test_old_logs_of_three_numbers_on_three_axes(tmp_path):
    spheres = {"a": np.array([100.0, 200.0, -400.0]), "b": np.array([330.0, 200.0, -400.0])}
    data = touch(VERTICAL, Truth(), np.random.default_rng(5), {}, spheres=spheres)
    lines = [" ".join(line.split()[:3]) for line in linuxcnc(VERTICAL, data, "axes")]
    (readings,) = imported(tmp_path, VERTICAL, "probe-results.txt", lines, coordinates="axes", gap=60.0).sets
    assert readings.labels["sphere"].tolist() == ["P1", "P2"]
    nominal = VERTICAL.functional_point(readings.positions, KEYS["tool"])
    assert np.abs(nominal - np.array(list(spheres.values()))).max() < 0.004  # three times u of a centre


def test_paths_are_told_apart_where_they_have_one_name(table, tmp_path):
    exact, data = table
    lines = [line if not line.startswith("TOOLPATH ") else "TOOLPATH sphere" for line in msr(exact, data)]
    rows = msr_positions(exact, data)
    renamed = [
        rows[0],
        *(
            ",".join(["sphere" if i == 1 else f"sphere ({i})", *row.split(",")[1:]])
            for i, row in enumerate(rows[1:], 1)
        ),
    ]
    save(tmp_path / "poses.csv", renamed)
    (readings,) = imported(tmp_path, exact, "a.msr", lines, positions=str(tmp_path / "poses.csv")).sets
    assert len(readings) == 48


def test_paths_without_positions_are_named(table, tmp_path):
    exact, data = table
    save(tmp_path / "poses.csv", msr_positions(exact, data)[:-5])
    campaign = imported(tmp_path, exact, "a.msr", msr(exact, data), positions=str(tmp_path / "poses.csv"))
    assert len(campaign.sets[0]) == 43
    assert any("5 without a position left out: P2 pose 44" in w for w in campaign.warnings)
    with pytest.raises(
        InputError, match=r"a.msr does not hold the positions of C, A; expected positions = a CSV with columns path,"
    ):
        imported(tmp_path, exact, "a.msr", msr(exact, data))
    save(tmp_path / "poses.csv", ["path,A,C", "other,0,0"])
    with pytest.raises(
        InputError, match=r"poses.csv: 0 of 48 names of the file are in column path; the file has P1 pose 1, .* other"
    ):
        imported(tmp_path, exact, "a.msr", msr(exact, data), positions=str(tmp_path / "poses.csv"))


MSR_DAMAGE = {
    "no z": (
        lambda line: line.partition(" Z")[0],
        r"row \d+: the measured point has no Z; expected X, Y and Z of the centre",
    ),
    "letters": (lambda line: line.replace("X", "Xx"), r"row \d+: X is 'x[^']*'; expected each letter once"),
    "comma": (lambda line: line.replace(".", ","), r"row \d+: X is '[^']*,[^']*'; expected each letter once"),
    "twice": (lambda line: line + " X3", r"row \d+: X stands twice"),
    "cut": (lambda line: line[:4], r"row \d+: 'G801' is cut off"),
    "another point": (
        lambda line: line.replace("N3", "N9"),
        r"row \d+: point 9 follows nominal point 3; "
        "expected the same number",
    ),
}


@pytest.mark.parametrize("what", MSR_DAMAGE)
def test_damaged_msr_names_its_row(table, what, tmp_path):
    exact, data = table
    damage, message = MSR_DAMAGE[what]
    lines = msr(exact, data)
    place = next(i for i, line in enumerate(lines) if line.startswith("G801 N3"))
    lines[place] = damage(lines[place])
    poses = save(tmp_path / "poses.csv", msr_positions(exact, data))
    with pytest.raises(InputError, match=message) as caught:
        imported(tmp_path, exact, "a.msr", lines, positions=str(poses))
    assert f"row {place + 1}:" in str(caught.value)


def test_shifted_work_plane_is_refused(table, tmp_path):
    exact, data = table
    lines = [line.replace("X0 Y0 Z0 I0", "X5 Y0 Z0 I0") for line in msr(exact, data)]
    with pytest.raises(InputError, match="the work plane is shifted by X, Y, Z; expected 0 for each"):
        imported(tmp_path, exact, "a.msr", lines)


def test_what_a_log_does_not_say_is_asked_for(head, tmp_path):
    exact, data = head
    lines = linuxcnc(exact, data)
    with pytest.raises(InputError, match="key 'coordinates' is missing; add \"tip\""):
        imported(tmp_path, exact, "p.txt", lines)
    with pytest.raises(InputError, match=r"three numbers a line, without positions of C, B; expected nine"):
        imported(tmp_path, exact, "p.txt", [" ".join(line.split()[:3]) for line in lines], coordinates="tip")
    with pytest.raises(InputError, match=r"B moves from -100 to 100, and the machine .* has no axis B"):
        imported(tmp_path, VERTICAL, "p.txt", lines, coordinates="tip")
    lines[30] = lines[30].replace(" ", " x", 1)
    with pytest.raises(InputError, match=r"p.txt, row 31: .* is damaged; expected 9 numbers"):
        imported(tmp_path, exact, "p.txt", lines, coordinates="tip")


def test_many_damages_end_in_messages(head, table, tmp_path):
    """Bytes, lines and words changed at random: a campaign or an `InputError`, nothing else."""
    rng, seen = np.random.default_rng(2), 0
    (exact, data), (other, touches) = head, table
    poses = str(save(tmp_path / "poses.csv", msr_positions(other, touches)))
    samples = [
        (exact, linuxcnc(exact, data)[:60], {"as": "linuxcnc", "coordinates": "tip"}),
        (other, msr(other, touches)[:180], {"as": "msr", "positions": poses}),
    ]
    for k in range(120):
        machine, lines, keys = samples[k % 2]
        text = bytearray("\n".join(lines).encode())
        for place in rng.integers(0, len(text), rng.integers(1, 6)):
            text[place] = rng.integers(1, 256) if k % 3 else rng.choice(list(b" .,-\n0G8NXe"))
        (tmp_path / "x.txt").write_bytes(bytes(text[: rng.integers(len(text) // 2, len(text))]))
        try:
            import_files([tmp_path / "x.txt"], _machine(tmp_path, machine), KEYS | keys)
        except InputError as error:
            seen += 1
            assert "x.txt" in str(error) or "poses.csv" in str(error)
    assert seen > 20


def _machine(folder, exact):
    path = folder / f"{exact.axes[0]}.toml"
    path.write_text(machine_toml(exact, extra=ONLY_LOCATIONS))
    return path
