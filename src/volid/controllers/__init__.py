"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.fanuc_3d import FANUC_3D
from volid.controllers.fanuc_pitch import FANUC_PITCH
from volid.controllers.linuxcnc import LINUXCNC
from volid.controllers.pmac import PMAC

CONTROLS: dict[str, Controller] = {c.declaration.name: c for c in (LINUXCNC, FANUC_PITCH, FANUC_3D, PMAC)}

__all__ = ["CONTROLS", "Controller"]
