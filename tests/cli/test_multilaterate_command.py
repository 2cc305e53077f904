"""`volid multilaterate`: files in, files out, exit status, and what it says to wrong files."""

import argparse
import csv
import json

import numpy as np
import pytest
from support.places import LITERATURE

from volid.cli import multilaterate
from volid.exceptions import InputError, OutputError
from volid.io.networks import network_from_csv

TEXTBOOK = json.loads((LITERATURE / "textbook_networks.json").read_text(encoding="utf-8"))


@pytest.fixture
def files(tmp_path):
    """Writes a textbook network as the two CSV files; returns their paths."""

    def write(name):
        case = TEXTBOOK[name]
        rows = [f"{a},{b},{d!r},{case['sigma']}" for a, b, d in case["observations"]]
        distances = tmp_path / "distances.csv"
        distances.write_text("\n".join(["# metres", "from,to,distance,u", *rows]), encoding="utf-8")
        axes = "xyz"[: len(next(iter(case["approximate"].values())))]
        lines = [
            ",".join([point, *map(repr, x), str(int(point in case["fixed"]))])
            for point, x in case["approximate"].items()
        ]
        points = tmp_path / "points.csv"
        points.write_text("\n".join([",".join(["point", *axes, "fixed"]), *lines]), encoding="utf-8")
        return distances, points

    return write


def run(*arguments):
    parser = argparse.ArgumentParser()
    multilaterate.add_arguments(parser)
    return multilaterate.run(parser.parse_args([str(argument) for argument in arguments]))


def table(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_free_network_to_csv(files, tmp_path, capsys):
    distances, points = files("StrangBorre1997_2D_free")
    out = tmp_path / "out.csv"
    assert run(distances, "--approximate", points, "-o", out) == 0
    solution = TEXTBOOK["StrangBorre1997_2D_free"]["solution"]
    for row in table(out):
        found = [float(row["x"]), float(row["y"])]
        np.testing.assert_allclose(found, solution["coords"][row["point"]], rtol=0, atol=1e-6)
        assert row["fixed"] == "0"
    assert "4 points (0 fixed), 6 distances, 2-D: rank 5, defect 3, 1 degrees of freedom" in capsys.readouterr().out


def test_result_can_be_read_back_as_coordinates(files, tmp_path):
    distances, points = files("Wolf1979_3D_fix")
    out = tmp_path / "out.csv"
    run(distances, "--approximate", points, "-o", out)
    text = [
        ",".join(line.split(",")[:4] + line.split(",")[-1:]) for line in out.read_text().splitlines() if "#" not in line
    ]
    again = tmp_path / "again.csv"
    again.write_text("\n".join(text))
    network = network_from_csv(distances, again)
    assert network.fixed == ("1", "2", "3", "4")
    np.testing.assert_allclose(
        network.known["P"], TEXTBOOK["Wolf1979_3D_fix"]["solution"]["coords"]["P"], rtol=0, atol=1e-6
    )


def test_blunders_are_named_with_their_rows_and_the_status_is_1(files, tmp_path, capsys):
    distances, points = files("BlankenbachWillert2009_3D_all")
    out, residuals = tmp_path / "out.csv", tmp_path / "residuals.csv"
    assert run(distances, "--approximate", points, "--robust", "-o", out, "--residuals", residuals) == 1
    text = capsys.readouterr().out
    assert "row 3, MS to 51, 8.2: left out as a blunder" in text
    assert "row 9, MS to 103, 8.17: left out as a blunder" in text
    assert text.count("blunder,") == 2
    assert [row["to"] for row in table(residuals) if row["blunder"] == "1"] == ["51", "103"]
    found = next(row for row in table(out) if row["point"] == "MS")
    np.testing.assert_allclose([float(found[k]) for k in "xyz"], [-2.5078, 24.3202, 9.7753], rtol=0, atol=1e-4)


def test_rejected_model_is_named_without_robust(files, capsys):
    distances, points = files("BlankenbachWillert2009_3D_all")
    assert run(distances, "--approximate", points) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith("# adjusted coordinates")
    assert "contradict each other by more than the stated u" in printed.err


def test_undetermined_point_is_named(files, capsys):
    distances, points = files("Wolf1979_3D_fix")
    distances.write_text(distances.read_text() + "\n1,Q,400,0.01\n2,Q,500,0.01")
    points.write_text(points.read_text() + "\nQ,1000,1000,1100,0")
    assert run(distances, "--approximate", points) == 1
    assert "do not determine 1 combinations of the coordinates of Q" in capsys.readouterr().err


def test_json_holds_everything(files, capsys):
    distances, points = files("Hoepke1980_2D_free")
    assert run(distances, "--approximate", points, "--json") == 1  # its u is five times too small
    found = json.loads(capsys.readouterr().out)
    solution = TEXTBOOK["Hoepke1980_2D_free"]["solution"]
    for point in found["points"]:
        np.testing.assert_allclose(point["coordinates"], solution["coords"][point["point"]], rtol=0, atol=1e-6)
    assert found["unit_weight"] == pytest.approx(solution["sigma0_post"] / 0.001, rel=1e-6)
    assert (found["rank"], found["defect"]) == (solution["rank"], solution["defect"])
    assert found["suspects"] == []
    assert "contradict each other" in found["attention"][0]


def test_coordinates_are_found_without_approximate_ones(files, capsys):
    distances, _ = files("StrangBorre1997_2D_free")
    assert run(distances, "--dimension", 2, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    x = {point["point"]: np.array(point["coordinates"]) for point in found["points"]}
    published = {k: np.array(v) for k, v in TEXTBOOK["StrangBorre1997_2D_free"]["solution"]["coords"].items()}
    for a, b in [("P", "1"), ("2", "3"), ("1", "3")]:
        assert np.linalg.norm(x[a] - x[b]) == pytest.approx(np.linalg.norm(published[a] - published[b]), abs=1e-5)


def test_reliability_and_ellipsoids_stand_in_files_and_json(files, tmp_path, capsys):
    distances, points = files("Wolf1979_3D_fix")
    out = {name: tmp_path / f"{name}.csv" for name in ("residuals", "ellipsoids")}
    options = [cell for name, path in out.items() for cell in (f"--{name}", path)]
    assert run(distances, "--approximate", points, *options, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    rows = table(out["residuals"])
    # four distances of one length to one point straight above: each is checked equally, by one degree of freedom in all
    np.testing.assert_allclose([float(row["redundancy"]) for row in rows], 0.25, atol=1e-4)
    np.testing.assert_allclose(
        [float(row["detectable_error"]) for row in rows], np.sqrt(17.07 / 0.25) * 0.01, rtol=1e-3
    )
    assert {row["influenced_point"] for row in rows} == {"P"}
    assert [row["redundancy"] for row in found["observations"]] == pytest.approx([0.25] * 4, abs=1e-4)
    (ellipsoid,) = table(out["ellipsoids"])
    published = np.array(TEXTBOOK["Wolf1979_3D_fix"]["solution"]["std"]["P"])  # a posteriori, unit weight 1
    np.testing.assert_allclose([float(ellipsoid[k]) for k in "abc"], np.sort(published)[::-1], rtol=1e-4)
    np.testing.assert_allclose([float(ellipsoid[f"c_{k}"]) for k in "xyz"], [0, 0, 1], atol=1e-3)
    assert float(ellipsoid["scale_95"]) == pytest.approx(2.7955, abs=1e-4)
    point = next(point for point in found["points"] if point["point"] == "P")
    assert point["ellipsoid"]["semi_axes"] == pytest.approx([float(ellipsoid[k]) for k in "abc"], rel=1e-5)


def test_point_without_coordinates_above_coplanar_stations_is_found_on_both_sides(files, capsys):
    distances, points = files("Wolf1979_3D_fix")
    points.write_text("\n".join(line for line in points.read_text().splitlines() if not line.startswith("P")))
    assert run(distances, "--approximate", points, "--json") == 1
    found = json.loads(capsys.readouterr().out)
    heights = [next(p for p in found["points"] if p["point"] == "P")["coordinates"][2]]
    heights.append(found["alternatives"][0]["coordinates"][0][2])
    assert sorted(heights) == pytest.approx([1800 - 1300.00625, 1300.00625], abs=1e-4)  # stations at height 900
    assert "Nothing tells which is right" in found["attention"][0]


def test_parts_without_a_common_point_are_named_with_their_points(tmp_path, capsys):
    distances = tmp_path / "distances.csv"
    sides = ["A,B,3", "B,C,4", "C,A,5", "D,E,6", "E,F,8", "F,D,10"]
    distances.write_text("from,to,distance,u\n" + "".join(f"{side},0.01\n" for side in sides))
    assert run(distances, "--dimension", 2) == 1
    said = capsys.readouterr().err
    assert "falls into 2 parts without a common point (A, B, C; D, E, F)" in said


def test_good_approximate_coordinates_decide_between_two_sides(files, capsys):
    distances, points = files("Wolf1979_3D_fix")
    assert run(distances, "--approximate", points) == 0
    said = capsys.readouterr().err
    assert "note: The distances fit as well with P at (900.0167, 899.9833, 499.9938); the approximate" in said


def test_too_few_fixed_points_are_named(files, capsys):
    distances, points = files("StrangBorre1997_2D_free")
    lines = points.read_text().splitlines()
    points.write_text("\n".join([lines[0], lines[1].rsplit(",", 1)[0] + ",1", *lines[2:]]))
    assert run(distances, "--approximate", points) == 1
    assert "The fixed points leave 1 motion of the whole network open" in capsys.readouterr().err


def test_existing_output_is_kept_unless_forced(files, tmp_path):
    distances, points = files("Wolf1979_3D_fix")
    out = tmp_path / "out.csv"
    out.write_text("mine")
    with pytest.raises(OutputError, match=r"out\.csv exists"):
        run(distances, "--approximate", points, "-o", out)
    assert out.read_text() == "mine"
    assert run(distances, "--approximate", points, "-o", out, "--force") == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "distances.csv: the file is empty"),
        ("from,to,distance\nA,B,1", "header: column 'u' is missing"),
        ("from,to,distance,u,x\nA,B,1,1,1", "unknown column 'x'"),
        (
            "from,to,distance,u\nA,B,1,0.1\n# comment\nA,C,long,0.1",
            "row 4: distance is 'long'; expected a finite number",
        ),
        ("from,to,distance,u\nA,B,-1,0.1", "row 2: distance is -1; expected a number above 0"),
        ("from,to,distance,u\nA,B,1,0", "row 2: u is 0; expected a number above 0"),
        ("from,to,distance,u\nA,B,1e300,0.1", r"row 2: distance is 1e300; expected at most"),
        ("from,to,distance,u\nA,A,1,0.1", "row 2: from and to are both 'A'; expected two points"),
        ("from,to,distance,u\nA,,1,0.1", "row 2: to is empty; expected the name of a point"),
    ],
)
def test_wrong_distances_are_named(tmp_path, text, message):
    path = tmp_path / "distances.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        network_from_csv(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("point,x,y,z\nA,1,2,3\nA,1,2,3", "row 3: point 'A' stands twice"),
        ("point,x,y,z\nA,1,,3", "row 2: y is empty; expected all coordinates or none"),
        ("point,x,y,z,fixed\nA,1,2,3,maybe", "row 2: fixed is 'maybe'; expected 1 or 0"),
        ("point,x,y,z,fixed\nA,,,,1", "row 2: fixed point 'A' has no coordinates"),
        ("point,x\nA,1", "header: column 'y' is missing"),
        ("point,x,y\nA,1,2", r"header: coordinates x, y; expected 3 of them \(`dimension=3`\)"),
    ],
)
def test_wrong_coordinates_are_named(tmp_path, text, message):
    distances, points = tmp_path / "distances.csv", tmp_path / "points.csv"
    distances.write_text("from,to,distance,u\nA,B,1,0.1", encoding="utf-8")
    points.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        network_from_csv(distances, points, 3)


def test_help_has_an_example_that_is_right():
    parser = argparse.ArgumentParser()
    multilaterate.add_arguments(parser)
    example = next(line for line in parser.format_help().splitlines() if line.strip().startswith("volid multilaterate"))
    assert parser.parse_args(example.split()[2:]).robust
    assert multilaterate.HELP
