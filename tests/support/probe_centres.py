"""A touch probe on a machine whose control has its tool-centre-point function on, played by the exact chain."""

import numpy as np
from exact_chain import machine_toml

from support.rtests import following, index_grid

TOOL = np.array([0.0, 0.0, -230.0])
SPHERE = np.array([40.0, -60.0, 90.0])
ORIGIN = np.array([15.0, -5.0, 100.0])
COUNTS = {"A": 5, "B": 5, "C": 9}
ONLY_LOCATIONS = '[model]\nsegments = 4\n[model.functions]\n"E??" = false\n"E?0[XYZ]" = false\n'
MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
[[set]]
name = "probe"
kind = "displacement"
file = "{file}"
tool = [0.0, 0.0, -230.0]
u = 0.005
{keys}
"""
TCP = 'centres = true\ncolumns = { B = "B_deg", C = "C_deg", x = "x_mm", y = "y_mm", z = "z_mm" }\nignore = ["seq"]'
TRUE = {"EA0B": 80e-6, "EC0B": -60e-6, "EX0B": 0.05, "EA0C": 40e-6, "EB0C": 90e-6}


def probed(exact, truth):
    """Axis positions at which the probe's centre really is the sphere's (what a perfect touch probe finds), (m, n_axes)."""
    q = following(exact, index_grid(exact, COUNTS), TOOL, SPHERE)
    columns = [exact.column(a) for a in "XYZ"]
    for _ in range(4):  # the nominal step leaves a 1e-4 part of the distance
        missing = SPHERE - exact.functional_point(q, TOOL, truth)
        nominal = exact.functional_point(q, TOOL)
        q[:, columns] = following(exact, q, TOOL, nominal + missing)[:, columns]
    assert np.abs(exact.functional_point(q, TOOL, truth) - SPHERE).max() < 1e-10
    return q


def write(folder, exact, q, keys=TCP, header=None, origin=0.0, extra=ONLY_LOCATIONS, cells=None):
    """Files of a campaign; by default the control's tool-tip coordinates under the names of its own."""
    tip = exact.functional_point(q, TOOL) - origin
    rotary = [a for a in exact.axes if a in "ABC"]
    if cells is None:
        cells = np.column_stack([np.arange(len(q)), q[:, [exact.column(a) for a in rotary]], tip])
        header = ["seq", *(f"{a}_deg" for a in rotary), "x_mm", "y_mm", "z_mm"]
    (folder / "far").mkdir(exist_ok=True)
    lines = [",".join(header), *(",".join(repr(float(v)) for v in row) for row in cells)]
    (folder / "far" / "centres.csv").write_text("\n".join(lines) + "\n")
    (folder / "machine.toml").write_text(machine_toml(exact, extra=extra))
    (folder / "campaign.toml").write_text(MANIFEST.format(file="far/centres.csv", keys=keys))
    return folder / "campaign.toml"
