"""The README is true: its Python example runs, its commands exist, its map names what is there."""

import os
import re
import shlex
import subprocess
import sys

import pytest
from support.documents import compare_with_printed
from support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """An empty folder with the bundled datasets in it, so that nothing is written into the project."""
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_python_example_runs_and_finds_the_true_squareness(elsewhere, capsys):
    (example,) = blocks("python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)
    table = (elsewhere / "datasets/vertical_multilateration/truth_functions.csv").read_text()
    true = float(re.search(r"^EC0Y,.*,(\S+)$", table, re.M).group(1))
    printed = capsys.readouterr().out
    value, expanded = (float(v) for v in re.search(r"EC0Y = (\S+) µm/m, U = (\S+)", printed).groups())
    assert abs(value - 1e6 * true) < 2 * expanded  # four standard uncertainties
    assert names["slope"].shape == (6, 3)
    assert len((elsewhere / "grid.csv").read_text().splitlines()) > 11**3


def commands() -> list[list[str]]:
    found = []
    for block in blocks("bash"):
        for part in re.split(r"&&|\n", block):
            words = shlex.split(part)
            if words and words[0].endswith("bin/volid"):
                found.append(words[1:])
    return found


def test_commands_of_the_readme_run(elsewhere):
    assert [words[0] for words in commands()] == ["fit", "grid", "report"]
    printed = []
    for words in commands():
        run = subprocess.run([sys.executable, "-m", "volid", *words], capture_output=True, text=True, env=os.environ)
        assert run.returncode == 0, run.stderr
        printed.append(run.stdout)
    (shown,) = blocks("text")
    compare_with_printed(shown, printed[0])
    first_screen_says_the_same((elsewhere / "out" / "report.html").read_text(encoding="utf-8"), shown)
    assert {p.name for p in (elsewhere / "out").iterdir()} == {
        "solution.h5",
        "grid.csv",
        "report.html",
    }


def first_screen_says_the_same(page: str, shown: str) -> None:
    """Verdict, squareness and largest deviation with their U stand in the first section of the report, as in the README."""
    first = re.search(r"<main.*?</section>", page, re.S).group()
    text = " ".join(re.sub(r"<[^>]+>", " ", first).replace("\u202f", " ").split())
    assert "Accepted" in text
    value, expanded = re.search(r"EC0Y .*90°\s+(\S+)\s+(\S+)", shown).groups()
    assert re.search(rf"EC0Y {value} ± {expanded} µrad", text), text[:1500]
    (largest,) = re.findall(r"^deviation +largest (\S+) µm", shown, re.M)
    on_page, u = map(float, re.search(r"Largest deviation in the volume (\S+) ± (\S+)", text).groups())
    assert abs(on_page - float(largest)) < 0.06 and 0.1 < u < 2.0  # µm: U of a deviation is some tenths of a µm here


def test_ci_calls_the_readmes_test_command():
    (line,) = [b for b in blocks("bash") if "pytest" in b]
    command = line.strip().split("&&")[-1].strip()
    assert command in (ROOT / ".ci" / "run").read_text()


def test_links_of_texts_lead_somewhere():
    """Files and folders that the texts for readers of the repository link to, or name in backquotes."""
    for name in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for path in re.findall(r"`((?:src|models|datasets|notebooks|tests|docs)/[\w/.]*)`", text):
            assert (ROOT / path).exists() or path.startswith("docs/_"), (name, path)
        for path in re.findall(r"\]\((?!https?:)([^)#]+)", text):
            assert (ROOT / path).exists(), (name, path)


def test_picture_stands_on_the_first_screen():
    """One picture of a result, made by a script beside it, small enough for a slow line."""
    (path,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert (ROOT / path).stat().st_size < 200_000 and (ROOT / path).parent.joinpath("make.py").exists()
    assert README[: README.index(path)].count("\n") < 15


def test_readme_is_short():
    assert len(README.splitlines()) <= 130


def test_map_names_every_room():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"Rooms of `src/volid`.*?\n\n(.*?)\n\n", text, re.S)
    named = [cell for row in table.splitlines() for cell in re.findall(r"`([\w./]+)`", row.split("|")[1])]
    package = ROOT / "src" / "volid"
    rooms = [p.name + "/" for p in package.iterdir() if (p / "__init__.py").exists()]
    modules = [p.name for p in package.glob("*.py") if not p.name.startswith("__")]
    assert sorted(named) == sorted(rooms + modules)


def test_every_verb_is_listed():
    from volid.cli import VERBS

    assert all(f"`{verb}`" in README or f"volid {verb}" in README for verb in VERBS)


def test_documented_manifests_and_machine_file_are_read(tmp_path):
    from volid.io import load_campaign

    (machine,) = re.findall(r"```toml\n(.*?)```", (ROOT / "models/README.md").read_text(encoding="utf-8"), re.S)
    (tmp_path / "machine.toml").write_text(machine, encoding="utf-8")
    datasets = (ROOT / "datasets/README.md").read_text(encoding="utf-8")
    examples = re.findall(r"`(\w+\.csv)` begins `([^`]*)`:\n```toml\n(.*?)```", datasets, re.S)
    assert len(examples) == 7
    (tmp_path / "plate.csv").write_text("point,x,y,z\nA1,0,0,0\n", encoding="utf-8")
    cells = {
        "component": "X",
        "line": "leg_Y",
        "displacement": "0",
        "segment": "1",
        "distance": "300",
        "X_dir": "1",
        "Y_dir": "0",
        "Z": "-100",
        "point": "A1",
    }
    for name, header, manifest in examples:
        station = re.search(r'\[\[station\]\]\nname = "(\w+)"', manifest)
        row = [
            station[1]
            if column == "station"
            else {"diagonals.csv": {"line": "PPP"}}.get(name, {}).get(column, cells.get(column, "0.5"))
            for column in header.split(",")
        ]
        (tmp_path / name).write_text(f"{header}\n{','.join(row)}\n", encoding="utf-8")
        (tmp_path / "campaign.toml").write_text(manifest, encoding="utf-8")
        expected = 3 if "plate.csv" in manifest else 1  # coordinates of a row
        assert load_campaign(tmp_path / "campaign.toml").n_readings == expected


def test_every_kind_of_set_is_documented():
    from volid.observations import KINDS

    datasets = (ROOT / "datasets/README.md").read_text(encoding="utf-8")
    for name, kind in KINDS.items():
        cells = [line.split(" | ")[0] for line in datasets.splitlines() if line.startswith("| `")]
        assert any(f"`{name}`" in cell for cell in cells), name
        keys = {*kind.labels, *kind.options, *kind.optional}
        assert not [key for key in keys if f"`{key}" not in datasets], name
