"""SINUMERIK: sag and angularity compensation, system variables $AN_CEC: pitch, cross, direction-dependent and lever-arm tables.

Each table corrects an output axis over the position setpoint of an input axis, at equal steps; all tables of an output axis are
added, and two tables can be multiplied (`volid.controllers.sinumerik.products` says how). With lever arms as products a machine
without a kinematic model in its control carries all of L-VOL for one tool vector.

Not modelled: how fast the control follows a jump of the value at reversal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    COMPENSATION,
    DOCUMENTED,
    EQUAL,
    HELD,
    INFERRED,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
)
from volid.controllers.options import one_of, whole
from volid.controllers.sinumerik.entries import ask_factor, entry_of, take, text_of_entry
from volid.controllers.sinumerik.ini_files import AXES, MANUAL, Parts, ask_plain, covers, name_of, settings
from volid.controllers.sinumerik.products import Entry, Meaning, entries_of, tables_of
from volid.controllers.tables.equal_steps import loss
from volid.exceptions import InputError
from volid.model.machine import Machine

# model: number of tables, points of a table (None: MD18342, as set)
MODELS: dict[str, tuple[int, int | None]] = {"840d-sl": (62, None), "828d": (8, 200), "802d-sl": (2, 350)}
BOTH, MEAN = "both", "mean"
ALSO, NOT_ALSO = "also", "not"
SHARED, EACH = "shared", "each"
_802D = "Siemens, SINUMERIK 802D sl Function Manual, 6FC5397-1CP10-5BA0 (11/2012)"


DECLARATION = Declaration(
    name="sinumerik-cec",
    title="SINUMERIK, sag and angularity compensation ($AN_CEC)",
    carries={"L-VOL": TABLES, "L-ANG": TABLES, "L-SQU": TABLES, "L-STR": TABLES, "L-POS": TABLES, "R-POS": TABLES},
    nearest="$AN_CEC moves axes by tables of one position each and by products of two; spatial grids and orientation need a "
    "control such as isg-volcomp, or the ETALON exchange text (etalon)",
    sign=OPEN,
    units="mm, degrees for rotary axes; products in mm",
    reversal=COLUMNS,
    outside=HELD,
    spacing=EQUAL,
    limits="as many as MD18342 allows and, by option model: 62 tables; 8 tables of 200 points on an 828D, 2 of 350 on an 802D sl",
    products=True,
    zero="make the values 0 at the reference point (`zero`): the axis moves by what stands there when the compensation begins",
    switching="MD32710 $MA_CEC_ENABLE of each output axis for all its tables; SD41300 $SN_CEC_TABLE_ENABLE of each table; tables "
    "of a product, and the plain tables of the same axes, are switched together",
    options=(
        AXES,
        Option("model", "840d-sl, 828d (8 tables of 200 points) or 802d-sl (2 tables)", "840d-sl", one_of(*MODELS)),
        Option(
            "first_table",
            "index of the first table, to keep tables that are there",
            0,
            whole(0, 61, "the index of a table"),
        ),
        Option(
            "reversal",
            "both: a table for each direction where they differ; mean: one for both",
            BOTH,
            one_of(BOTH, MEAN),
        ),
        Option(
            "multiplied",
            "also: the two tables of a product act by themselves too, as the manual says; not: the product alone acts",
            ALSO,
            one_of(ALSO, NOT_ALSO),
        ),
        Option(
            "ramps",
            "shared: one table of each lever arm for all output axes; each: one for each output axis",
            SHARED,
            one_of(SHARED, EACH),
        ),
    ),
    commissioning=Commissioning(
        backup=("Back up the archive of the NC data and the compensation tables ($AN_CEC), with SD41300 and MD32710.",),
        load=(
            "Set MD18342 $MN_MM_CEC_MAX_POINTS of each table to its number of points (not on an 828D); changing it formats the "
            "static memory at the next start, so back up first and read the archive in again.",
            "Set MD32710 $MA_CEC_ENABLE of all output axes to 0; tables can be loaded only then.",
            "Read the file in while the control works in millimetres (MD10240).",
            "Set SD41300 $SN_CEC_TABLE_ENABLE of the tables.",
        ),
        activate=(
            "Set MD32710 of the output axes to 1, and reference the axes.",
            "Where tables are multiplied, load them alone, with the plain table of the same axes, and move the axis of the lever "
            "arm: the display must stay at the plain error. Where it does not, the tables of a product do not act by themselves "
            "at this control: write the files again with the option multiplied=not.",
        ),
        remove=(
            "Set MD32710 of the output axes to 0, read the former tables from the backup, and set SD41300 and MD32710 to their "
            "former values; without former tables, SD41300 of these tables and MD32710 stay 0.",
        ),
        watch=(
            "The service display of the output axis shows the sum of sag and temperature compensation, as in the file.",
        ),
    ),
    facts=(
        Fact(
            "whether a positive value moves the output axis in + or in -: not stated by the vendor; one article has the value "
            "added to the setpoint, one generator of files writes measured - nominal",
            OPEN,
            "industrialmonitordirect.com, configuring CEC; a public file generator for 840D sl",
        ),
        Fact("a table acts over the position setpoint of its input axis; ends held", DOCUMENTED, f"{MANUAL} p. 248"),
        Fact("all tables of an output axis are added", DOCUMENTED, f"{MANUAL} p. 245; {_802D} p. 215"),
        Fact("DIRECTION 0 both, 1 only +, -1 only - direction of the input axis", DOCUMENTED, f"{MANUAL} p. 249"),
        Fact(
            "the product of two tables is added as an additional value; any table can be multiplied with any other; "
            "MULT_BY_TABLE is the index of the other table plus 1",
            DOCUMENTED,
            f"{MANUAL} pp. 245, 249",
        ),
        Fact(
            "the tables of a product act by themselves too, because the product is additional; the worked example, "
            "dX1 = Z1 · beta(X1), does not mention it",
            INFERRED,
            f"{MANUAL} pp. 249, 252",
        ),
        Fact("tables are loaded only while MD32710 is 0", DOCUMENTED, f"{MANUAL} p. 237"),
        Fact("SD41300 enables the evaluation of one table", DOCUMENTED, f"{MANUAL} p. 245"),
        Fact("828D: 8 tables of 200 points", DOCUMENTED, f"{MANUAL} p. 264"),
        Fact("802D sl: 2 tables of 350 points", DOCUMENTED, f"{_802D} pp. 215, 220"),
        Fact(
            "840D sl: twice as many tables as axes; 62 for 31 axes",
            INFERRED,
            f"{MANUAL} pp. 244-245; a public file generator offers the indices 0 … 61",
        ),
        Fact("units follow MD10240 and MD32711", DOCUMENTED, f"{_802D} p. 222"),
        Fact("machine axes are called X1, Y1, Z1 unless stated", INFERRED, f"examples of {MANUAL} pp. 242-252"),
    ),
)


class SinumerikCec(Controller):
    """One file of numbered tables $AN_CEC."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the points that tables of the model have."""
        return replace(DECLARATION, most_points=MODELS[options["model"]][1])

    def write(self, job: Job) -> Written:
        """One file of all tables. Raises `InputError` for more tables or points than the model has."""
        tables, o = job.axis_tables(products=True), job.options
        meaning = _meaning(o, job.factor)
        entries = entries_of(tables, job.machine, meaning)
        _ask_room(entries, job, meaning)
        texts = [text_of_entry(e, o["axes"]) for e in entries]
        content = "\n".join(["%_N_NC_CEC_INI", "CHANDATA(1)", *texts, "M17", ""])
        parameters = []
        for e in entries:
            t, words = e.index, f"{e.output} over {e.argument}: {e.source}"
            if meaning.most is None:
                parameters.append(
                    (f"MD18342 $MN_MM_CEC_MAX_POINTS[{t}]", f">= {e.lattice.count}", "points of the table")
                )
            parameters.append((f"SD41300 $SN_CEC_TABLE_ENABLE[{t}]", "1", words))
        for letter in dict.fromkeys(e.output for e in entries):
            name = name_of(letter, o["axes"])
            parameters.append(
                (f"MD32710 $MA_CEC_ENABLE[{name}]", "0, then 1", "0 to load the tables, 1 to activate them")
            )
        file = ControlFile("nc_cec.ini", content, f"{len(entries)} tables")
        return Written((file,), tuple(parameters), tuple(_notes(entries, job)), 0.5e-9)

    def only_together(self, table: AxisTable, held: Compensation, options: Mapping[str, Any]) -> bool:
        """Beside products also the plain tables of the same output axis, which take the single values of the products out."""
        products = {t.output for t in held.axis_tables if t.factor is not None}
        return table.factor is not None or (options["multiplied"] == ALSO and table.output in products)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of axes, error values, that do what the numbered tables do. Raises `InputError` that names file and line."""
        found: dict[int, Parts] = {}
        switched: dict[int, bool] = {}
        for s in settings(files):
            ask_plain(s)
            if s.name == "SN_CEC_TABLE_ENABLE":
                switched[s.whole(0)] = s.value.upper() not in ("0", "FALSE")
            elif s.name == "SN_CEC_TABLE_WEIGHT":
                s.choice(1)
            elif s.name.startswith("AN_CEC"):
                take(s, found)
        if not found:
            raise InputError(f"{', '.join(files)}: no $AN_CEC is assigned; state the control that wrote the files")
        entries = {
            i: entry_of(i, parts, machine, options["axes"]) for i, parts in found.items() if switched.get(i, True)
        }
        for e in entries.values():
            if e.times is not None:
                ask_factor(e, entries)
        factor = -1.0 if options["sign"] == COMPENSATION else 1.0
        return Compensation((), (), (), tables_of(entries, machine, _meaning(options, factor)))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether $AN_CEC is assigned."""
        return "$AN_CEC" in (content if isinstance(content, str) else content.decode("latin-1")).upper()


def _meaning(o: Mapping[str, Any], sense: float) -> Meaning:
    most = MODELS[o["model"]][1]
    return Meaning(sense, o["multiplied"] == ALSO, o["ramps"] == SHARED, o["reversal"] == MEAN, most, o["first_table"])


def _ask_room(entries: list[Entry], job: Job, meaning: Meaning) -> None:
    """Raises `InputError` for tables or points that the model does not have, and says what would fit."""
    model = job.options["model"]
    tables, points = MODELS[model]
    room = tables - meaning.first
    for e in entries:
        if points is not None and e.lattice.count > points:
            raise InputError(
                f"{DECLARATION.name}: the table of {e.output} over {e.argument} needs {e.lattice.count} points; {model} has "
                f"{points}. Take a larger `step`, or `max_points={points}`"
            )
    if len(entries) <= room:
        return
    plain = [t for t in job.axis_tables(products=True) if t.factor is None]
    single = Meaning(meaning.sense, meaning.added, meaning.shared, True, points)
    kept = "with the mean of both directions (reversal=mean)"
    others = {
        kept: len(entries_of(job.axis_tables(products=True), job.machine, single)),
        "without lever arms (types L-POS, L-STR and L-SQU)": len(entries_of(plain, job.machine, meaning)),
        f"without lever arms, {kept}": len(entries_of(plain, job.machine, single)),
        f"L-POS alone, {kept}": len(entries_of([t for t in plain if t.is_pitch], job.machine, single)),
    }
    fits = [f"{words}: {count}" for words, count in others.items() if 0 < count <= room] or [
        "single tables of single types"
    ]
    raise InputError(
        f"{DECLARATION.name}: {len(entries)} tables are needed; {model} has {tables}, {room} of them from index {meaning.first} "
        f"on. What fits: {'; '.join(fits)}. sinumerik-enc-comp takes the positioning errors besides"
    )


def _notes(entries: list[Entry], job: Job) -> list[str]:
    found = [
        covers(e.lattice, e.values, job.machine.axis(e.argument), "mm", float(e.modulo))
        for e in entries
        if e.times is None and not e.source.startswith("lever arm")
    ]
    lattices = {e.argument: e.lattice for e in entries}
    moved = [loss(t, lattices[t.argument]) for t in job.axis_tables(products=True) if t.argument in lattices]
    if max(moved, default=0.0) > 1e-7:
        found.append(f"equal steps change values by up to {max(moved):.7f} mm or rad at the positions given")
    products = [e for e in entries if e.times is not None]
    if products:
        tool = ", ".join(f"{v:g}" for v in job.tool)
        found.append(
            f"{len(products)} tables are multiplied by ramps of lever arms; all hold for the tool vector ({tool}) mm. "
            + _acting(entries, job)
        )
    return list(dict.fromkeys(sentence for sentence in found if sentence))


def _acting(entries: list[Entry], job: Job) -> str:
    """How the tables of a product act beside it, and how far a plain table alone would move its axis then."""
    if job.options["multiplied"] != ALSO:
        return "By the option multiplied=not, a table of a product is taken to do nothing but the product"
    moved = {e.output for e in entries if e.times is not None}
    plain = [e for e in entries if e.times is None and not e.source.startswith("lever arm") and e.output in moved]
    most = max((float(np.abs(e.values).max()) for e in plain), default=0.0)
    return (
        "The plain tables contain what takes the single values of both out, so that their values are large; all tables of an "
        f"output axis are switched together. A plain table alone would move its axis by up to {most:.3f} mm, and no sign of "
        f"{', '.join(sorted(moved))} can be proved by single tables: take the column 'all loaded' of section 5"
    )


SINUMERIK_CEC = SinumerikCec()
