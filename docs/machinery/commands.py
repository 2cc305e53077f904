"""The reference of the command line, from the parsers themselves: one page for each verb, with sections for its own verbs."""

import argparse
import os
import re
from collections.abc import Iterator
from pathlib import Path

from machinery.writing import write

_WIDTH = "90"  # columns of usage lines


def write_commands(target: Path) -> None:
    """A page for every verb and `index.md`, which lists them."""
    from volid.cli import VERBS, _parser

    os.environ["COLUMNS"] = _WIDTH
    for verb in VERBS:
        write(target / f"{verb}.md", "\n".join(section(chosen(_parser(verb), verb), 1)) + "\n")
    rows = [f"| [`volid {verb}`]({verb}.md) | {text} |" for verb, (_, text) in VERBS.items()]
    head = [
        "# Command line",
        "",
        "Made from the parsers of the program. What holds for every command stands [above](../../reference/index.md).",
        "",
        "| command | does |",
        "|---|---|",
    ]
    tree = ["", "```{toctree}", ":hidden:", "", *VERBS, "```"]
    write(target / "index.md", "\n".join(head + rows + tree) + "\n")


def chosen(parser: argparse.ArgumentParser, verb: str) -> argparse.ArgumentParser:
    """The parser of a verb among those of its parent."""
    return dict(children(parser))[verb]


def children(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Verbs below a parser, each once."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def section(parser: argparse.ArgumentParser, level: int) -> list[str]:
    """Heading, what it does, usage, arguments, and what its help ends with."""
    lines = ["#" * level + f" {parser.prog}", "", escaped(parser.description or ""), "", "```text"]
    lines += [parser.format_usage().strip(), "```", ""]
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if a.help != argparse.SUPPRESS]
        for action in actions:
            lines += argument(parser, action)
    if parser.epilog:
        lines += ["", "```text", parser.epilog.strip(), "```", ""]
    for _, child in children(parser):
        lines += section(child, level + 1)
    return lines


def argument(parser: argparse.ArgumentParser, action: argparse.Action) -> list[str]:
    """An entry of a definition list; verbs of its own have sections instead."""
    if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
        return []
    name = parser._get_formatter()._format_action_invocation(action)
    text = parser._get_formatter()._expand_help(action) if action.help else ""
    return [f"`{name}`", f": {escaped(text) or 'see below'}", ""]


def escaped(text: str) -> str:
    """Signs that MyST would take for something else; what stands in backquotes is left."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(p if p.startswith("`") else re.sub(r"([\\*_<>\[\]$|#~])", r"\\\1", p) for p in parts)
