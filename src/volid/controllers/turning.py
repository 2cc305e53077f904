"""Grids of moves of the linear axes, on machines whose linear axes turn with a rotary axis.

A control without a kinematic model adds the values of such a grid to the axes themselves. Where an axis stands between workpiece
and rotary table, or between rotary head and tool, its direction in the machine turns, and so do its errors: the values hold with
the rotary axes at 0 alone, and elsewhere they move the wrong axes.
"""

from __future__ import annotations

from volid.compensation.grids.sides import turning_linear_axes
from volid.exceptions import InputError
from volid.model.machine import Machine


def refuse_turning(name: str, machine: Machine) -> None:
    """Raises `InputError` for the control `name` where linear axes of the machine turn with a rotary axis.

    >>> import volid
    >>> refuse_turning("fanuc-3d", volid.load_machine("models/wCAYXbZt_trunnion.toml"))
    """
    turning = turning_linear_axes(machine)
    if turning:
        carried = any(machine.axis(a).primed for a in turning)  # etalon and isg-volcomp refuse the whole machine then
        others = "" if carried else "isg-volcomp (option form=tables), etalon, "
        raise InputError(
            f"{name}: {', '.join(turning)} of '{machine.structure.strip()}' turn with a rotary axis; the control adds a grid to "
            "the axes and does not turn it, so that it would hold with the rotary axes at 0 alone. Tables of error functions "
            f"turn, and are carried by {others}heidenhain-kinematicscomp and csv"
        )
