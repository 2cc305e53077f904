"""The pages of the site are true: their commands end as said, their Python runs, the lines that they show are printed."""

import argparse
import re
import shutil
import sys

import pytest
from support.documents import blocks, compare_with_printed
from support.instrument_files import SAMPLES
from support.places import ROOT

from volid.cli import main

PAGES = sorted(p for p in (ROOT / "docs").rglob("*.md") if not p.relative_to(ROOT / "docs").parts[0].startswith("_"))
NAMES = [p.relative_to(ROOT / "docs").as_posix() for p in PAGES]
RUN = [(p, n) for p, n in zip(PAGES, NAMES, strict=True) if any(b.language in ("console", "python") for b in blocks(p))]
QUICK = {"howto/interferometer.md", "howto/iso_standards.md"}


@pytest.fixture(scope="session")
def bundled(tmp_path_factory):
    """A folder with the bundled campaigns and machines, a solution of one of them, and a file of a laser interferometer."""
    folder = tmp_path_factory.mktemp("site")
    for name in ("datasets", "models"):
        shutil.copytree(ROOT / name, folder / name)
    (folder / "x.rtl").write_text(SAMPLES["rtl"].text, encoding="utf-8")
    shutil.copy(ROOT / "models" / "wYXbZt_vertical.toml", folder / "machine.toml")
    return folder


@pytest.fixture(scope="session")
def fitted_campaign(bundled):
    """The solution of the bundled tracker campaign, which most pages begin with."""
    import volid

    campaign = volid.load_campaign(bundled / "datasets/vertical_multilateration/campaign.toml")
    volid.save_solution(volid.fit(campaign), bundled / "solution.h5")
    return bundled / "solution.h5"


@pytest.fixture
def workplace(bundled, tmp_path, monkeypatch):
    """A folder of its own for every page."""
    for place in bundled.iterdir():
        if place.is_dir():
            shutil.copytree(place, tmp_path / place.name)
        elif place.suffix != ".h5":
            shutil.copy(place, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("page", "name"),
    [pytest.param(p, n, id=n, marks=() if n in QUICK else pytest.mark.slow) for p, n in RUN],
)
def test_blocks_of_a_page(page, name, workplace, request, capsys):
    found = blocks(page)
    texts = "".join(b.text for b in found)
    if "solution.h5" in texts and "-o solution.h5" not in texts:
        shutil.copy(request.getfixturevalue("fitted_campaign"), workplace)
    names: dict = {}
    printed = ""
    for block in found:
        if block.caption:
            (workplace / block.caption).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            exec(compile(block.text, name, "exec"), names)
        elif block.language == "text":
            compare_with_printed(block.text, printed)
        statuses = [main(words) for words in block.commands()] if block.language == "console" else []
        out, err = capsys.readouterr()
        printed += out + err
        assert statuses in ([], [0] * (len(statuses) - 1) + [block.status]), (block.text, err)
    assert sys.modules["volid"]


def test_every_page_is_reached():
    """Each page stands in a table of contents, by its name or by a pattern for all of its folder."""
    contents = {
        (p.parent / line.strip()).resolve()
        for p in PAGES
        for b in blocks(p)
        if b.language == "{toctree}"
        for line in b.text.splitlines()
        if line.strip() and not line.startswith(":")
    }
    folders = {place.parent for place in contents if place.name == "*"}
    left = [
        n
        for p, n in zip(PAGES, NAMES, strict=True)
        if n != "index.md" and p.with_suffix("").resolve() not in contents and p.parent.resolve() not in folders
    ]
    assert left == []


def test_no_block_is_overlooked():
    """Every fence stands at the beginning of its line, where the reader of blocks sees it."""
    assert [
        n for p, n in zip(PAGES, NAMES, strict=True) if re.search(r"^ +(```|:::)", p.read_text(encoding="utf-8"), re.M)
    ] == []


def test_every_verb_is_on_a_page():
    from volid.cli import VERBS

    texts = "\n".join(
        p.read_text(encoding="utf-8") for p in PAGES if p.parent.name == "howto" or p.name == "tutorial.md"
    )
    assert [verb for verb in VERBS if f"volid {verb}" not in texts] == []


def test_every_option_on_a_page_exists():
    """Of volid or of the programs that the page itself calls; README and how-to pages name many."""
    from volid.cli import VERBS, _parser

    known = {"--help", "--version", "--keep-going"}
    for verb in VERBS:
        known |= set(options(_parser(verb)))
    named = {
        (name, option)
        for page, name in [*zip(PAGES, NAMES, strict=True), (ROOT / "README.md", "README.md")]
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", page.read_text(encoding="utf-8"))
        if name != "validation.md"  # of the benchmarks
    }
    assert sorted((n, o) for n, o in named if o not in known) == []


def options(parser):
    """Option strings of a parser and of the verbs below it."""
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from options(child)
