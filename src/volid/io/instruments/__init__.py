"""Files that instruments and other programs write: one file each; this table is the only place that knows them all."""

from volid.io.instruments.b5r import B5R
from volid.io.instruments.base import EvaluatedFormat, Format, ReadingsFormat
from volid.io.instruments.pos import POS
from volid.io.instruments.rta import RTA
from volid.io.instruments.rtl import RTL

FORMATS: dict[str, Format] = {f.name: f for f in (RTL, RTA, POS, B5R)}

__all__ = ["FORMATS", "EvaluatedFormat", "Format", "ReadingsFormat"]
