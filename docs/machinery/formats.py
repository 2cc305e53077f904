"""Descriptions of file formats, from the docstrings of the modules that read and write them, which are plain Markdown."""

import inspect
from importlib import import_module
from pathlib import Path

from machinery.writing import write

MODULES = (
    "campaign.hdf5",
    "solutions",
    "tables",
    "layouts",
    "grids",
    "functions_csv",
    "truths",
    "studies",
    "study_results",
    "networks",
    "network_results",
)


def write_formats(target: Path) -> None:
    """One text for each module, which `reference/files.md` includes."""
    for name in MODULES:
        text = inspect.getdoc(import_module(f"volid.io.{name}")) or ""
        write(target / f"{name.rpartition('.')[2]}.md", text + "\n")
