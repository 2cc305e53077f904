"""Calibrated points and covariance in files: read beside a set, kept in HDF5, written again, and named where they are wrong."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, machine_toml
from support.sets import assert_same_set

from volid.exceptions import InputError
from volid.io import load_campaign, read_manifest, write_campaign, write_manifest
from volid.plausibility.checks import check_campaign

EXACT = ExactMachine("w b X Y Z t", {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)})
MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
[[set]]
name = "plate"
kind = "artefact"
file = "found.csv"
points = "plate.csv"
tool = [0.0, 0.0, -150.0]
u = 0.0005
centres = true
{keys}
"""
POINTS = "point,x,y,z,u\nA1,0,0,0,0.0003\nA2,100,0.01,0.002,0.0003\nB1,0.02,100,0,\nB2,100,100.01,0.001,0.0004\n"
FOUND = "X,Y,Z,point,placement\n100,100,-200,A1,1\n200,100.01,-199.998,A2,1\n100.02,200,-200,B1,1\n200,200.01,-199.999,B2,1\n"
COVARIANCE = "name,A1 x,A2 x\nA1 x,9e-8,4e-8\nA2 x,4e-8,9e-8\n"


def write(folder, points=POINTS, found=FOUND, keys="", covariance=None):
    (folder / "machine.toml").write_text(machine_toml(EXACT))
    (folder / "plate.csv").write_text(points)
    (folder / "found.csv").write_text(found)
    if covariance is not None:
        (folder / "cov.csv").write_text(covariance)
        keys += '\ncovariance = "cov.csv"'
    (folder / "campaign.toml").write_text(MANIFEST.format(keys=keys))
    return folder / "campaign.toml"


def test_centres_and_points_are_read(tmp_path):
    campaign = read_manifest(write(tmp_path))
    (s,) = campaign.sets
    np.testing.assert_array_equal(s.positions[1], [200.0, 100.01, -199.998])
    assert not s.readings.any() and s.u.shape == (4, 3)
    assert s.options["points"]["1"]["A2"] == [100.0, 0.01, 0.002, 3e-4, 3e-4, 3e-4]
    assert s.options["points"]["1"]["B1"][3:] == [0.0, 0.0, 0.0], "an empty u: exact"
    assert s.labels["artefact"].tolist() == ["1"] * 4 and s.labels["run"].tolist() == ["1"] * 4
    assert check_campaign(campaign) == ()


def test_one_artefact_that_is_named_once_is_the_same(tmp_path):
    named = POINTS.replace("point,", "artefact,point,").replace("\nA", "\nplate,A").replace("\nB", "\nplate,B")
    (s,) = read_manifest(write(tmp_path, named)).sets
    assert s.labels["artefact"].tolist() == ["plate"] * 4
    rows = FOUND.replace("placement\n", "placement,artefact\n").replace(",1\n", ",1,disc\n")
    (s,) = read_manifest(write(tmp_path, found=rows)).sets
    assert list(s.options["points"]) == ["disc"]


def test_deviations_from_commanded_positions_are_readings(tmp_path):
    found = "X,Y,Z,point,x,y,z\n" + "".join(
        f"{x},{y},-200,{n},{d},0,0\n"
        for x, y, n, d in ((100, 100, "A1", 0.01), (200, 100, "A2", 0.02), (100, 200, "B1", 0.0))
    )
    (s,) = load_campaign(_without_centres(write(tmp_path, found=found))).sets
    np.testing.assert_array_equal(s.readings[:, 0], [0.01, 0.02, 0.0])


def _without_centres(path):
    path.write_text(path.read_text().replace("centres = true\n", ""))
    return path


def test_other_columns_units_and_delimiters_of_points(tmp_path):
    points = "point;x [m];y [m];z [m];u_x [mm];u_y [mm];u_z [mm]\nA1;0;0;0;0,0003;0,0002;0,001\nA2;0,1;0,00001;0,000002;0;0;0\n"
    points += "B1;0,00002;0,1;0;0;0;0\nB2;0,1;0,10001;0,000001;0;0;0\n"
    campaign = read_manifest(write(tmp_path, points))
    rows = campaign.sets[0].options["points"]["1"]
    np.testing.assert_allclose(rows["A1"][3:], [3e-4, 2e-4, 1e-3])
    np.testing.assert_allclose(rows["A2"][:3], [100.0, 0.01, 0.002], rtol=1e-12)
    assert any("plate.csv" in note and "decimal commas" in note for note in campaign.warnings)


def test_holes_need_no_third_coordinate(tmp_path):
    points = "point,x,y,u\nA1,0,0,0.0003\nA2,100,0.01,0.0003\nB1,0.02,100,0.0003\nB2,100,100.01,0.0003\n"
    (s,) = read_manifest(write(tmp_path, points, keys='components = "XY"')).sets
    assert s.options["points"]["1"]["A2"][:3] == [100.0, 0.01, 0.0]
    with pytest.raises(InputError, match=r"plate\.csv, header: column 'z' is missing; every calibrated point"):
        read_manifest(write(tmp_path, points))


@pytest.mark.parametrize("covariance", [None, COVARIANCE])
def test_text_and_hdf5_lose_nothing_and_need_no_other_file(tmp_path, covariance):
    (tmp_path / "first").mkdir()
    campaign = read_manifest(write(tmp_path / "first", covariance=covariance))
    write_campaign(campaign, tmp_path / "c.h5")
    again = [load_campaign(tmp_path / "c.h5"), load_campaign(write_manifest(campaign, tmp_path / "text"))]
    again.append(load_campaign(write_manifest(campaign, tmp_path / "one.toml")))
    for other in again:
        assert_same_set(replace(other.sets[0], source="", rows=None), replace(campaign.sets[0], source="", rows=None))
    names = {p.name for p in (tmp_path / "text").iterdir()}
    expected = {"campaign.toml", "machine.toml", "plate.csv", "plate.points.csv"}
    assert names == expected | ({"plate.covariance.csv"} if covariance else set())


def test_files_of_two_sets_do_not_overwrite_each_other(tmp_path):
    campaign = read_manifest(write(tmp_path))
    (s,) = campaign.sets
    sets = (s, replace(s, name="plate.points"))
    again = load_campaign(write_manifest(replace(campaign, sets=sets), tmp_path / "text"))
    for one, other in zip(sets, again.sets, strict=True):
        assert_same_set(replace(one, source="", rows=None), replace(other, source="", rows=None))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"points": POINTS.replace("100,0.01", "100,oops")},
            r"plate.csv, row 3: y is 'oops'; expected a finite number.* in mm",
        ),
        ({"points": POINTS.replace("A2,100", "A2,")}, "plate.csv, row 3: x is empty"),
        ({"points": POINTS.replace("A2", "A1")}, "plate.csv, row 3: point 'A1' stands twice"),
        (
            {"points": POINTS.replace("0.0004", "-0.0004")},
            "plate.csv, row 5: u is -0.0004; expected a standard uncertainty",
        ),
        ({"points": POINTS.replace("point,", "punkt,")}, "plate.csv, header: .*'?punkt"),
        ({"points": POINTS.replace(",u\n", ",v\n")}, "plate.csv, header: .*'?v'?"),
        ({"points": ""}, "plate.csv"),
        ({"points": POINTS.replace("u\n", "u_x\n").replace("z,", "u,")}, "plate.csv, header: .*(z|u beside u_x)"),
        (
            {"found": FOUND.replace("B2", "B3")},
            "found.csv, row 5: point 'B3' is not among the 4 calibrated points",
        ),
        ({"found": FOUND.replace(",point,", ",name,")}, "found.csv, header: .*point"),
        (
            {"covariance": COVARIANCE.replace("name,A1 x,A2 x", "name,A1 x,A3 x")},
            "cov.csv: 'A2 x' is named in a row only",
        ),
        ({"covariance": COVARIANCE.replace("A1 x", "A7 x")}, "'A7 x' is no coordinate of a calibrated point"),
        ({"covariance": COVARIANCE.replace("9e-8,4e-8\n", "9e-8,5e-8\n")}, "expected a symmetric matrix"),
        (
            {"covariance": COVARIANCE.replace("9e-8", "1e-8")},
            "(negative variance|standard uncertainty of A1 x is 0.0001 mm)",
        ),
        ({"covariance": COVARIANCE.replace("name,", "row,")}, "cov.csv, header: .*name"),
    ],
)
def test_wrong_points_and_covariances_are_named(tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        read_manifest(write(tmp_path, **change))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('points = "plate.csv"', 'points = "other.csv"', "other.csv: there is no such file"),
        ('points = "plate.csv"', "points = 3", 'points is 3; expected the name of a file, such as "plate.csv"'),
        ('points = "plate.csv"', "", "there are no calibrated points"),
        ('points = "plate.csv"', 'points = "../plate.csv"', "points is .*outside the manifest's folder"),
        ("centres = true", 'centres = true\ncovariance = "../c.csv"', "covariance is .*outside the manifest's folder"),
        ("centres = true", "", "column 'x' is missing.*add centres = true to the set"),
        ("centres = true", "centres = true\ncovariance = 1", "covariance is 1; expected the name of a file"),
        ("u = 0.0005", "u = 0.0005\nscale_u = -1e-6", "scale_u is -1e-06; expected a finite number >= 0"),
    ],
)
def test_wrong_keys_are_named(tmp_path, old, new, said):
    path = write(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=said):
        read_manifest(path)
