"""The page: sections in their order, within the template."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from markupsafe import Markup

from volid.backend.steps import Step
from volid.exceptions import shown
from volid.fitting.solution import Solution
from volid.io.basics.targets import find_target
from volid.io.functions_csv import text_output
from volid.report.contents.contents import Contents, gather
from volid.report.language import Texts
from volid.report.page.packing import library
from volid.report.page.section import Section
from volid.report.page.sections import ORDER
from volid.report.page.templates import asset, environment
from volid.report.plot import palette

_COLOURS = {
    name.lower(): value for name, value in vars(palette).items() if name.isupper() and str(value).startswith("#")
}
SCRIPTS = ("scene.js", "field.js", "stations.js", "page.js")
STYLES = ("page.css", "scene.css")
DRAWN = ("field", "stations")  # sections whose data are drawn in 3-D
# sections that a mistake does not falsify
BEHIND_BARRIER = ("verdict", "machine", "campaign", "stations", "residuals", "provenance")
_PLAIN = re.compile(r"[^0-9A-Za-z ]")


def save_report(
    solution: Solution,
    path: str | Path,
    *,
    tool: Any = None,
    limits: str | Path | Mapping[str, Any] | None = None,
    lang: str = "en",
    title: str = "",
    overwrite: bool = False,
) -> Contents:
    """Write the report of a solution as one HTML file that needs no other, and give back what it says.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        path: The file to write; it appears completely or not at all.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the most used one of the campaign.
        limits: Largest sizes allowed by symbol [mm, rad], a TOML file or a mapping of its form, such as
            `{"largest_deviation": 0.05, "EC0Y": 15e-6, "E?0?": 20e-6}`; `volid report --help` lists the symbols.
        lang: Language of the page, "en" or "de".
        title: Title of the page; "" for one made from the name of the machine.
        overwrite: Whether an existing file may be replaced.

    Returns:
        The contents of the page: `contents.evaluation["largest_deviation"]` has value, U, limit and verdict.

    Raises:
        InputError: a tool vector that looks like another unit than mm, limits that name no quantity, no such language.
        OutputError: the file exists, or cannot be written.

    Source: ISO/TR 16907 9.1 (record), ISO 230-1 (volumetric accuracy), ISO 14253-1 (decision rule).

    >>> import tempfile, volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     contents = volid.save_report(solution, f"{folder}/report.html", limits={"EXX": 0.02})
    >>> contents.evaluation["EXX"].verdict  # published: E = 31.8 µm
    'fail'
    """
    texts = Texts(lang)
    find_target(path, overwrite)  # refused now, not after the work
    contents = gather(solution, tool, limits=limits, title=title)
    text = page(contents, texts)
    with text_output(path, overwrite) as stream:
        stream.write(text)
    return contents


def page(contents: Contents, texts: Texts, progress: Callable[[str], None] = lambda message: None) -> str:
    """The report as HTML: one text that needs no other file.

    Args:
        contents: As `gather` gives them.
        texts: The language of the page.
        progress: Function that is called with messages about the progress.
    """
    names = [name for name in ORDER if name in BEHIND_BARRIER or not contents.barrier]
    sections = []
    for k, name in enumerate(names, start=1):
        progress(Step.number(k, len(names), "drawing, section"))
        if (section := _section(name, contents, texts)) is not None:
            sections.append(section)
    machine, made = contents.solution.machine, contents.summary["provenance"]
    title = shown(contents.title or texts("page.title", machine=machine.name))
    return str(
        environment()
        .get_template("page.html")
        .render(
            texts=texts,
            contents=contents,
            title=title,
            structure=machine.structure.strip().strip("[]"),
            date=made.get("date", "")[:10],
            version=contents.made.get("volid", ""),
            sections=sections,
            style=_style(title),
            script=Markup("\n".join(asset(name) for name in SCRIPTS)),
            library=Markup(library() if any(s.id in DRAWN and s.data is not None for s in sections) else ""),
            data=_as_script({s.id: s.data for s in sections if s.data is not None}),
        )
    )


def _section(name: str, contents: Contents, texts: Texts) -> Section | None:
    found = import_module(f"volid.report.page.sections.{name}").build(contents, texts)
    if found is None:
        return None
    body = found.body.replace("<table", Markup('<div class="scroll"><table')).replace(
        "</table>", Markup("</table></div>")
    )
    return Section(found.id, found.title, Markup(body), found.data)


def _style(title: str) -> Markup:
    """The style sheet, with the colours of the palette and the footer of printed pages as variables."""
    footer = _PLAIN.sub(lambda match: f"\\{ord(match.group()):x} ", title)
    values = {**_COLOURS, "white": "white", "footer": f'"{footer}"'}
    variables = "".join(f"--{name}:{value};" for name, value in values.items())
    styles = "\n".join(asset(name) for name in STYLES)
    return Markup(f":root{{{variables}}}\n{styles}")


def _as_script(data: Any) -> Markup:
    """JSON within a script element, whatever its texts contain."""
    return Markup(json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
