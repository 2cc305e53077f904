"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.fanuc_3d import FANUC_3D
from volid.controllers.fanuc_pitch import FANUC_PITCH
from volid.controllers.linuxcnc import LINUXCNC
from volid.controllers.neutral_csv import NEUTRAL_CSV
from volid.controllers.neutral_hdf5 import NEUTRAL_HDF5
from volid.controllers.pmac import PMAC

CONTROLS: dict[str, Controller] = {
    c.declaration.name: c for c in (LINUXCNC, FANUC_PITCH, FANUC_3D, PMAC, NEUTRAL_CSV, NEUTRAL_HDF5)
}

__all__ = ["CONTROLS", "Controller"]
