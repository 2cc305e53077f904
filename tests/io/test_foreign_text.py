"""CSV files as spreadsheets and instruments of other countries write them: read as what they are, said, or asked about."""

import math

import numpy as np
import pytest
from support.campaign_files import MANIFEST, csv_text, edited, volume_rows, write_files

from volid.exceptions import InputError
from volid.io import load_campaign, read_manifest, write_campaign
from volid.io.basics.csv_cells import number, over_midnight, seconds
from volid.io.basics.csv_form import CsvForm
from volid.io.basics.csv_rows import shown
from volid.io.basics.csv_table import read_csv
from volid.io.basics.units import conversion, spelled

ROWS = volume_rows()
COLUMNS = tuple(ROWS)
FRENCH = [f"{1e3 + d:,.12f}".replace(",", "\u202f").replace(".", ",") for d in ROWS["distance"]]

QUOTED = {name: [f'"{str(c).replace(".", ",")}"' for c in cells] for name, cells in ROWS.items()}


def part(start, end):
    """Some of the rows."""
    return {name: cells[start:end] for name, cells in ROWS.items()}


def table(delimiter=";", decimal=",", rows=ROWS, header=None, form="{}"):
    """volume.csv with another delimiter and decimal sign; `form`: how numbers are written."""
    cells = zip(
        *([form.format(c).replace(".", decimal) if isinstance(c, float) else str(c) for c in v] for v in rows.values()),
        strict=True,
    )
    return "\n".join(delimiter.join(row) for row in [header or tuple(rows), *cells]) + "\n"


def read(tmp_path, data, csv="", keys=""):
    """The set 'volume' and the campaign's warnings, from bytes or text of volume.csv."""
    manifest = edited(MANIFEST, 'file = "volume.csv"\n', f'file = "volume.csv"\n{keys}')
    head, _, rest = manifest.partition("[[station]]")
    path = write_files(tmp_path, manifest=f"{head}{csv}\n[[station]]{rest}")
    (tmp_path / "volume.csv").write_bytes(data if isinstance(data, bytes) else data.encode("utf-8"))
    campaign = read_manifest(path)
    return campaign.sets[0], campaign.warnings


def check(readings, distance=ROWS["distance"]):
    np.testing.assert_allclose(readings.readings[:, 0], distance, rtol=1e-14)
    np.testing.assert_array_equal(readings.positions, np.column_stack([ROWS[a] for a in "XYZ"]))
    assert readings.labels["station"].tolist() == ROWS["station"]


# ---------------------------------------------------------------------------------------- recognised, and said

FILES = {
    "German spreadsheet": (table().encode("cp1252"), "cells separated by ';'; decimal commas"),
    "German, empty columns behind": (table().replace("\n", ";;;\n"), "cells separated by ';'; decimal commas"),
    "German, only the rows padded": (table().replace("\n", ";;\n").replace(";;\n", "\n", 1), "cells separated by ';'"),
    "German, only the header padded": (table().replace("\n", ";;\n", 1), "cells separated by ';'"),
    "semicolons, decimal points": (table(";", "."), "cells separated by ';'"),
    "tabs": (table("\t", "."), "cells separated by tabs"),
    "tabs, decimal commas": (table("\t", ","), "cells separated by tabs; decimal commas"),
    "Windows, Unicode text": (table("\t", ",").encode("utf-16"), "encoding UTF-16; cells separated by tabs; decimal commas"),
    "UTF-16 without mark": (table("\t", ".").encode("utf-16-le"), "encoding UTF-16; cells separated by tabs"),
    "UTF-16, big end first, no mark": (table(",", ".").encode("utf-16-be"), "encoding UTF-16"),
    "instrument, blanks": (table("   ", "."), "cells separated by blanks"),
    "excel's own hint": ("sep=|\n" + table("|", "."), "cells separated by '|'"),
    "commas in quotes": (table(",", ".", QUOTED), "decimal commas"),
    "French, narrow blanks": (table(rows={**ROWS, "distance": FRENCH}), "separated thousands in distance"),
    "units in a second row": (table(";", ",").replace("\n", "\nmm;mm;mm;;;mm\n", 1), "units from row 2"),
    "header in every part": ("\n".join(csv_text(part(i, i + 18)) for i in (0, 18, 36)), "the header repeated 2 times"),
    "empty rows of a spreadsheet": (table().replace("\n", "\n;;;;;\n\n"), "cells separated by ';'"),
}  # fmt: skip


FILES |= {
    "German, titles above": (
        f"Messprotokoll 7;;;;;\nKunde:;Werk 2;;;;\n;;;;;\n{table()}",
        "3 lines above the header left out",
    ),
    "titles without cells": (f"Messprotokoll 7, Werk 2\n\nam 3. Mai\n{table()}", "2 lines above the header left out"),
    "a title, commas": (f"Acceptance test\n{csv_text(ROWS)}", "1 line above the header left out"),
}


@pytest.mark.parametrize("name", FILES)
def test_read_and_said(tmp_path, name):
    data, said = FILES[name]
    readings, warnings = read(tmp_path, data)
    check(readings, [d + 1e3 * name.startswith("French") for d in ROWS["distance"]])
    assert len(warnings) == 1 and "volume.csv: read with" in warnings[0] and said in warnings[0], warnings


@pytest.mark.parametrize(
    "data",
    [
        csv_text(ROWS),
        b"\xef\xbb\xbf" + csv_text(ROWS).encode(),
        csv_text(ROWS).replace("\n", "\r\n"),
        csv_text({**ROWS, "distance": [f"+{d:.17e}".replace("e", "E") for d in ROWS["distance"]]}),
        csv_text({**ROWS, "distance": [f"\xa0{d!r}\xa0" for d in ROWS["distance"]]}),
        csv_text(ROWS).replace("\n", ",,\n"),
    ],
    ids=["plain", "mark", "Windows", "plus and E", "no-break blanks", "empty columns"],
)
def test_of_the_plain_form_nothing_is_said(tmp_path, data):
    readings, warnings = read(tmp_path, data)
    check(readings)
    assert warnings == ()


def test_rows_keep_their_line_numbers(tmp_path):
    readings, _ = read(tmp_path, "Protokoll;;\n" + table().replace("\n", "\n;;;;;\n"), keys="csv = { skip = 1 }\n")
    assert readings.rows.tolist() == [4 + 2 * i for i in range(54)]


def test_names_in_an_old_encoding(tmp_path):
    readings, warnings = read(tmp_path, csv_text(ROWS).replace("S2", "Süd").encode("latin-1"))
    assert set(readings.labels["station"]) == {"S1", "Süd"}
    assert "encoding Windows-1252" in warnings[0]


def test_minus_signs_of_typographers(tmp_path):
    found = read_csv(_file(tmp_path, "X;Y\n−1,5;2\n"))
    assert found.numbers("X", "mm", "why").tolist() == [-1.5]


def test_a_header_of_two_lines(tmp_path):
    found = read_csv(_file(tmp_path, '"Soll X\n[mm]";"Soll Y\n[mm]"\n1,25;2\n'))
    assert list(found.columns) == ["Soll X [mm]", "Soll Y [mm]"] and found.rows.tolist() == [4]


def test_an_import_remembers_how_the_file_was_read(tmp_path):
    _, warnings = read(tmp_path, table())
    campaign = load_campaign(tmp_path / "campaign.toml")
    write_campaign(campaign, tmp_path / "c.h5")
    again = load_campaign(tmp_path / "c.h5")
    assert again.warnings == warnings and "cells separated by ';'" in warnings[0]
    np.testing.assert_array_equal(again.sets[0].readings, campaign.sets[0].readings)


def _file(tmp_path, text):
    path = tmp_path / "x.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


# ------------------------------------------------------------------------------------------------------ stated


def test_everything_stated(tmp_path):
    rows = {**ROWS, "distance": [d / 1000.0 for d in ROWS["distance"]]}
    text = "Messprotokoll 7|\nfrei\n" + table("|", ",", rows).split("\n", 1)[1]
    csv = 'delimiter = "|", decimal = ",", encoding = "utf-16", skip = 2, header = false, units = { distance = "m" }'
    columns = ", ".join(f"{name} = {i}" for i, name in enumerate(COLUMNS, start=1))
    readings, warnings = read(tmp_path, text.encode("utf-16"), keys=f"csv = {{ {csv} }}\ncolumns = {{ {columns} }}\n")
    check(readings)
    for part in ('delimiter = "|" as stated', "skip = 2 as stated", "distance in m", "header = false as stated"):
        assert part in warnings[0]


def test_the_set_goes_before_the_manifest(tmp_path):
    manifest = edited(
        MANIFEST, '[[station]]\nname = "S1"', '[csv]\ndelimiter = ";"\ndecimal = ","\n[[station]]\nname = "S1"'
    )
    manifest = edited(
        manifest, 'file = "levels.csv"\n', 'file = "levels.csv"\ncsv = { delimiter = ",", decimal = "." }\n'
    )
    path = write_files(tmp_path, manifest=manifest, volume=table())
    check(read_manifest(path).sets[0])


@pytest.mark.parametrize(
    ("unit", "factor"), [("m", 1e-3), ("inch", 1 / 25.4), ("µm", 1e3), ("um", 1e3), ("in", 1 / 25.4), ("cm", 0.1)]
)
def test_units_of_a_header_and_of_the_manifest(tmp_path, unit, factor):
    rows = {**ROWS, "distance": [d * factor for d in ROWS["distance"]]}
    stated, warnings = read(tmp_path / "a", csv_text(rows), f'[csv]\nunits = {{ distance = "{unit}" }}\n')
    check(stated)
    assert f"distance in {spelled(unit)}" in warnings[0]
    for header in (f"distance [{unit}]", f"distance ({unit})", f"distance / {unit}"):
        named, warnings = read(tmp_path / header.replace("/", "-"), csv_text(rows).replace("distance", header, 1))
        check(named)
        assert f"distance in {spelled(unit)}" in warnings[0]
    mapped, _ = read(
        tmp_path / "c",
        csv_text(rows).replace("distance", f"Länge [{unit}]", 1),
        "",
        f'columns = {{ distance = "Länge [{unit}]" }}\n',
    )
    check(mapped)


def test_units_against_exact_factors():
    assert conversion("gon", "degrees")[0] == pytest.approx(0.9, rel=1e-15)
    assert conversion("arcsec", "degrees")[0] == pytest.approx(1 / 3600, rel=1e-15)
    assert conversion("µm/m", "rad")[0] == 1e-6 and conversion("min", "s")[0] == 60.0
    factor, offset = conversion("°F", "°C")
    assert (68 * factor + offset, -40 * factor + offset) == (pytest.approx(20.0), pytest.approx(-40.0))
    assert conversion("mm", "s") is None and spelled("grad") is None


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["10", "20.5", ""], [10, 20.5, math.nan]),
        (["23:59:59", "00:00:01", "12:00:00"], [86399, 86401, 129600]),
        (["08:00", "08:01:30,5", "08:02"], [28800, 28890.5, 28920]),
        (["1970-01-01T00:00:10", "1970-01-02 00:00:00", "1970-01-01T01:00:00+01:00"], [10, 86400, 0]),
        (["01.01.1970 00:00:10", "02.01.1970 00:00", ""], [10, 86400, math.nan]),
    ],
    ids=["seconds", "clock over midnight", "clock", "iso", "German date"],
)
def test_times(tmp_path, cells, expected):
    found = read_csv(_file(tmp_path, "X;time\n" + "".join(f"1;{c}\n" for c in cells))).times("time", "why")
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def test_wrong_times():
    for text, form in (("24:61:00", "hh:mm:ss"), ("noon", "iso"), ("12:30:00", "iso"), ("1e300", "hh:mm:ss")):
        with pytest.raises(ValueError):
            seconds(text, form)
    np.testing.assert_array_equal(over_midnight(np.array([5.0, np.nan, 3.0])), [5.0, np.nan, 3.0])


# ------------------------------------------------------------------------------------- never guessed in silence


@pytest.mark.parametrize(
    ("cell", "decimal", "thousands", "value"),
    [
        ("1.234,5", ",", None, 1234.5),
        ("1,234.5", ".", None, 1234.5),
        ("1.234.567", ",", None, 1234567.0),
        ("1 234,5", ",", None, 1234.5),
        ("-12'345.5", ".", None, -12345.5),
        ("1.234", ",", ".", 1234.0),
        ("1.234", ",", None, None),
        ("1,234", ".", None, None),
        ("1,234", "?", None, None),
        ("12.5", ",", None, None),
        ("12.34,5", ",", None, None),
        ("1_000", ".", None, None),
        ("1 2", ".", None, None),
        ("1234.567,8", ",", None, None),
    ],
)
def test_signs_in_numbers(cell, decimal, thousands, value):
    if value is None:
        with pytest.raises(ValueError):
            number(cell, decimal, thousands)
    else:
        assert number(cell, decimal, thousands)[0] == value


@pytest.mark.parametrize(
    ("text", "form", "message"),
    [
        (
            "X\tY\n1,234\t5\n",
            CsvForm(),
            r'row 2: X is \'1,234\'; .* whose comma is clear: state decimal = "," or "\." in \[csv\]',
        ),
        ('X,Y\n"1,234",5\n', CsvForm(), r"row 2: X is '1,234'; .*state decimal"),
        ("X;Y\n1,5;2.5\n3,25;2,75\n", CsvForm(), r"row 2: Y is '2\.5'; .*decimal comma like the others"),
        ("X;Y\n1,5;1.234\n", CsvForm(), r'row 2: Y is \'1\.234\'; .*state thousands = "\."'),
        ("X;Y\n1.5;2,5\n3.25;2.75\n", CsvForm(), r"row 2: Y is '2,5'; .*with a decimal point"),
        ("X,Y\n1,5,2,5\n", CsvForm(), r"row 2: 4 cells; expected 2, .*decimal commas, expected ';' or tabs"),
        ("X;Y\n1,5;2\n", CsvForm(decimal="."), r"row 2: X is '1,5'; expected a finite number with a decimal point"),
        ("X,Y\n1_5,2\n", CsvForm(), r"row 2: X is '1_5'"),
        ("a;b,c\nx;y,z\n", CsvForm(), r"row 1: the cells may be separated by ';' or ','; state the delimiter"),
    ],
)
def test_what_is_not_clear_is_asked(tmp_path, text, form, message):
    found = None
    with pytest.raises(InputError, match=message):
        found = read_csv(_file(tmp_path, text), form)
        for name in found.columns:
            found.numbers(name, "mm", "why")


def test_a_comma_of_thousands_can_be_stated(tmp_path):
    found = read_csv(_file(tmp_path, "X\tY\n1,234\t5.5\n"), CsvForm(thousands=","))
    assert found.numbers("X", "mm", "why").tolist() == [1234.0]
    found = read_csv(_file(tmp_path, "X\tY\n1,234\t5\n"), CsvForm(decimal=","))
    assert found.numbers("X", "mm", "why").tolist() == [1.234]


@pytest.mark.parametrize(
    ("csv", "message"),
    [
        ('delimitr = ";"', r"\[csv\]: unknown key 'delimitr'; did you mean 'delimiter'\?"),
        ('delimiter = ";;"', r'\[csv\]: delimiter is ";;"; expected one character'),
        ('decimal = ";"', r'\[csv\]: decimal is ";"; expected "\." or ","'),
        ('decimal = ","\nthousands = ","', r"\[csv\]: thousands is .*another sign"),
        ('encoding = "utf-99"', r"volume\.csv: encoding 'utf-99' is unknown; expected such as utf-8"),
        ('encoding = "utf-32"', r"volume\.csv, line 1: byte 0x.. is not utf-32 text"),
        ("skip = -1", r"\[csv\]: skip is -1; expected a number of rows above the header"),
        ('units = { distance = "parsec" }', r"\[csv\], \[units\]: distance is \"parsec\"; expected a unit: mm, m"),
        ('units = { distnce = "m" }', r"campaign\.toml, \[csv\]: units names 'distnce', which is no column"),
        (
            'units = { distance = "s" }',
            r"volume\.csv, header: distance is in s; expected mm, or a unit that leads there",
        ),
        ('time = "am"', r"\[csv\]: time is \"am\"; expected one of"),
        ("header = false", r"set 'volume': header = false but no columns; name them by number"),
    ],
)
def test_wrong_statements(tmp_path, csv, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, csv_text(ROWS), f"[csv]\n{csv}\n")


# ------------------------------------------------------------------------------------------ what is no such file


def test_files_that_are_no_tables(tmp_path):
    for data, message in (
        (csv_text(ROWS).encode() + b"\x00\x00", r"line 56: byte 0x00 stands in no text"),
        (bytes(range(256)), r"line 1: byte 0x00 stands in no text"),
        (
            ",".join(map(str, range(40_000))) + "\n" + ",".join(["1"] * 40_000),
            r"row 1: 40000 columns; expected at most 2000",
        ),
        ("X,Y\n1," + "2" * 200_000 + "\n", r"row 2: a cell of 200000 characters; expected cells of at most 131072"),
        ('X,Y\n1,2\n1,"2\n' + "1,2\n" * 50_000, r"row 3: a quote is opened and not closed"),
        ('X,Y\n"1" 2,3\n4,"5\n', r"row \d: "),
    ):
        with pytest.raises(InputError, match=message):
            read_csv(_file(tmp_path, data))
    with pytest.raises(InputError, match=r"/dev/zero: is a device or a named pipe, which may never end"):
        read_csv("/dev/zero")
    with pytest.raises(InputError, match=r"it is a folder; name a file in it"):
        read_csv(tmp_path)


def test_cells_in_messages_are_cut_and_harmless():
    assert shown("a\x1b[31mb\n") == "a\\x1b[31mb\\n"
    assert len(shown("x" * 100_000)) == 80 and shown("x" * 80) == "x" * 80


def test_padding_of_a_whole_sheet_is_no_table_of_its_own(tmp_path):
    padded = "\n".join(line + ";" * 16_000 for line in table().split("\n")[:-1])
    readings, _ = read(tmp_path, padded)
    check(readings)


def test_points_of_a_spreadsheet(tmp_path, capsys):
    from support.places import ROOT

    import volid
    from volid.cli import main

    solution = tmp_path / "s.h5"
    volid.save_solution(volid.fit(volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml")), solution)
    plain = "X,Y,Z,tool_x,tool_y,tool_z,X_dir\n12.5,100,50,0,0,0,1\n254,100,50,0,0,0,-1\n"
    german = "X [inch];Y;Z;tool_x;tool_y;tool_z;X_dir\n0,4921259842519685;100;50;0,0;0;0;1\n10;100;50;0;0;0;-1\n"
    found = []
    for name, text in (("a", plain), ("b", german)):
        (tmp_path / f"{name}.csv").write_text(text)
        main(["errors", str(solution), "--at", str(tmp_path / f"{name}.csv"), "-o", str(tmp_path / f"{name}.out.csv")])
        said = capsys.readouterr().out
        assert ("cells separated by ';'; decimal commas; X in inch" in said) == (name == "b")
        found.append(read_csv(tmp_path / f"{name}.out.csv"))
    for column in ("X", "Y", "tool_x", "X_dir", "ex", "u_ex"):
        one, other = (table.numbers(column, "", "", gaps=True) for table in found)
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("keys", ["", 'csv = { time = "iso" }\n'], ids=["recognised", "stated"])
def test_times_of_a_campaign(tmp_path, keys):
    stamps = [f"2026-03-01T23:{i:02d}:30" for i in range(54)]
    readings, warnings = read(tmp_path, csv_text(ROWS | {"time": stamps}), keys=keys)
    np.testing.assert_array_equal(np.diff(readings.time), 60.0)
    assert "time as date and time" in warnings[0]
    with pytest.raises(
        InputError, match=r"volume\.csv, row 3: time is 'noon'; expected a time such as 2026-03-21T12:30:05"
    ):
        read(tmp_path / "b", csv_text(ROWS | {"time": [stamps[0], "noon", *stamps[2:]]}), keys=keys)


def test_a_long_line_of_short_cells_is_read(tmp_path):
    names = [f"c{i}" for i in range(1900)]
    cells = [f'"{i:070d}"' for i in range(1900)]
    found = read_csv(_file(tmp_path, ",".join(names) + "\n" + ",".join(cells) + "\n"))
    assert found.numbers("c1899", "mm", "why").tolist() == [1899.0]
