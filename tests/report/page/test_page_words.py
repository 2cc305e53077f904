"""What the page says: the verdict of every kind of solution, what is missing, both languages, and nothing of others as markup."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.page_numbers import Page
from support.small_campaign import SOLUTIONS

import volid
from volid.exceptions import InputError, OutputError
from volid.fitting.diagnosis.adequacy import QUESTIONED, Question
from volid.report.contents.contents import gather
from volid.report.language import ENGLISH, Texts, table
from volid.report.page.page import page
from volid.report.page.sections.verdict import BAD, headline_of
from volid.report.symbols import constant_words

GERMAN = Texts("de")
EVIL = '<script>alert("x")</script>\'&$\\frac{1}{$ {0} %s\u202eevil\x07'
ALLOWED = {  # what reads the same in German: symbols, standards, names of types, units
    "1 µrad = 1 µm/m.", "95 %:", "Symbol", "RMS", "L-POS", "L-STR", "L-SQU", "L-ANG", "L-VOL", "L-VOL+", "FOR", "SHA-256",
}  # fmt: skip


@pytest.fixture(scope="module")
def contents(solution):
    return gather(solution, limits={"largest_deviation": 0.05})


@pytest.fixture(scope="module")
def german(contents):
    return Page(page(contents, GERMAN))


def test_the_verdict_stands_first_and_says_what_to_do(contents):
    html = page(contents, ENGLISH)
    body = html[html.index("<main>") :]
    assert body.index(ENGLISH("verdict.accepted")) < body.index(ENGLISH("verdict.accepted_do")) < body.index("<table")


def test_drawings_of_a_german_page_write_numbers_and_vectors_in_german(contents):
    html = page(contents, GERMAN)
    drawn = re.findall(r"<text[^>]*>([^<]*)</text>", html)
    assert len([text for text in drawn if re.search(r"\d,\d", text)]) > 20
    assert [text for text in drawn if re.search(r"\d\.\d", text)] == []
    assert re.findall(r"Werkzeugvektor \([^;)]*\)", html) == []


def test_a_location_error_against_another_axis_says_against_which():
    assert constant_words("EY0C", GERMAN) != constant_words("EY(0A)C", GERMAN)
    assert constant_words("EY(0A)C", GERMAN).endswith("gegenüber A")


def test_the_largest_deviation_of_a_part_of_the_machine_says_so(contents, rotary_solution):
    found = gather(rotary_solution)
    count = len(found.summary["volume"]["left_out"])
    assert count == 18  # the rotary table alone: all error motions of X, Y and Z
    for texts in (ENGLISH, GERMAN):
        html = page(found, texts)
        said = texts("verdict.largest_of_model", count=count).replace("'", "&#39;")
        assert html.index(texts("verdict.largest")) < html.index(said) < html.index(texts("verdict.accuracy"))
    assert "are left out, and the machine" not in page(contents, ENGLISH)


@pytest.mark.parametrize(
    ("name", "texts"),
    [
        pytest.param(n, (ENGLISH, GERMAN)[i % 2], marks=pytest.mark.slow if i > 2 else ())
        for i, n in enumerate(SOLUTIONS)
    ],
    ids=SOLUTIONS,
)
def test_every_solution_has_a_page(name, texts, request):
    found = gather(request.getfixturevalue(name))
    html = page(found, texts)
    parsed = Page(html)
    assert len(parsed.ids) == len(set(parsed.ids))
    assert texts("verdict." + headline_of(found.summary).key) in html
    assert {link for link in parsed.links if not link.startswith(("#", "data:"))} == set()
    assert all(link[1:] in parsed.ids for link in parsed.links if link.startswith("#"))
    if found.summary["rejected"]:
        assert headline_of(found.summary).tone == BAD


def test_behind_a_barrier_no_number_of_the_machine_is_shown(solution):
    question = Question("are all lengths in mm?", True)
    adequacy = replace(solution.adequacy, grade=QUESTIONED, questions=(question,), verdict=question.text)
    asked = gather(replace(solution, adequacy=adequacy), limits={"EXX": 0.01})
    html = page(asked, ENGLISH)
    assert asked.evaluation.quantities == () and asked.sizes is None and asked.outlook.forecast is None
    assert "Are all lengths in mm?" in html and ENGLISH("verdict.no_numbers") in html
    parsed = Page(html)
    assert not [n for n in parsed.numbers if n.key.startswith(("evaluation", "squareness", "outlook", "volume"))]
    assert "compensation" not in parsed.ids and "campaign" in parsed.ids


def test_missing_items_of_the_record_are_named_and_stated_ones_shown(solution):
    stated = {
        "warm_up": "30 min",
        "ambient_temperature_C": 20.5,
        "feed": "2 m/min",
        "active_compensations": [],
        "shift": "night",
    }
    campaign = replace(solution.campaign, conditions=stated)
    html = page(gather(replace(solution, campaign=campaign)), ENGLISH)
    texts = " ".join(t for s, t in Page(html).texts if s == "campaign")
    missing = texts[texts.index("Missing in the record") : texts.index("ISO/TR 16907, 9.1, asks")]
    for name in ("load", "acceleration", "component_temperatures", "operator", "date", "traceability"):
        assert ENGLISH(f"campaign.item_{name}") in missing
    for name in ("warm_up", "feed", "ambient_temperature", "active_compensations", "positions", "tool_offset"):
        assert not re.search(rf"{ENGLISH(f'campaign.item_{name}')}[;.]", missing.replace("\n", " "))
    assert "20.5 °C" in html and "<bdi>30 min</bdi>" in html and "<bdi>shift</bdi>" in html


def test_nothing_of_the_german_page_is_english(german):
    """Every text of the German page is one of the German table, a symbol, or marked as what the library says in English."""
    english = {words["en"] for words in table().values() if words["en"] not in ("", words["de"])} - ALLOWED
    said = {t for _, t in german.texts}
    assert not said & english
    common = re.compile(r"\b(the|of|and|is|are|with|not|this|readings|tool|value|deviation|axis)\b")
    assert not [t for t in said if common.search(t)]


def test_every_text_has_both_languages_and_the_same_values():
    for key, words in table().items():
        assert set(words) == {"en", "de"}, key
        values = [sorted(re.findall(r"{(\w*)", words[language])) for language in ("en", "de")]
        assert values[0] == values[1], key
        assert words["de"].strip(), key


def test_what_users_wrote_is_text_and_never_markup(solution, german):
    machine = replace(solution.machine, name=EVIL)
    campaign = replace(
        solution.campaign,
        title=EVIL,
        conditions={EVIL: EVIL, "operator": EVIL, "active_compensations": [EVIL]},
        sets=tuple(replace(s, name=f"{EVIL}{i}", source=EVIL) for i, s in enumerate(solution.campaign.sets)),
    )
    changed = replace(
        solution,
        campaign=campaign,
        model=replace(solution.model, machine=machine),
        provenance={**solution.provenance, "command": EVIL, f"sha256 {EVIL}": "00"},
        notes=(EVIL,),
    )
    found = gather(changed, source=EVIL)
    for title in ("", EVIL):
        html = page(replace(found, title=title), GERMAN)
        assert "alert(" in html and "<script>alert" not in html
        assert Page(html).tags.count("script") == german.tags.count("script") == 3  # data, the library, its use
        assert "\u202e" not in html and "\x07" not in html
        style = html[html.index("<style>") : html.index("</style>")]
        assert "<script" not in style and "alert(" not in style


def test_the_page_asks_for_no_other_file(contents):
    html = page(contents, ENGLISH)
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", html)
    assert not re.search(r"@import|url\((?!#|\"?data:)", html)


def test_saved_by_one_call(solution, tmp_path):
    path = tmp_path / "report.html"
    contents = volid.save_report(solution, path, limits={"largest_deviation": 1e-4}, lang="de", title="Abnahme")
    assert "<title>Abnahme</title>" in path.read_text(encoding="utf-8")
    assert contents.evaluation["largest_deviation"].verdict == "fail"
    with pytest.raises(OutputError, match="exists"):
        volid.save_report(solution, path)
    with pytest.raises(InputError, match="no texts in 'fr'"):
        volid.save_report(solution, tmp_path / "other.html", lang="fr")
    with pytest.raises(InputError, match="EQQ is no quantity of this test"):
        volid.save_report(solution, tmp_path / "other.html", limits={"EQQ": 0.01})


def test_numbers_hold_for_the_tool_vector_that_was_asked_for(solution):
    tool = (0.0, 0.0, -100.0)
    found = gather(solution, tool)
    assert found.tool == tool
    assert found.evaluation["largest_deviation"].value == pytest.approx(
        volid.volumetric_summary(solution, tool).before_max, rel=1e-12
    )
    assert np.allclose(found.outlook.forecast.tools, [tool])


def test_types_that_are_not_determined_do_not_take_the_others_with_them(single_tool_solution):
    """Squareness is open with a single tool vector; the grid for this tool vector is not."""
    found = gather(single_tool_solution)
    assert {c.name for c in found.outlook.forecast.columns} >= {"none", "L-POS", "L-VOL"}
    assert [name for name, _ in found.outlook.refused] == ["L-SQU"]


def test_a_tool_vector_that_is_not_determined_has_a_page(single_tool_solution):
    html = page(gather(single_tool_solution, tool=(100.0, 0.0, -150.0)), ENGLISH)
    assert ENGLISH("field.nothing") in html


@pytest.mark.parametrize("texts", [ENGLISH, GERMAN])
def test_functions_left_out_stand_with_the_readings_that_determine_them(rotary_solution, texts):
    html = page(gather(rotary_solution, expected=False), texts)
    named = re.search(r"<li>([^<:]*): " + re.escape(texts("not_determined.reading_straightness")), html)
    assert named and set(named[1].split(", ")) == {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
