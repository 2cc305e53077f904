"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.etalon import ETALON
from volid.controllers.fanuc_3d import FANUC_3D
from volid.controllers.fanuc_pitch import FANUC_PITCH
from volid.controllers.heidenhain_com import HEIDENHAIN_COM
from volid.controllers.heidenhain_kinematicscomp import HEIDENHAIN_KINEMATICSCOMP
from volid.controllers.isg_crosscomp import ISG_CROSSCOMP
from volid.controllers.isg_ssfk import ISG_SSFK
from volid.controllers.isg_volcomp import ISG_VOLCOMP
from volid.controllers.linuxcnc import LINUXCNC
from volid.controllers.linuxcnc_hal import LINUXCNC_HAL
from volid.controllers.linuxcnc_matrixkins import MATRIXKINS
from volid.controllers.neutral_csv import NEUTRAL_CSV
from volid.controllers.neutral_hdf5 import NEUTRAL_HDF5
from volid.controllers.pmac import PMAC
from volid.controllers.sinumerik_cec import SINUMERIK_CEC
from volid.controllers.sinumerik_enc_comp import SINUMERIK_ENC_COMP
from volid.controllers.twincat_nc import TWINCAT_NC

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
