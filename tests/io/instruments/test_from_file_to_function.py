"""From the file of a laser to error functions: what the fit finds is what a closed form of the readings demands.

Vertical machine [w Y' X' b Z t]. Along X, with the others still at (Y, Z), the functional point of tool (a, b, c) reads
EXX + EBX · (Z + c) - ECX · b in X (CONVENTIONS 3: for a workpiece-side axis the lever arm is measured in the table).
All functions are quadratic, which splines follow exactly, so that 1 nm and 1 nrad are rounding of the file.
"""

import numpy as np
import pytest
from support.instrument_files import run_file
from support.places import MODELS

import volid
from volid.exceptions import InputError
from volid.io.campaign.imported import import_files

TEXT = (MODELS / "wYXbZt_vertical.toml").read_text(encoding="utf-8")
X = np.linspace(0.0, 1000.0, 11)
MIDDLE = 500.0  # reference of X: functions are zero there
REVERSAL = 4e-3  # mm: B = E(+) - E(-)
AT = {"Y": 300.0, "Z": -250.0}


def exx(x):
    """mm."""
    return 2e-5 * (x - MIDDLE) + 3e-8 * (x - MIDDLE) ** 2


def ebx(x):
    """rad."""
    return 4e-8 * (x - MIDDLE) - 5e-11 * (x - MIDDLE) ** 2


def machine(folder, functions):
    """The machine with a model of some functions of X only."""
    path = folder / "machine.toml"
    path.write_text(
        TEXT + f'\n[model]\nsegments = 2\n[model.functions]\n"E**" = false\n"E*0*" = false\n{functions}',
        encoding="utf-8",
    )
    return path


def written(folder, name, readings, runs=4, **options):
    """A file of runs whose deviations are `readings(x, direction)` in the unit of the file."""
    values = [readings(X, 1 if run % 2 == 0 else -1) for run in range(runs)]
    (folder / name).write_text(run_file(values, X, file_type=name.split(".")[1], **options), newline="")
    return folder / name


def found(solution, name, direction=0):
    """A function at the targets [mm or rad]."""
    rows = [f for f in solution.functions(step=100.0) if f.name == name and f.direction == direction]
    np.testing.assert_allclose([f.position for f in rows], X)
    return np.array([f.value for f in rows])


def test_positioning_and_reversal_of_a_file_are_those_of_the_fit(run, tmp_path):
    model = machine(tmp_path, "EXX = { segments = 2, reversal = true }\n")
    file = written(
        tmp_path, "x.rtl", lambda x, d: 1e3 * (exx(x) + d * REVERSAL / 2) + 7.0
    )  # 7 µm: where the laser began
    line = ["--at", "Y=300,Z=-250", "--tool", "0,0,-150", "--u", "0.0001"]
    assert run("import", file, "--machine", model, *line, "-o", tmp_path / "c.h5")[0] == 0
    solution = volid.fit(volid.load_campaign(tmp_path / "c.h5"))
    up, down = found(solution, "EXX", 1), found(solution, "EXX", -1)
    np.testing.assert_allclose((up + down) / 2, exx(X), atol=1e-6)
    np.testing.assert_allclose(up - down, REVERSAL, atol=1e-6)


def test_two_lines_at_different_tools_give_the_angle_between_them(tmp_path):
    """Abbe's arm: two tools 200 mm apart along Z see pitch as a difference of positions."""
    model = machine(tmp_path, "EXX = { segments = 2 }\nEBX = { segments = 2 }\n")
    sets = []
    for name, length in (("short", -150.0), ("long", -350.0)):
        arm = AT["Z"] + length
        file = written(tmp_path, f"{name}.rtl", lambda x, d, arm=arm: 1e3 * (exx(x) + arm * ebx(x)))
        sets.append(import_files([file], model, {"axis": "X", "at": AT, "tool": [0, 0, length], "u": 1e-4}))
    for part in sets:
        volid.save_campaign(part, tmp_path / f"{part.sets[0].name}.h5")
    solution = volid.fit(volid.load_campaign(tmp_path / "short.h5", tmp_path / "long.h5"))
    np.testing.assert_allclose(found(solution, "EBX"), ebx(X), atol=1e-8)
    np.testing.assert_allclose(found(solution, "EXX"), exx(X), atol=4e-6)


@pytest.mark.parametrize("unit", ["mrad", "arcsec"])
def test_positions_and_angles_of_two_files_fit_together(unit, tmp_path):
    factor = {"mrad": 1e3, "arcsec": 648000 / np.pi}[unit]
    model = machine(tmp_path, "EXX = { segments = 2 }\nEBX = { segments = 2 }\n")
    written(tmp_path, "x.rtl", lambda x, d: 1e3 * (exx(x) + (AT["Z"] - 150.0) * ebx(x)))
    written(tmp_path, "x.rta", lambda x, d: factor * ebx(x))
    (tmp_path / "c.toml").write_text(
        'format = "volid-campaign/1"\nmachine = "machine.toml"\n'
        '[[set]]\nname = "position"\nfile = "x.rtl"\nas = "rtl"\nat = { Y = 300.0, Z = -250.0 }\ntool = [0, 0, -150]\nu = 1e-4\n'
        '[[set]]\nname = "pitch"\nfile = "x.rta"\nas = "rta"\nat = { Y = 300.0, Z = -250.0 }\ntool = [0, 0, -150]\nu = 1e-6\n'
        f'component = "B"\nunit = "{unit}"\n',
        encoding="utf-8",
    )
    solution = volid.fit(volid.load_campaign(tmp_path / "c.toml"))
    np.testing.assert_allclose(found(solution, "EBX"), ebx(X), atol=2e-9)
    np.testing.assert_allclose(found(solution, "EXX"), exx(X), atol=2e-6)
    assert model.exists()


def test_a_file_in_another_unit_than_assumed_is_asked_about(tmp_path):
    """Microradians taken for milliradians are a thousand times too large, which no machine's errors are."""
    model = machine(tmp_path, "EBX = { segments = 2 }\n")
    file = written(tmp_path, "x.rta", lambda x, d: 1e6 * ebx(x))
    campaign = import_files([file], model, {"axis": "X", "at": AT, "tool": [0, 0, -150], "u": 1e-6, "component": "B"})
    with pytest.raises(
        InputError, match=r"x\.rta, row \d+: value .* lies more than 1 mrad from the middle of its line"
    ):
        volid.fit(campaign)
