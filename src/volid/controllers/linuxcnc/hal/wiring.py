"""The lines of a HAL file that put grids of corrections between the motor commands and the drives."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

COMPONENT = "volid_grid"
FADE = 1.0  # s in which corrections are put on and taken off


def instance(kind: str) -> str:
    """Name of the instance of the component that holds a type: volid-l-vol."""
    return f"volid-{kind.lower()}"


def wiring(files: Mapping[str, str], joints: Mapping[str, int]) -> str:
    """Lines for HAL: `files` by type (or a label such as L-VOL-2), numbers of the `joints` by axis letter.

    Instances form a chain: the corrections of one are added to those of the next, and the last one moves the joints.
    """
    names = [instance(t) for t in files]
    lines = [*_HEAD, f"loadrt {COMPONENT} names={','.join(names)} files={','.join(files.values())}"]
    lines += [f"addf {n}.command servo-thread" for n in names]
    lines.append(f"addf {names[-1]}.feedback servo-thread {-len(names) - 2}  # before motion-controller")
    lines += [f"setp {n}.fade-time {FADE}" for n in names]
    lines.append("net volid-homed motion.is-all-homed => " + " ".join(f"{n}.homed" for n in names))
    for letter, joint in joints.items():
        lines += ["", *_of_joint(names, letter.lower(), joint)]
    return "\n".join(lines) + "\n"


def _of_joint(names: list[str], axis: str, joint: int) -> list[str]:
    last = names[-1]
    lines = [f"net volid-{axis}-position joint.{joint}.pos-cmd => " + " ".join(f"{n}.pos-{axis}" for n in names)]
    for before, after in pairwise(names):
        lines.append(f"net {before}-{axis} {before}.d-{axis} => {after}.more-{axis}")
    return [
        *lines,
        f"net volid-{axis}-asked joint.{joint}.motor-pos-cmd => {last}.motor-in-{axis}",
        f"net volid-{axis}-motor {last}.motor-{axis}",
        f"net volid-{axis}-drive {last}.drive-{axis}",
        f"net volid-{axis}-feedback {last}.fb-{axis} => joint.{joint}.motor-pos-fb",
        f"# then, for the drive of {axis.upper()}:  net volid-{axis}-motor => its command pin",
        f"#                         net volid-{axis}-drive <= its feedback pin",
    ]


_HEAD = (
    "# Volumetric compensation by the component volid_grid (examples/linuxcnc of volid, built with halcompile).",
    "# In the HAL file of the machine:",
    "#     addf motion-command-handler servo-thread",
    "#     addf motion-controller servo-thread",
    "#     source volid_grid.hal                      <- straight after these, before what writes to the drives",
    "# setp volid-l-vol.enable 0 switches one compensation off, 1 on again.",
)
