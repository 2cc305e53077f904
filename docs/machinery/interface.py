"""The reference of the Python interface: `volid.__all__` in the sections of `volid/__init__.py`, and `volid.plot`."""

import inspect
import re
from pathlib import Path

from machinery.writing import write


def write_interface(root: Path, target: Path) -> None:
    """One page for each section, one for the figures, and `index.md`."""
    names = []
    for title, members in sections(root).items():
        page = re.sub(r"\W+", "_", title).strip("_")
        names.append(page)
        write(target / f"{page}.md", "\n".join([f"# {title[0].upper()}{title[1:]}", "", *documented("volid", members)]))
    write(
        target / "figures.md", "\n".join(["# Figures", "", *module("volid.plot"), *documented("volid.plot", plots())])
    )
    head = [
        "# Python",
        "",
        "```python",
        "import volid",
        "```",
        "",
        "In the order of the work; all of it is imported late.",
        "",
    ]
    write(target / "index.md", "\n".join([*head, "```{toctree}", *names, "figures", "```", ""]))


def sections(root: Path) -> dict[str, list[str]]:
    """Public names by the comments above them in `volid/__init__.py`."""
    source = (root / "src" / "volid" / "__init__.py").read_text(encoding="utf-8")
    table = source.partition("_PUBLIC = {")[2].partition("\n}")[0]
    found: dict[str, list[str]] = {}
    for comment, name in re.findall(r"^    (?:# (.*)|\"(\w+)\":.*)$", table, re.M):
        if comment:
            found[comment] = members = []
        elif name != "plot":
            members.append(name)
    return {title: members for title, members in found.items() if members}


def plots() -> list[str]:
    """Names of `volid.plot`."""
    import volid

    return list(volid.plot.__all__)


def module(name: str) -> list[str]:
    """The docstring of a module, without its members."""
    return ["```{eval-rst}", f".. automodule:: {name}", "   :no-members:", "```", ""]


def documented(where: str, names: list[str]) -> list[str]:
    """A directive of autodoc for every name."""
    import volid

    place = volid if where == "volid" else volid.plot
    lines: list[str] = []
    for name in names:
        thing = getattr(place, name)
        if isinstance(thing, dict):  # of descriptions, by name
            lines += [f"## {name}", "", *TABLES[name](thing), ""]
            continue
        kind = "autoclass" if inspect.isclass(thing) else "autofunction"
        lines += [f"## {name}", "", "```{eval-rst}", f".. {kind}:: {where}.{name}"]
        lines += ["   :members:"] if kind == "autoclass" and not issubclass(thing, Exception) else []
        lines += ["```", ""]
    return lines


def types_table(types: dict) -> list[str]:
    """`volid.COMPENSATION_TYPES`: what each type corrects, and what it leaves."""
    rows = [f"| `{t.name}` | {', '.join(t.effects)} | {t.based_on} | {t.leaves} |" for t in types.values()]
    return [
        "By name, a `CompensationType` each:",
        "",
        "| type | corrects | holds at | leaves |",
        "|---|---|---|---|",
        *rows,
    ]


def controls_table(controls: dict) -> list[str]:
    """`volid.CONTROLS`: what each control carries, and how."""
    rows = []
    for name, control in controls.items():
        d = control.declaration
        limit = "" if d.most_points is None else str(d.most_points)
        cells = [f"`{name}`", d.title, ", ".join(d.carries), d.sign, d.reversal, d.outside, limit]
        rows.append(f"| {' | '.join(cells)} |")
    return [
        "By name, a `Controller` each; `volid export --cnc NAME --explain` says all of it:",
        "",
        "| control | | carries | values | reversal | outside | positions at most |",
        "|---|---|---|---|---|---|---|",
        *rows,
    ]


TABLES = {"COMPENSATION_TYPES": types_table, "CONTROLS": controls_table}  # how a dictionary of descriptions is shown
