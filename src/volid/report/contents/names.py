"""Names of groups of readings, of readings and of kinds of sets in the words of a language, made from what they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.groups import groupings, in_english
from volid.observations import KINDS
from volid.report.language import Texts, table


def group_facts(campaign: Campaign) -> Mapping[str, tuple[Any, ...]]:
    """What every group of a campaign stands for, by its name in English."""
    return {in_english(g.facts): g.facts for s in campaign.sets for g in groupings(campaign, s, s)}


def group_words(facts: tuple[Any, ...], texts: Texts) -> str:
    """The name of a group of readings.

    Args:
        facts: What it stands for, as `volid.fitting.diagnosis.groups.Grouping` has it.
        texts: The language.

    >>> group_words(("range", "Z", -166.7, -83.3, "mm"), Texts("de"))
    'Z −166,7 … −83,3 mm'
    >>> group_words(("region", ("Y", True), ("X", False)), Texts("de"))
    'Bereich Y oben, X unten'
    """
    key, *values = facts
    if key == "label":
        return label_words(values[0], values[1], texts)
    if key == "region":
        halves = ", ".join(f"{a} {texts('names.high' if high else 'names.low')}" for a, high in values)
        return texts("names.region", halves=halves)
    if key == "approach":
        return texts("names.approach", axis=values[0], sign="+" if values[1] > 0 else "−")
    if key == "range":
        name, low, high, unit = values
        name = texts("names.time") if name == "time" else name
        return f"{name} {_number(low, texts)} … {_number(high, texts)} {unit}"
    if key == "tool":
        between = "; " if texts.language == "de" else ", "
        return texts("names.tool", vector=between.join(_number(v, texts) for v in values))
    return texts(f"names.{key}", name=reading_name(values[0], texts) if key == "direction" else values[0])


def label_words(label: str, value: str, texts: Texts) -> str:
    """A label of a reading with its value: "Standort S1"."""
    return f"{texts(f'names.label_{label}')} {value}"


def reading_name(name: str, texts: Texts) -> str:
    """The name of a column of readings: "Azimut"; coordinates are named alike in all languages."""
    key = f"names.reading_{name}"
    return texts(key) if key in table() else name


def reading_words(observations: ObservationSet, i: int, k: int, texts: Texts) -> str:
    """What reading `k` of row `i` belongs to, as `volid.fitting.diagnosis.adequacy.reading_label` says it in English."""
    kind = KINDS[observations.kind]
    words = [label_words(label, observations.labels[label][i], texts) for label in kind.named_by]
    return ", ".join([*words, *(reading_name(n, texts) for n in (kind.readings[k : k + 1] if kind.units else ()))])


def kind_words(kind: str, texts: Texts) -> str:
    """A kind of sets in words.

    >>> kind_words("distance", Texts("de"))
    'Abstand'
    """
    return texts(f"names.kind_{KINDS[kind].file_kind or kind}")


def part_words(campaign: Campaign, texts: Texts) -> list[str]:
    """The kind of every part of every set, in the order of the rows of a summary."""
    found = []
    for s in campaign.sets:
        for part in KINDS[s.kind].parts(s):
            between, joint = (", ", ", ") if KINDS[s.kind].units else (" ", "")
            names = joint.join(reading_name(n, texts) for n in part.readings)
            found.append(kind_words(s.kind, texts) + (between + names if names else ""))
    return found


def _number(value: float, texts: Texts) -> str:
    found = f"{value:g}".replace("-", "\u2212")
    return found.replace(".", ",") if texts.language == "de" else found
