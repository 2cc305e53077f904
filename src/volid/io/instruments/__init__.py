"""Files that instruments and other programs write: one file each; this table is the only place that knows them all."""

from volid.io.instruments.b5r import B5R
from volid.io.instruments.base import EvaluatedFormat, Format, ReadingsFormat
from volid.io.instruments.linuxcnc import LINUXCNC
from volid.io.instruments.msr import MSR
from volid.io.instruments.pos import POS
from volid.io.instruments.rta import RTA
from volid.io.instruments.rtl import RTL
from volid.io.instruments.spatial_analyzer import SPATIAL_ANALYZER

FORMATS: dict[str, Format] = {f.name: f for f in (RTL, RTA, POS, B5R, MSR, LINUXCNC, SPATIAL_ANALYZER)}

__all__ = ["FORMATS", "EvaluatedFormat", "Format", "ReadingsFormat"]
