"""Section "verdict" of the page: the result on one screen, the verdict and what to do first, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from markupsafe import Markup

from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, NOT_TESTABLE, QUESTIONED, REJECTED
from volid.model.iso230 import LINEAR_AXES, ROTATIONS
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.numbers import Numbers, places_of
from volid.report.page.section import Section
from volid.report.page.templates import render, said, sentence
from volid.report.symbols import angle_words, in_words, plain_symbol
from volid.standards.results import FAIL, PASS, UNDECIDED

GOOD, ATTENTION, BAD = "good", "attention", "bad"  # classes of the style, each with a sign of its own
IN_A_CARD = 4  # squareness or location errors that stand in one column
_KEYS = {
    ACCEPTED: "accepted",
    ENLARGED: "enlarged",
    REJECTED: "rejected",
    NOT_TESTABLE: "untestable",
    QUESTIONED: "asked",
}


class Headline(NamedTuple):
    """The verdict: `tone` is GOOD, ATTENTION or BAD; `key`: of its texts, "verdict.KEY" and "verdict.KEY_do"."""

    tone: str
    key: str


def headline_of(summary: Mapping[str, Any]) -> Headline:
    """The verdict that stands above everything, from the numbers of `summary_data`.

    >>> headline_of({"grade": "accepted", "barrier": None, "converged": True, "not_determined": [], "unseen": []})
    Headline(tone='good', key='accepted')
    """
    key = _KEYS[summary["grade"]]
    if summary["barrier"]:
        return Headline(BAD, f"{key}_barrier")
    if summary["grade"] == REJECTED or not summary["converged"]:
        return Headline(BAD, key if summary["grade"] == REJECTED else "not_converged")
    if summary["grade"] == ACCEPTED and not summary["not_determined"] and not summary["unseen"]:
        return Headline(GOOD, key)
    return Headline(ATTENTION, "partly" if summary["grade"] == ACCEPTED else key)


def build(contents: Contents, texts: Texts) -> Section | None:
    """Verdict, what to do, squareness, largest deviation, volumetric accuracy, what compensation leaves, conformity."""
    summary = contents.summary
    body = render(
        "verdict.html",
        texts,
        headline=headline_of(summary),
        points=list(_points(contents, texts)),
        summary=summary,
        constants=_constants(summary, texts),
        accuracy=_accuracy(contents),
        contents=contents,
        largest=contents.evaluation["largest_deviation"] if not contents.barrier else None,
        after=_after(contents),
        after_places=_after_places(contents),
        conformity=_conformity(contents),
    )
    return Section("verdict", texts("page.section_verdict"), body)


def _points(contents: Contents, texts: Texts) -> Iterator[Markup]:
    """What else has to be known before a number is used, each in a sentence."""
    summary, numbers = contents.summary, Numbers(texts)
    if summary["barrier"]:
        yield Markup("{} {}").format(texts("verdict.reason"), sentence(summary["barrier"]))
    elif summary["grade"] == REJECTED:
        yield Markup("{} {}").format(texts("verdict.reason"), sentence(summary["verdict"]))
    if summary["grade"] == ENLARGED and summary["factor"] > 1.0:
        yield Markup(texts("verdict.factor")).format(factor=numbers.general(summary["factor"], "factor"))
    for question in summary["questions"] if not summary["barrier"] else ():
        yield Markup("{} {}").format(texts("verdict.question"), sentence(question["text"]))
    for cause in summary["causes"][:1]:
        yield Markup("{} {}").format(texts("verdict.cause"), sentence(cause["what"]))
        yield Markup("{} {}").format(texts("verdict.cure"), sentence(cause["cure"]))
    if not summary["barrier"]:
        yield from _open_points(summary, texts)


def _open_points(summary: Mapping[str, Any], texts: Texts) -> Iterator[Markup]:
    """What is not determined or not seen; details stand in a section of their own."""
    if summary["not_determined"]:
        text = texts("verdict.not_determined", count=len(summary["not_determined"]))
        yield Markup('{} <a href="#not_determined">{}</a>').format(text, texts("verdict.see_not_determined"))
    if summary["unseen"] and not (summary["rejected"] and summary["causes"]):
        text = texts("verdict.unseen", count=len(summary["unseen"]))
        yield Markup('{} <a href="#not_determined">{}</a>').format(text, texts("verdict.see_not_determined"))
    if summary["active_compensations"]:
        active = "; ".join(summary["active_compensations"])
        yield Markup("{} {}").format(texts("verdict.active"), said(active))


def _constants(summary: Mapping[str, Any], texts: Texts) -> list[list[dict[str, Any]]]:
    """Squareness errors, else location errors in the machine frame, with their words and keys; many of them in two groups."""
    chosen = "squareness" if summary["squareness"] else "location_errors"
    found = []
    for entry in summary[chosen]:
        name = plain_symbol(entry["name"])
        if chosen == "location_errors" and name != entry["name"]:
            continue
        words = angle_words(name, entry["value"], entry["U"], texts) if chosen == "squareness" else ""
        found.append({**entry, "words": words or in_words(name, texts), "key": f"{chosen}.{entry['name']}"})
    half = -(-len(found) // 2) if len(found) > IN_A_CARD else len(found)
    return [group for group in (found[:half], found[half:]) if group]


def _accuracy(contents: Contents) -> list[dict[str, Any]]:
    """Volumetric accuracy by direction: along it, and about it."""
    by_symbol = {q.symbol: q for q in contents.evaluation.quantities}
    pairs = zip(LINEAR_AXES, ROTATIONS, strict=True)
    rows = [
        {"letter": along, "both": [(f"V_{c}", by_symbol.get(f"V_{c}")) for c in (along, about)]}
        for along, about in pairs
    ]
    return rows if by_symbol else []


def _after(contents: Contents) -> dict[str, Any] | None:
    """What is expected to remain after grids over the whole volume; None where nothing is predicted, or nothing holds."""
    if contents.barrier or headline_of(contents.summary).tone == BAD:
        return None
    return contents.summary["volume"]["after"]


def _after_places(contents: Contents) -> int:
    """Decimal places of what remains, in µm, that its interval leaves."""
    after = _after(contents)
    low, high = after["max_interval_95"] if after else (0.0, 0.0)
    return places_of(0.5 * (high - low))


def _conformity(contents: Contents) -> dict[str, Any] | None:
    """How many quantities pass, fail, and are undecided, and the names of those that do not pass."""
    if not contents.judged:
        return None
    found = {v: [q for q in contents.evaluation.quantities if q.verdict == v] for v in (PASS, FAIL, UNDECIDED)}
    tone = BAD if found[FAIL] else ATTENTION if found[UNDECIDED] else GOOD
    return {"tone": tone, **found}
