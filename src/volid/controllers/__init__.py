"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.linuxcnc import LINUXCNC
from volid.controllers.linuxcnc_matrixkins import MATRIXKINS

CONTROLS: dict[str, Controller] = {c.declaration.name: c for c in (LINUXCNC, MATRIXKINS)}

__all__ = ["CONTROLS", "Controller"]
