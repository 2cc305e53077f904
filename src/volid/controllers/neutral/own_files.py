"""What the controls `csv` and `hdf5` have in common: volid's own tables and grids, for controls and programs that take these.

Their files are made and read by the layer of files, through the public functions `volid.compensation_files` and
`volid.compensation_from_files`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from volid.compensation.package import Compensation
from volid.compensation.types import BY_COMPLETENESS, TYPES
from volid.controllers.base import DOCUMENTED, Commissioning, ControlFile, Controller, Fact, Job, Written
from volid.exceptions import InputError
from volid.model.machine import Machine

SOURCE = "docstrings of volid.io.tables and volid.io.grids"
COMMISSIONING = Commissioning(
    backup=("Keep the tables and grids that the control or program holds now.",),
    load=("Give the files to the program that reads them; each says in its first lines what its numbers are.",),
    activate=("Switch the compensation on as that program does, and run the checks of this sheet.",),
    remove=("Take the files away, and give the program back what it had before.",),
)
FACTS = (
    Fact("each file states its sense, units, frame, datum, zero, tool vector or reference point", DOCUMENTED, SOURCE),
    Fact("linear between positions, end values held outside", DOCUMENTED, SOURCE),
    Fact("rotations act through the lever arm of the current tool", DOCUMENTED, SOURCE),
)


def carried(form: str) -> dict[str, str]:
    """All types, the most complete first, each in the form asked for where it has that, else in its own."""
    return {n: form if form in TYPES[n].forms else TYPES[n].forms[0] for n in BY_COMPLETENESS}


class OwnFiles(Controller):
    """Tables and grids in volid's own files."""

    hdf5 = False

    def write(self, job: Job) -> Written:
        """One file per table and grid. Raises `InputError` for tables of axes."""
        import volid

        if self.hdf5 and (job.compensation.tables or job.compensation.axis_tables):
            raise InputError(f"{self.declaration.name}: tables have no HDF5 file of their own; take csv, or a grid")
        steps = bool(job.options.get("incremental"))
        texts = volid.compensation_files(job.compensation, job.machine, incremental=steps, hdf5=self.hdf5)
        files = [ControlFile(name, content, _what(name)) for name, content in texts.items()]
        return Written(tuple(files))

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables and grids of the files."""
        import volid

        if not files:
            raise InputError(f"{self.declaration.name}: no file; expected tables or grids of volid")
        return volid.compensation_from_files(files, machine)


def _what(name: str) -> str:
    return "spatial grid" if name.startswith("grid") else f"table of {name.removesuffix('.csv')}"
