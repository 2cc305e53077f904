"""Small compensations with round numbers, from which files of controls can be written out by hand."""

import numpy as np

import volid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of, sign_of

MACHINE = volid.load_machine("models/wYXbZt_vertical.toml")  # X 0..1000, Y 0..600, Z -500..0 mm
TOOL = np.array([0.0, 0.0, -150.0])
AT = MACHINE.order(X=500.0, Y=300.0, Z=-250.0)


def error_table(function: str, positions, forward, reverse=None, kind: str = "L-POS") -> ErrorTable:
    """A table of error values [mm or rad]."""
    x = np.array(positions, dtype=float)
    up = np.array(forward, dtype=float)
    down = up if reverse is None else np.array(reverse, dtype=float)
    return ErrorTable(kind, function, x, up, down, np.zeros((len(x), 2)), x > 1e9, "kinematic model", 0.0)


def pitch() -> Compensation:
    """Positioning of X and Y with different reversal: X is 10 µm too far at 500 in +, 13 µm in -."""
    x = error_table("EXX", [0, 500, 1000], [0.0, 0.010, -0.004], [0.002, 0.013, -0.001])
    y = error_table("EYY", [0, 300, 600], [-0.006, 0.0, 0.012])
    return Compensation(("L-POS",), (x, y), ())


def crossed() -> Compensation:
    """Squareness of 20 µrad of X over Y, straightness of Z over X, positioning of X."""
    tables = (
        error_table("EXX", [0, 500, 1000], [0.0, 0.010, -0.004]),
        error_table("EZX", [0, 500, 1000], [0.0, 0.003, 0.0], kind="L-STR"),
        error_table("EXY", [0, 300, 600], [-0.006, 0.0, 0.006], kind="L-SQU"),
    )
    return Compensation(("L-POS", "L-STR", "L-SQU"), tables, ())


def levered() -> Compensation:
    """Pitch of Y of 20 µrad at its upper end, which moves Y and Z through lever arms."""
    return Compensation(("L-VOL",), (error_table("EAY", [0, 300, 600], [0.0, 0.0, 20e-6], kind="L-VOL"),), ())


def spatial(nodes=((0.0, 500.0, 1000.0), (0.0, 600.0), (-500.0, 0.0))) -> Compensation:
    """A grid over X, Y, Z: dX = 10 µm times X/1000, dY = -5 µm times Z/500, dZ = 2 µm everywhere; rotations 0."""
    lines = tuple(np.array(n, dtype=float) for n in nodes)
    mesh = np.stack([m.ravel(order="F") for m in np.meshgrid(*lines, indexing="ij")], axis=1)
    values = np.zeros((len(mesh), 6))
    values[:, 0], values[:, 1], values[:, 2] = 0.010 * mesh[:, 0] / 1000, -0.005 * mesh[:, 2] / 500, 0.002
    known = np.zeros(len(mesh), dtype=bool)
    tool = tuple(TOOL.tolist())
    grid = volid.Grid(
        "L-VOL", ("X", "Y", "Z"), lines, mesh, values, np.full_like(values, np.nan), known, tool, "machine", ""
    )
    return Compensation(("L-VOL",), (), (grid,))


def job(name: str, made: Compensation, sign: str | None = None, machine=MACHINE, **options) -> Job:
    """What is to be written for a control, with its options."""
    declared = CONTROLS[name].declaration
    at = AT if machine is MACHINE else np.array([np.mean(a.travel) for a in machine.axes])
    return Job(machine, made, at, TOOL, sign_of(declared, sign), options_of(declared, options))


def written(name: str, made: Compensation, sign: str | None = None, **options) -> dict[str, str | bytes]:
    """The files of a control, content by name."""
    return {f.name: f.content for f in CONTROLS[name].write(job(name, made, sign, **options)).files}
