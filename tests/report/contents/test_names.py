"""Groups, readings and kinds are named in the language of the report, and in English exactly as everywhere else."""

import numpy as np
import pytest

import volid
from volid.fitting.diagnosis.adequacy import reading_label
from volid.fitting.diagnosis.groups import groupings, in_english
from volid.observations import KINDS
from volid.report.contents.contents import gather
from volid.report.contents.names import group_facts, group_words, part_words, reading_words
from volid.report.language import ENGLISH, Texts, table
from volid.report.page.sections.residuals import _groups

GERMAN = Texts("de")


@pytest.mark.parametrize(
    ("facts", "german"),
    [
        (("set", "A B"), "Messreihe 'A B'"),
        (("label", "station", "S1"), "Standort S1"),
        (("direction", "azimuth"), "Richtung Azimut"),
        (("tool", 0.0, 0.5, -150.0), "Werkzeugvektor (0; 0,5; −150) mm"),
        (("approach", "X", -1), "X in − angefahren"),
        (("range", "Z", -166.7, -83.3, "mm"), "Z −166,7 … −83,3 mm"),
        (("range", "time", 0.0, 60.5, "s"), "Zeit 0 … 60,5 s"),
        (("region", ("Y", True), ("X", False)), "Bereich Y oben, X unten"),
    ],
)
def test_groups_in_german(facts, german):
    assert group_words(facts, GERMAN) == german
    assert group_words(facts, ENGLISH).replace("−", "-") == in_english(facts)


def test_a_name_that_a_user_gave_is_not_translated():
    assert group_words(("label", "station", "time"), GERMAN) == "Standort time"


def test_every_tested_group_of_a_solution_has_a_name_in_german(solution):
    facts = group_facts(solution.campaign)
    assert {g.what for g in solution.adequacy.groups} <= set(facts)
    rows = _groups(gather(solution, expected=False), GERMAN)
    assert len(rows) == len(solution.adequacy.groups) and all(row["what"] for row in rows)
    assert not [
        row["what"] for row in rows if any(word in row["what"] for word in ("station", "region", "tool", "high"))
    ]


def test_kinds_and_labels_have_texts_in_both_languages():
    keys = table()
    for name, kind in KINDS.items():
        labels = {*kind.labels, *kind.tested_by, *kind.named_by}
        assert {f"names.label_{label}" for label in labels} <= set(keys)
        assert f"names.kind_{kind.file_kind or name}" in keys
        assert {f"names.reading_{n}" for n in kind.readings if len(n) > 1} <= set(keys)


def test_what_a_reading_belongs_to_and_kinds_are_in_english_what_the_summary_says():
    campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    assert part_words(campaign, ENGLISH) == [p.words for s in campaign.sets for p in KINDS[s.kind].parts(s)]
    assert part_words(campaign, GERMAN) == ["Komponente X", "Komponente Z"]
    s = campaign.sets[0]
    assert reading_words(s, 3, 0, ENGLISH) == reading_label(s, 3, 0)
    assert reading_words(s, 3, 0, GERMAN) == "Komponente X, Linie 1"


def test_names_of_groups_name_different_rows(solution):
    for s in solution.campaign.sets:
        found = list(groupings(solution.campaign, s, s))
        assert len({g.what for g in found}) == len({group_words(g.facts, GERMAN) for g in found})
        assert all(np.any(g.rows) for g in found if g.sort == "region")
