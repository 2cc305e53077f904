"""`.rtl`: linear readings of a laser interferometer, runs up and down along one linear axis.

Targets in mm, deviation = measured - target in µm.
"""

from __future__ import annotations

from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.laser_line import KEYS, check_linear, found_on, line_of, unit_of
from volid.io.instruments.runs import KEYS as RUN_KEYS
from volid.io.instruments.runs import read_runs
from volid.io.instruments.sections import is_run_file, sections_of
from volid.model.iso230 import TRANSLATIONS


class Rtl(ReadingsFormat):
    """Linear readings along a linear axis."""

    name = "rtl"
    words = "readings of a linear laser interferometer"
    about = f"runs along a linear axis; deviation = measured - target in µm, targets in mm. {FROM_DESCRIPTIONS}"
    keys = (*KEYS, *RUN_KEYS)

    def recognises(self, text: str) -> bool:
        """Runs with their targets, in a file that calls itself by this name or by none."""
        return is_run_file(text) and sections_of(text).file_type in ("", self.name)

    def read(self, file: ForeignFile, request: Request) -> Found:
        """Every reading of every run. Raises `InputError`."""
        sections = sections_of(file.text)
        line = line_of(request, sections, TRANSLATIONS)
        check_linear(line, request)
        return found_on(line, read_runs(file, sections, request.table), sections, unit_of(request, "µm", "mm"))


RTL: Format = Rtl()
