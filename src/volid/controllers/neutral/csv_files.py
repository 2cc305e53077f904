"""Plain tables and grids as CSV, for programs that read them: volid's own files, which hold every type of ISO/TR 16907."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from volid.compensation.types import GRID, TABLES
from volid.controllers.base import COLUMNS, COMPENSATION, FREE, HELD, Declaration, Option
from volid.controllers.neutral.own_files import COMMISSIONING, FACTS, OwnFiles, carried
from volid.model.machine import Machine


def _form(text: str) -> str:
    if text not in ("tables", "grids"):
        raise ValueError("expected tables or grids")
    return text


def _switch(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError("expected 0 (absolute values) or 1 (increments)")
    return text == "1"


class NeutralCsv(OwnFiles):
    """One CSV file per table and grid."""

    declaration = Declaration(
        name="csv",
        title="Plain CSV, tables and grids of volid",
        carries=carried(TABLES),
        nearest="it carries every type",
        sign=COMPENSATION,
        units="mm and degrees of position; mm, rad in tables, degrees in grids",
        reversal=COLUMNS,
        outside=HELD,
        spacing=FREE,
        limits="as many as there are",
        model=True,
        zero="wherever the datum puts it; each file says where",
        switching="one file per table and grid: leave one out, and it is off",
        options=(
            Option("form", "tables or grids, for types that have both; tables hold both directions", "tables", _form),
            Option("incremental", "1: tables hold increments from row to row", False, _switch),
        ),
        commissioning=COMMISSIONING,
        facts=FACTS,
    )

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the types in the form that is asked for."""
        return replace(self.declaration, carries=carried(GRID if options["form"] == "grids" else TABLES))


NEUTRAL_CSV = NeutralCsv()
