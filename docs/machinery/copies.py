"""Texts that stand in the repository and are read on the site as well: copied, with their links turned to pages of the site.

Nothing is written twice: a file format is described where its files are, and the site shows that description. A link to a
file that is no page of the site becomes the name of the file.
"""

import os
import re
import shutil
from pathlib import Path, PurePosixPath

from machinery.writing import write

TEXTS = {  # in the repository: page below docs/
    "models/README.md": "_generated/models.md",
    "datasets/README.md": "_generated/datasets.md",
    "benchmarks/README.md": "_generated/benchmarks.md",
    "examples/linuxcnc/README.md": "_generated/linuxcnc_grid.md",
    "tests/literature/README.md": "_generated/literature.md",
    "CONVENTIONS.md": "_generated/conventions.md",
    "CHANGELOG.md": "_generated/changelog.md",
    "CONTRIBUTING.md": "_generated/contributing.md",
}
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")
_IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)\s]+)\)")


def pages(root: Path) -> dict[str, str]:
    """Files of the repository that are pages, with their places below docs/."""
    found = dict(TEXTS)
    for text in sorted((root / "datasets").glob("*/README.md")):
        found[f"datasets/{text.parent.name}/README.md"] = f"_generated/datasets/{text.parent.name}.md"
    for notebook in sorted((root / "notebooks").glob("*.ipynb")):
        found[f"notebooks/{notebook.name}"] = f"_generated/notebooks/{notebook.name}"
    for page in sorted((root / "docs").rglob("*.md")):
        inside = page.relative_to(root / "docs").as_posix()
        if not inside.startswith("_"):
            found[f"docs/{inside}"] = inside
    return found


def write_copies(root: Path, target: Path) -> None:
    """All of them, below docs/; `target` is docs/_generated."""
    known = pages(root)
    for source, page in known.items():
        if source.startswith("docs/"):
            continue
        text = (root / source).read_text(encoding="utf-8")
        if source.endswith(".md"):
            text = turned(text, source, page, known)
        write(target.parent / page, text)
    images = target / "images"
    images.mkdir(parents=True, exist_ok=True)
    shutil.copy(root / "benchmarks" / "growth.svg", images / "growth.svg")


def turned(text: str, source: str, page: str, known: dict[str, str]) -> str:
    """The text with links as they are on the site."""

    def link(match: re.Match[str]) -> str:
        words, address = match.groups()
        if re.match(r"[a-z]+:|#", address):
            return match.group()
        path, _, anchor = address.partition("#")
        named = os.path.normpath(PurePosixPath(source).parent / path)
        place = known.get(named) or known.get(f"{named}/README.md")
        if place is None:
            return words if words.startswith("`") else f"{words} (`{named}`)"
        relative = os.path.relpath(place, PurePosixPath(page).parent)
        return f"[{words}]({relative}{'#' + anchor if anchor else ''})"

    return _LINK.sub(link, _IMAGE.sub(r"\1", text))
