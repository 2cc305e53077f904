"""Controls: one file each; this table is the only place that knows them all."""

from volid.controllers.base import Controller
from volid.controllers.etalon import ETALON
from volid.controllers.isg_crosscomp import ISG_CROSSCOMP
from volid.controllers.isg_ssfk import ISG_SSFK
from volid.controllers.isg_volcomp import ISG_VOLCOMP
from volid.controllers.linuxcnc import LINUXCNC
from volid.controllers.twincat_nc import TWINCAT_NC

CONTROLS: dict[str, Controller] = {
    c.declaration.name: c
    for c in (
        LINUXCNC,
        ISG_VOLCOMP,
        ETALON,
        ISG_SSFK,
        ISG_CROSSCOMP,
        TWINCAT_NC,
    )
}

__all__ = ["CONTROLS", "Controller"]
