"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.fanuc.pitch import FANUC_PITCH
from volid.controllers.fanuc.spatial import FANUC_3D
from volid.controllers.heidenhain.com import HEIDENHAIN_COM
from volid.controllers.heidenhain.kinematicscomp import HEIDENHAIN_KINEMATICSCOMP
from volid.controllers.isg.crosscomp import ISG_CROSSCOMP
from volid.controllers.isg.etalon import ETALON
from volid.controllers.isg.ssfk import ISG_SSFK
from volid.controllers.isg.volcomp import ISG_VOLCOMP
from volid.controllers.linuxcnc.hal_grid import LINUXCNC_HAL
from volid.controllers.linuxcnc.matrixkins import MATRIXKINS
from volid.controllers.linuxcnc.screw import LINUXCNC
from volid.controllers.neutral.csv_files import NEUTRAL_CSV
from volid.controllers.neutral.hdf5_files import NEUTRAL_HDF5
from volid.controllers.pmac.pmac import PMAC
from volid.controllers.sinumerik.cec import SINUMERIK_CEC
from volid.controllers.sinumerik.enc_comp import SINUMERIK_ENC_COMP
from volid.controllers.twincat.nc import TWINCAT_NC

CONTROLS: dict[str, Controller] = {
    c.declaration.name: c
    for c in (
        LINUXCNC,
        LINUXCNC_HAL,
        MATRIXKINS,
        ISG_VOLCOMP,
        ETALON,
        ISG_SSFK,
        ISG_CROSSCOMP,
        TWINCAT_NC,
        SINUMERIK_ENC_COMP,
        SINUMERIK_CEC,
        HEIDENHAIN_COM,
        HEIDENHAIN_KINEMATICSCOMP,
        FANUC_PITCH,
        FANUC_3D,
        PMAC,
        NEUTRAL_CSV,
        NEUTRAL_HDF5,
    )
}

__all__ = ["CONTROLS", "Controller"]
