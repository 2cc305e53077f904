"""Stations that only the rows name: read without a table, and a misspelt one is noticed."""

import re
import shutil

import pytest
from support.campaign_files import MANIFEST, STATIONS, csv_text, edited, volume_rows, write_files
from support.places import TESTS

import volid
from volid.campaign import Station
from volid.exceptions import InputError
from volid.io import read_manifest

CASES = TESTS / "cases"


def renamed(rows, changes):
    """The rows with other names of stations in some places."""
    names = list(rows["station"])
    for place, name in changes.items():
        names[place] = name
    return csv_text(rows | {"station": names})


def without_tables(manifest):
    return re.sub(r"\[\[station\]\]\n(?:\w.*\n)+\n", "", manifest)


def test_no_tables_at_all(tmp_path):
    manifest = without_tables(MANIFEST)
    assert "station]]" not in manifest
    campaign = read_manifest(write_files(tmp_path, manifest=manifest))
    assert campaign.stations == (Station("S1"), Station("S2"))  # on the workpiece, nobody knows where
    assert campaign.warnings == ()


def test_a_table_for_what_is_known_of_one(tmp_path):
    manifest = edited(MANIFEST, f'[[station]]\nname = "S1"\nposition = {list(STATIONS["S1"])}\n', "")
    campaign = read_manifest(write_files(tmp_path, manifest=manifest))
    assert [s.name for s in campaign.stations] == ["S2", "S1"] and campaign.stations[1] == Station("S1")
    assert campaign.warnings == ()


@pytest.mark.parametrize(("tables", "name", "hint"), [(True, "s1", "S1"), (False, "S 1", "S1"), (True, "Q", None)])
def test_a_name_that_hardly_occurs(tmp_path, tables, name, hint):
    manifest = MANIFEST if tables else without_tables(MANIFEST)
    path = write_files(tmp_path, manifest=manifest, volume=renamed(volume_rows(), {7: name}))
    [warning] = read_manifest(path).warnings
    assert f"volume.csv, row 9: station '{name}' has 1 reading and no [[station]]" in warning
    assert (f"did you mean '{hint}'?" in warning) == (hint is not None)


def test_a_station_of_its_own_is_not_asked_about(tmp_path):
    changes = {i: "S3" for i in range(0, 54, 3)}
    campaign = read_manifest(write_files(tmp_path, volume=renamed(volume_rows(), changes)))
    assert [s.name for s in campaign.stations] == ["S1", "S2", "S3"] and campaign.warnings == ()


def test_a_fit_with_a_misspelt_station_names_it(tmp_path):
    case = CASES / "26_reading_of_1e300"
    shutil.copytree(case, tmp_path / "a")
    text = (case / "m3.csv").read_text(encoding="utf-8-sig").replace("1e300", "1432.10737")
    (tmp_path / "a" / "m3.csv").write_text(text.replace("12,Platz 1,", "12,Platz 11,", 1), encoding="utf-8")
    campaign = volid.load_campaign(tmp_path / "a" / "c.toml")
    assert (
        "m3.csv, row 13: station 'Platz 11' has 1 reading and no [[station]]; did you mean 'Platz 1'?"
        in campaign.warnings[0]
    )
    with pytest.raises(InputError, match=r"station Platz 11: .* or mend its name, that stands in 1 rows only"):
        volid.fit(campaign)
