"""Short waves that tabulated positions cannot show: workbook and certificate data say so, with the size of the wave."""

import xml.etree.ElementTree as ET

import numpy as np
import openpyxl
import pytest
from support.short_waves import with_waves

import volid
from volid.report.contents.curves import curves, hidden_waves

SIZE, PITCH = 0.003, 17.0  # mm; tabulated positions stand 38 mm apart


@pytest.fixture(scope="module")
def wavy():
    """Multilateration of a machine with waves in EXX, whose pitch is stated."""
    campaign, _ = with_waves(SIZE, PITCH, pitch=PITCH, n=250)
    return volid.fit(campaign)


def test_the_size_of_a_hidden_wave_is_that_of_the_wave(wavy):
    (hidden,) = hidden_waves(wavy, curves(wavy))
    assert (hidden.axis, hidden.pitch, list(hidden.sizes)) == ("X", PITCH, ["EXX", "EYX", "EZX"])
    size, expanded = hidden.sizes["EXX"]
    assert expanded < 0.5 * SIZE
    assert size == pytest.approx(SIZE, abs=expanded)
    assert all(hidden.sizes[name][0] < 1.5 * hidden.sizes[name][1] for name in ("EYX", "EZX")), (
        "no wave was added to them"
    )


def test_between_listed_positions_the_wave_is_missing_which_is_why_it_is_said(wavy):
    own = next(c for c in curves(wavy) if c.name == "EXX")
    between = np.linspace(own.positions[0], own.positions[-1], 1001)
    found = [r for r in wavy.motion("EXX", between) if r.direction == own.direction]
    off = [abs(r.value - v) for r, v in zip(found, np.interp(between, own.positions, own.values), strict=True)]
    assert max(off) > SIZE > 4.0 * max(own.u)


def test_sheet_and_certificate_say_it_in_both_languages(wavy, tmp_path):
    for lang, sheet, words in (("en", "Functions", "period 17 mm"), ("de", "Funktionen", "Periode 17 mm")):
        volid.save_workbook(wavy, tmp_path / f"{lang}.xlsx", lang=lang)
        book = openpyxl.load_workbook(tmp_path / f"{lang}.xlsx")
        *_, note = [row[0] for row in book[f"{sheet} X"].iter_rows(values_only=True)]
        assert words in note and "EXX" in note and "X" in note
        assert not [
            row[0] for row in book[f"{sheet} Z"].iter_rows(values_only=True, min_row=2) if isinstance(row[0], str)
        ]
    volid.save_dcc(wavy, tmp_path / "result.xml")
    root = ET.parse(tmp_path / "result.xml").getroot()
    said = {c.get("lang") for c in root.iter("{https://ptb.de/dcc}content") if c.text and "17 mm" in c.text}
    assert said == {"en", "de"}


def test_without_a_pitch_nothing_is_said():
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    assert hidden_waves(solution, curves(solution)) == []
