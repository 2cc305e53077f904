"""Writing a file only where its content changes, so that Sphinx reads again only what is new."""

from pathlib import Path


def write(path: Path, text: str) -> None:
    """The text to the file, and its folder where that is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
