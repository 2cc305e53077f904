"""Plain tables and grids as CSV, for programs that read them: volid's own files, which hold every type of ISO/TR 16907."""

from __future__ import annotations

from volid.compensation.types import BY_COMPLETENESS, TYPES
from volid.controllers.base import COLUMNS, COMPENSATION, FREE, HELD, Declaration, Option
from volid.controllers.own_files import COMMISSIONING, FACTS, OwnFiles


def _switch(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError("expected 0 (absolute values) or 1 (increments)")
    return text == "1"


class NeutralCsv(OwnFiles):
    """One CSV file per table and grid."""

    declaration = Declaration(
        name="csv",
        title="Plain CSV, tables and grids of volid",
        carries={name: TYPES[name].forms[0] for name in BY_COMPLETENESS},
        nearest="it carries every type",
        sign=COMPENSATION,
        units="mm and degrees of position; mm, rad in tables, degrees in grids",
        reversal=COLUMNS,
        outside=HELD,
        spacing=FREE,
        model=True,
        zero="wherever the datum puts it; each file says where",
        switching="one file per table and grid: leave one out, and it is off",
        options=(Option("incremental", "1: tables hold increments from row to row", False, _switch),),
        commissioning=COMMISSIONING,
        facts=FACTS,
    )


NEUTRAL_CSV = NeutralCsv()
