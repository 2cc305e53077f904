"""Files of a control that were active while measuring: named in the record, kept in the campaign, found again."""

import re

import pytest
from support.campaign_files import MANIFEST, write_files

import volid
from volid.exceptions import InputError
from volid.io.campaign.manifest import write_manifest

COMP = "0 0.000 0.002\n500 500.010 500.013\n1000 999.996 999.999\n"
ENTRY = '{ file = "x.comp", cnc = "linuxcnc" }'
LISTED = 'active_compensations = ["L-POS"]'


def campaign_path(folder, entries, manifest=MANIFEST):
    """The small campaign with other `active_compensations`, and a file of a control beside it."""
    path = write_files(folder)
    path.write_text(manifest.replace(LISTED, f"active_compensations = {entries}"), encoding="utf-8")
    (folder / "x.comp").write_text(COMP)
    return path


def forward(campaign):
    """Error values in + of the first table that was active."""
    (found,) = volid.recorded_compensations(campaign)
    return found.compensation.axis_tables[0].forward.round(9).tolist()


def test_a_named_file_becomes_a_text_and_its_content_stays(tmp_path):
    campaign = volid.load_campaign(campaign_path(tmp_path, f'[{ENTRY}, "thermal compensation"]'))
    named, thermal = campaign.conditions["active_compensations"]
    assert thermal == "thermal compensation"
    assert re.fullmatch("L-POS: x.comp for linuxcnc, sha256 [0-9a-f]{12}", named)
    assert campaign.active_files[0].files == {"x.comp": COMP.encode()}
    assert forward(campaign) == [0.0, 0.010, -0.004]


def test_the_campaign_is_self_contained_through_text_and_hdf5(tmp_path):
    path = campaign_path(tmp_path, f"[{ENTRY}]")
    campaign = volid.load_campaign(path)
    volid.save_campaign(campaign, tmp_path / "one.h5")
    (tmp_path / "x.comp").unlink()
    stored = volid.load_campaign(tmp_path / "one.h5")
    write_manifest(stored, tmp_path / "folder")
    write_manifest(stored, tmp_path / "folder" / "PLAN.toml")
    for again in (stored, *(volid.load_campaign(tmp_path / "folder" / n) for n in ("campaign.toml", "PLAN.toml"))):
        assert again.conditions == campaign.conditions
        assert forward(again) == [0.0, 0.010, -0.004]


def test_options_say_how_the_file_is_meant(tmp_path):
    entry = '{ file = "x.comp", cnc = "linuxcnc", options = { comp_file_type = "1" } }'
    path = campaign_path(tmp_path, f"[{entry}]")
    (tmp_path / "x.comp").write_text("0 0.000 -0.002\n1000 0.004 0.001\n")
    volid.save_campaign(volid.load_campaign(path), tmp_path / "one.h5")
    for campaign in map(volid.load_campaign, (path, tmp_path / "one.h5")):
        assert forward(campaign) == [0.0, -0.004]


def test_own_tables_may_be_named(tmp_path):
    path = campaign_path(tmp_path, '[{ file = "EXX.csv" }]')
    keys = ["format: volid-table/1", "type: L-POS", "function: EXX", "values: compensation", "rows: absolute"]
    keys += ["applied: kinematic model", "zero: X = 0 mm", "period: none", "datum: primary axis X"]
    (tmp_path / "EXX.csv").write_text("\n".join([*(f"# {key}" for key in keys), "X,EXX", "0,0", "100,-0.01", ""]))
    (found,) = volid.recorded_compensations(volid.load_campaign(path))
    assert (found.cnc, found.types) == ("volid", ("L-POS",))
    assert found.compensation.tables[0].forward.tolist() == [0.0, 0.01]


def test_files_of_several_campaigns_are_kept_once(tmp_path):
    paths = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        paths.append(campaign_path(tmp_path / name, f"[{ENTRY}]"))
    text = paths[1].read_text().replace('name = "volume"', 'name = "volume 2"').replace('"levels"', '"levels 2"')
    paths[1].write_text(text)
    merged = volid.load_campaign(*paths)
    assert len(merged.active_files) == 1
    assert not [w for w in merged.warnings if "were active" in w]
    (tmp_path / "b" / "x.comp").write_text(COMP.replace("500.010", "500.011"))
    merged = volid.load_campaign(*paths)
    assert len(merged.active_files) == 2
    (said,) = [w for w in merged.warnings if "different files of a control were active while measuring" in w]
    assert "Fit them one by one" in said


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('{ file = "y.comp", cnc = "linuxcnc" }', "y.comp: there is no such file"),
        ('{ file = "../x.comp", cnc = "linuxcnc" }', 'file is "../x.comp", which is outside the manifest\'s folder'),
        ('{ file = "x.comp", cnc = "linuxnc" }', "`cnc=linuxnc` is no control that volid knows"),
        ('{ file = "x.comp", controller = "linuxcnc" }', "entry 1: unknown key 'controller'"),
        ('{ file = "x.comp", name = "../x.comp", cnc = "linuxcnc" }', "'../x.comp' is no plain name of a file"),
        ('{ cnc = "linuxcnc" }', "entry 1: key 'file' is missing"),
        ('{ file = 3, cnc = "linuxcnc" }', "file is 3; expected the name of a file"),
        ('{ file = "x.comp", cnc = "linuxcnc", sign = "error" }', "`sign=error`, but its values are actual position"),
        ('{ file = "x.comp", cnc = "linuxcnc", options = { step = "1" } }', "option 'step' is unknown"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(tmp_path, entry, message):
    with pytest.raises(InputError, match=re.escape(message)):
        volid.load_campaign(campaign_path(tmp_path, f"[{entry}]"))


def test_a_stored_name_with_folders_is_refused(tmp_path):
    """A campaign that was sent does not say where files are written."""
    from dataclasses import replace

    campaign = volid.load_campaign(campaign_path(tmp_path, f"[{ENTRY}]"))
    forged = replace(campaign.active_files[0], files={"../x.comp": COMP.encode()})
    volid.save_campaign(replace(campaign, active_files=(forged,)), tmp_path / "forged.h5")
    with pytest.raises(InputError, match=re.escape("'../x.comp' is no plain name of a file")):
        volid.load_campaign(tmp_path / "forged.h5")
