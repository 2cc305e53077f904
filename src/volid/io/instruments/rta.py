"""`.rta`: angular readings of a laser interferometer: pitch or yaw of a linear axis, or the position of a rotary axis.

Targets are commanded positions of the axis that moved, in mm or degrees. Deviation = measured - target. The unit of the
deviations does not stand in the file: public descriptions say mrad.
"""

from __future__ import annotations

from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.laser_line import KEYS, found_on, line_of, unit_of
from volid.io.instruments.runs import KEYS as RUN_KEYS
from volid.io.instruments.runs import read_runs
from volid.io.instruments.sections import is_run_file, sections_of
from volid.model.iso230 import ROTATIONS

_UNIT = "mrad"
_ASSUMED = (
    f"the file does not tell the unit of its deviations; they were taken in {_UNIT}, as public descriptions say. Compare one "
    'with what the instrument showed, and state unit = "µrad", "arcsec" or what it is'
)


class Rta(ReadingsFormat):
    """Angular readings along a linear or about a rotary axis."""

    name = "rta"
    words = "readings of an angular laser interferometer"
    about = (
        "runs along a linear axis (component A, B or C is to be stated) or a rotary axis; deviation = measured - target in "
        f"{_UNIT} unless `unit` says otherwise, targets in mm or degrees. {FROM_DESCRIPTIONS}"
    )
    keys = (*KEYS, *RUN_KEYS)

    def recognises(self, text: str) -> bool:
        """Runs with their targets, in a file that calls itself by this name or by none."""
        return is_run_file(text) and sections_of(text).file_type in ("", self.name)

    def read(self, file: ForeignFile, request: Request) -> Found:
        """Every reading of every run. Raises `InputError`."""
        sections = sections_of(file.text)
        line = line_of(request, sections, ROTATIONS)
        unit = unit_of(request, _UNIT, "rad")
        found = found_on(line, read_runs(file, sections, request.table), sections, unit)
        return found if "unit" in request.table.data else found.with_notes(_ASSUMED)


RTA: Format = Rta()
