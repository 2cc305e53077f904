"""Files that instruments and other programs write: one file each; this table is the only place that knows them all."""

from volid.io.instruments.base import EvaluatedFormat, Format, ReadingsFormat
from volid.io.instruments.rta import RTA
from volid.io.instruments.rtl import RTL

FORMATS: dict[str, Format] = {f.name: f for f in (RTL, RTA)}

__all__ = ["FORMATS", "EvaluatedFormat", "Format", "ReadingsFormat"]
