"""`volid report --workbook --dcc`: the files beside the page, and what is refused before the work."""

import xml.etree.ElementTree as ET

import openpyxl
import pytest
from support.dcc_schema import violations

import volid

DATA = 'country = "DE"\nbegin = 2026-03-11\nend = 2026-03-12\n[machine]\nserial_number = "0815"\n'


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """A small solution as a file."""
    path = tmp_path_factory.mktemp("published") / "solution.h5"
    volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml")).save(path)
    return path


def test_workbook_and_result_file_beside_the_page(run, published, tmp_path):
    (tmp_path / "lab.toml").write_text(DATA)
    names = [tmp_path / name for name in ("report.html", "result.xlsx", "result.xml")]
    more = ["--workbook", names[1], "--dcc", names[2], "--dcc-data", tmp_path / "lab.toml", "--lang", "de"]
    _, out, err = run("report", published, "-o", names[0], *more)
    assert f"written: {', '.join(map(str, names))}" in out and names[0].stat().st_size > 1000
    assert "unsigned result file; not stated, and named in it: identifier, place" in out + err
    book, root = openpyxl.load_workbook(names[1]), ET.parse(names[2]).getroot()
    assert {"Ergebnis", "Kompensation", "Funktionen X"} <= set(book.sheetnames)
    assert violations(root) == []
    values = [e.text for e in root.iter("{https://ptb.de/dcc}value")]
    dates = [e.text for e in root.iter() if e.tag.endswith("PerformanceDate")]
    assert "0815" in values and dates == ["2026-03-11", "2026-03-12"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--workbook", "a.csv"], "a.csv: the file ends in .xlsx"),
        (["--dcc", "a.txt"], "a.txt: the file ends in .xml"),
        (["--dcc-data", "lab.toml"], "is for --dcc, which is not asked for"),
        (["--dcc", "a.xml", "--dcc-data", "lab.toml"], "lab.toml: 'labor' is not known"),
        (["--dcc", "there.xml"], "there.xml exists"),
        (["--dcc", "r.xml", "-o", "r.xml"], "asked for twice"),
    ],
)
def test_refused_before_the_work(run, published, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab.toml").write_text("labor = 1\n")
    (tmp_path / "there.xml").write_text("mine")
    output = [] if "-o" in arguments else ["-o", "report.html"]
    status, _, err = run("report", published, *output, *arguments)
    assert status == 2 and message in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lab.toml", "there.xml"]
    assert (tmp_path / "there.xml").read_text() == "mine"
