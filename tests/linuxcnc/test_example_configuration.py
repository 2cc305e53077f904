"""The configuration in `examples/linuxcnc/sim` starts as it stands, but for the screen, and applies its grid."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from support import linuxcnc_simulator as simulator
from support.places import ROOT
from support.volumetric import corrections

from volid.controllers.linuxcnc.hal.wiring import wiring

EXAMPLE = ROOT / "examples" / "linuxcnc"
SIM = EXAMPLE / "sim"


def test_its_wiring_is_that_of_today():
    lines = wiring({"L-VOL": "l_vol.grid"}, {"X": 0, "Y": 1, "Z": 2})
    assert (SIM / "volid_grid.hal").read_text(encoding="utf-8") == lines


@pytest.mark.slow
@simulator.needs_linuxcnc
@simulator.needs_compiler
def test_it_starts_and_applies_its_grid():
    asked = np.array([[150.0, 60.0, -77.0], [420.0, 330.0, -210.0]])
    steps = [{"home": True, "wait": 1.2}, *({"mdi": f"G53 G0 X{x} Y{y} Z{z}"} for x, y, z in asked)]
    pins = [f"drive.{a}.out" for a in "xyz"]
    nothing = simulator.Setup((), files={"volid_grid.h": (EXAMPLE / "volid_grid.h").read_text(encoding="utf-8")})
    with tempfile.TemporaryDirectory(prefix="volid-linuxcnc-") as place, simulator.alone():
        folder = Path(place)
        folder.chmod(0o755)
        simulator.write(nothing, folder)
        for file in SIM.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
        ini = (folder / "machine.ini").read_text(encoding="utf-8")
        (folder / "machine.ini").write_text(ini.replace("DISPLAY = axis", "DISPLAY = ./screen"), encoding="utf-8")
        (folder / "task.json").write_text(json.dumps({"steps": steps, "pins": pins, "seconds": 40}), encoding="utf-8")
        simulator.compile_components([EXAMPLE / "volid_grid.comp"], folder)
        printed = simulator.start(folder, 60, own_modules=True)
        rows = np.array(simulator.answered(folder, printed, ()).rows)[1:]
    field = corrections((SIM / "l_vol.grid").read_text(encoding="utf-8"))
    np.testing.assert_allclose(rows, asked + field(asked), rtol=0, atol=1e-6)
    assert np.abs(field(asked)).max() > 0.01
