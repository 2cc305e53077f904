"""Files of touches and of tracker points, composed from the published layouts; all data are synthetic."""

import numpy as np
from scipy.spatial.transform import Rotation

from support.probe_centres import TOOL
from support.touch_probe import BALL

ORIGIN = np.array([15.0, -5.0, 100.0])
NINE = "XYZABCUVW"


def tip(exact, data):
    """What a control with its tool-centre-point function shows, from its own zero, (n, 3) [mm]."""
    return exact.functional_point(data.q, TOOL) - ORIGIN


def msr(exact, data, factor=1.0, named=True):
    """Lines of an MSR file, one tool path for each group, its points in a tilted work plane; `factor`: mm to the file's unit."""
    lines, points = ["START", "DOCUMENTID 77", "TIMESTAMP 261128 101500"], tip(exact, data)
    for group in range(data.group.max() + 1):
        angles = (10.0 * (group % 7), -15.0 + group % 11, 30.0 * (group % 12))
        plane = Rotation.from_euler("xyz", angles, degrees=True)  # lower case: about fixed axes
        lines += [f"TOOLPATHID {1000 + group}"] + ([f"TOOLPATH {path_name(data, group)}"] if named else [])
        lines += ["G331 N1 A0 B0 C0 X+0.0 Y+0.0 Z+0.0"]
        lines += [f"G330 N1 A{angles[0]:+.4f} B{angles[1]:+.4f} C{angles[2]:+.4f} X0 Y0 Z0 I0 R0"]
        for number, i in enumerate(np.flatnonzero(data.group == group), start=1):
            x, y, z = factor * plane.inv().apply(points[i])
            i_, j, k = plane.inv().apply(data.normal[i])
            lines.append(f"G800 N{number} X{x:+.3f} Y{y:+.3f} Z{z:+.3f} I{i_:.6f} J{j:.6f} K{k:.6f} O0 U0.1 L-0.1")
            lines.append(f"G801 N{number} X{x:+.5f} Y{y:+.5f} Z{z:+.5f} R{factor * BALL:.4f}")
    return [*lines, "END"]


def path_name(data, group):
    """Name of the tool path of a group."""
    return f"{data.sphere[np.argmax(data.group == group)]} pose {group + 1}"


def msr_positions(exact, data):
    """Lines of a CSV with the rotary positions of every tool path."""
    rotary = [a for a in exact.axes if a in "ABC"]
    lines = [",".join(["path", *rotary])]
    for group in range(data.group.max() + 1):
        q = data.q[np.argmax(data.group == group)]
        lines.append(",".join([path_name(data, group), *(repr(float(q[exact.column(a)])) for a in rotary)]))
    return lines


def linuxcnc(exact, data, form="tip", factor=1.0):
    """Lines of a LinuxCNC log, nine numbers each."""
    places = tip(exact, data) if form == "tip" else data.q[:, [exact.column(a) for a in "XYZ"]] - ORIGIN
    values = np.zeros((len(data.q), 9))
    values[:, :3] = factor * places
    for a in exact.axes:
        if a in "ABC":
            values[:, NINE.index(a)] = data.q[:, exact.column(a)]
    return [" ".join(f"{v:.6f}" for v in row) for row in values]


def save(path, lines, end="\n"):
    path.write_bytes((end.join(lines) + end).encode())
    return path
