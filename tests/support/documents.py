"""Texts for readers as tests: what their blocks say is done, and what they show is compared with what is printed.

A page is read from top to bottom. In a block `console` every line is a command; `toml`, `csv` and `text` with a caption are files
of that name, which are written before the next command runs. A block `text` without caption shows printed lines: the words
must be there as they stand, numbers may differ by 3 %. A line `% exit status 1` above a block says that its last command
ends so; `% an illustration` that a block is not run.
"""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_BLOCK = re.compile(
    r"(?P<remark>^%[^\n]*\n)?^(?P<fence>`{3,}|:{3,})(?P<head>[^\n`]*)\n(?P<body>.*?)^(?P=fence)\s*$", re.S | re.M
)


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its caption (the name of a file) and its text."""

    language: str
    caption: str
    text: str
    status: int

    def commands(self) -> list[list[str]]:
        """The words of every command, without the program's name; lines that end in a backslash go on."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("volid ")]


def blocks(page: Path) -> list[Block]:
    """All blocks of a page in their order, without those that are illustrations only."""
    found = []
    for match in _BLOCK.finditer(page.read_text(encoding="utf-8")):
        remark, head, body = match["remark"] or "", match["head"].strip(), match["body"]
        if "an illustration" in remark:
            continue
        caption = re.match(r":caption: (\S+)\n\n?", body)
        language = re.sub(r"^\{code-block\}\s*", "", head)
        status = re.search(r"exit status (\d+)", remark)
        text = body[caption.end() :] if caption else body
        found.append(Block(language, caption[1] if caption else "", text, int(status[1]) if status else 0))
    return found


def compare_with_printed(shown: str, printed: str) -> None:
    """Every line shown is in what was printed: the same words, numbers within 3 %; a line … stands for any left out."""
    own_lines = [" ".join(line.split()) for line in printed.splitlines() if line.strip()]
    for line in shown.strip().splitlines():
        words = " ".join(line.split())
        if not words or words == "…":
            continue
        alike = [own for own in own_lines if NUMBER.sub("#", own) == NUMBER.sub("#", words)]
        assert alike, f"not printed: {words}"
        assert any(close(own, words) for own in alike), (words, alike)


def close(own: str, shown: str) -> bool:
    """Whether all numbers of both lines agree within 3 % and the last digit shown."""
    pairs = zip(NUMBER.findall(own), NUMBER.findall(shown), strict=True)
    return all(abs(float(a) - float(b)) <= 0.03 * abs(float(a)) + 0.11 for a, b in pairs)
