"""Certificate data: structure by the schema's facts and by Schematron where it is installed; every number reads back exactly."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import UTC, date, datetime
from decimal import Decimal

import numpy as np
import pytest
from support.dcc_schema import ASKED, violations, violations_of

import volid
from volid.compensation.residual.accuracy import volume_sizes
from volid.exceptions import InputError, OutputError
from volid.fitting.diagnosis.adequacy import Question
from volid.report.certificate.administration import UNKNOWN_COUNTRY, Request, administrative_data
from volid.report.certificate.circumstances import add_conditions
from volid.report.certificate.facts import facts_of
from volid.report.certificate.statements import add_statements
from volid.report.text.summary import summary_data
from volid.standards.results import Evaluation, Quantity, judged
from volid.uncertainty.intervals import function_intervals

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
FACTS = {
    "country": "DE",
    "identifier": "K-2026-0417",
    "begin": "2026-03-11",
    "end": "2026-03-12",
    "place": "customer",
    "laboratory": {"name": "Messraum Süd & Partner", "street": "Am Maß", "number": "3", "post_code": "01234", "city": "Dresden",
                   "country": "DE", "email": "lab@example.org", "phone": "+49 1", "code": "D-K-00000"},
    "customer": {"name": "<Fräsen> \"GmbH\"", "city": "Chemnitz"},
    "machine": {"manufacturer": "Virtual", "model": "V 1000", "serial_number": "0815", "inventory_number": "M 7"},
    "person": [{"name": "A. Meyer", "role": "head of laboratory"}, {"name": "B. Lee"}],
    "instrument": [{"name": "tracer", "manufacturer": "x", "model": "T", "serial_number": "42", "certificate": "C 1"}],
}  # fmt: skip


NOTHING = Evaluation("ISO 230-1", "machine", ())


def saved(solution, folder, **keywords):
    volid.save_dcc(solution, folder / "result.xml", **keywords)
    return ET.parse(folder / "result.xml").getroot()


@pytest.fixture(scope="module")
def root(solution, tmp_path_factory):
    return saved(solution, tmp_path_factory.mktemp("dcc"), data=FACTS)


def administration(solution, data=FACTS, conformity=NOTHING, lang="en", source=""):
    """The part without the numbers, which takes no time: administrative data with statements, and conditions."""
    request = Request(solution, facts_of(solution.campaign, data), source, lang)
    root = ET.Element("root")
    add_statements(administrative_data(root, request), request, conformity)
    add_conditions(root, request)
    parts = [violations_of(root[0], "administrative"), violations_of(root[1], "conditions")]
    assert parts == [[], []]
    return root, request.missing()


def all_of(root, path):
    return root.findall(path, SPACES)


def text(element, path):
    found = element.find(path, SPACES)
    assert found is not None, path
    return found.text


def numbers(element, path, unit):
    """Numbers of a list of D-SI in mm, rad or degrees: the decimal point moved, so that nothing is rounded."""
    places = {"mm": 3, "rad": 0, "°": 0}[unit]
    return [float(Decimal(word).scaleb(places)) for word in text(element, path).split(" ")]


def lists(root):
    return {one.get("refType"): one for one in all_of(root, ".//dcc:results//dcc:list")}


def ref(row):
    return f"iso230_{row.name}" + {1: "_plus", -1: "_minus", 0: ""}[row.direction]


def check_functions(solution, root):
    """Every tabulated value, position and u stands in its list; those not determined are left out."""
    found, rows = lists(root), [r for r in solution.functions() if r.name[2] != "0"]
    assert set(found) == {ref(row) for row in rows}
    for name, one in found.items():
        known = [r for r in rows if ref(r) == name and np.isfinite(r.value)]
        quantities = all_of(one, "dcc:quantity")
        if len(known) <= 1:  # the reference alone, where every function is 0, determines nothing
            assert len(quantities) == 1 and quantities[0].find("dcc:noQuantity", SPACES) is not None
            continue
        axis = solution.machine.axis(known[0].axis)
        unit = "rad" if known[0].name[1] in "ABC" else "mm"
        position, value, u = quantities
        assert numbers(position, ".//si:valueXMLList", axis.unit) == pytest.approx(
            [r.position for r in known], abs=1e-9
        )
        assert numbers(value, ".//si:valueXMLList", unit) == [r.value + 0.0 for r in known]
        assert numbers(u, ".//si:valueXMLList", unit) == [r.u for r in known]
        assert text(value, ".//si:unitXMLList") == {"mm": "\\metre", "rad": "\\radian"}[unit]
        assert text(position, ".//si:unitXMLList") == {"mm": "\\metre", "°": "\\degree"}[axis.unit]
    return len(rows)


def test_structure_is_that_of_the_schema(root):
    assert violations(root) == []


def test_the_structural_test_sees_what_is_wrong(root):
    """Children exchanged, a child taken away, a text of a wrong form."""
    copy = ET.fromstring(ET.tostring(root))
    core = copy.find(".//dcc:coreData", SPACES)
    core.insert(0, core[3])
    copy.find(".//dcc:coreData/dcc:endPerformanceDate", SPACES).text = "12.3.2026"
    person = copy.find(".//dcc:respPerson", SPACES)
    person.remove(person[0])
    assert len(violations(copy)) == 3


@pytest.mark.parametrize("layout", ["single_tool_solution", "rich_solution", "rotary_solution"])
def test_every_function_reads_back_exactly(layout, request, tmp_path):
    solution = request.getfixturevalue(layout)
    root = saved(solution, tmp_path, data=FACTS)
    assert violations(root) == []
    assert check_functions(solution, root) > 100


def test_schematron_finds_no_error_but_a_country_that_nobody_stated(root):
    validation = pytest.importorskip("dcclib.validation.schematron")
    validator = validation.SchematronValidator.for_dcc()
    found = validator.validate_str(ET.tostring(root, encoding="unicode"))
    errors = [r for r in (*found.failed_assertions, *found.successful_reports) if "error" in str(r.role)]
    assert found.is_valid and not errors
    copy = ET.fromstring(ET.tostring(root))
    copy.find(".//dcc:countryCodeISO3166_1", SPACES).text = UNKNOWN_COUNTRY
    found = validator.validate_str(ET.tostring(copy, encoding="unicode"))
    assert len(found.failed_assertions) == 1 and not found.is_valid


def test_expanded_uncertainties_are_twice_u(root):
    for one in lists(root).values():
        u = text(all_of(one, "dcc:quantity")[2], ".//si:valueXMLList").split(" ")
        expanded = text(one, ".//si:valueExpandedMUXMLList").split(" ")
        assert [float(value) for value in expanded] == pytest.approx([2.0 * float(value) for value in u], rel=1e-15)
        assert text(one, ".//si:coverageFactorXMLList") == "2"


@pytest.mark.slow
def test_coverage_intervals_from_samples(rotary_solution, tmp_path):
    sampled = rotary_solution.monte_carlo(100, seed=1)
    volid.save_dcc(sampled, tmp_path / "sampled.xml", data=FACTS)
    root = ET.parse(tmp_path / "sampled.xml").getroot()
    assert violations(root) == []
    rows = [row for row in sampled.functions() if row.name == "EXC"]
    expected, one = function_intervals(sampled, rows), lists(root)["iso230_EXC"]
    # the same rows in another product of matrices: alike but for rounding
    assert numbers(one, ".//si:intervalMinXMLList", "mm") == pytest.approx(expected.low.tolist(), rel=1e-12)
    assert numbers(one, ".//si:intervalMaxXMLList", "mm") == pytest.approx(expected.high.tolist(), rel=1e-12)
    assert text(one, ".//si:coverageProbabilityXMLList") == "0.95"


def test_constants_and_volume_equal_the_summary(solution, root):
    summary = summary_data(solution)
    quantities = {q.get("refType").split()[-1]: q for q in all_of(root, ".//dcc:result/dcc:data/dcc:quantity")}
    for row in (*summary["squareness"], *summary["tool_frame"]):
        one = quantities[f"iso230_{row['name']}"]
        assert numbers(one, ".//si:value", row["unit"]) == [row["value"]]
        assert numbers(one, ".//si:valueExpandedMU", row["unit"]) == [row["U"]]
    sizes = volume_sizes(solution, solution.most_used_tool())
    for k, letter in enumerate("XYZABC"):
        one, unit = quantities[f"iso230_V_{letter}"], "mm" if k < 3 else "rad"
        assert numbers(one, ".//si:value", unit) == [sizes.accuracy.value[k]]
        assert numbers(one, ".//si:valueExpandedMU", unit) == [sizes.accuracy.U[k]]
    assert numbers(quantities["volid_largest"], ".//si:value", "mm") == [summary["volume"]["before"]["max"]]
    assert numbers(quantities["volid_toolVector"], ".//si:valueXMLList", "mm") == list(solution.most_used_tool())


def test_limits_are_judged(solution, tmp_path):
    root = saved(solution, tmp_path, data=FACTS, limits={"EC0Y": 1e-9, "EXX": 1.0e-1})
    found = {
        text(s, "dcc:name/dcc:content"): text(s, "dcc:conformity") for s in all_of(root, ".//dcc:statement[@refType]")
    }
    assert found == {"EC0Y": "fail", "EXX": "pass"} and violations(root) == []


def test_facts_stand_where_they_belong(root):
    core = root.find(".//dcc:coreData", SPACES)
    assert [
        text(core, f"dcc:{key}") for key in ("countryCodeISO3166_1", "uniqueIdentifier", "performanceLocation")
    ] == [
        "DE",
        "K-2026-0417",
        "customer",
    ]
    assert (
        text(core, "dcc:beginPerformanceDate") == "2026-03-11" and text(core, "dcc:endPerformanceDate") == "2026-03-12"
    )
    assert text(root, ".//dcc:calibrationLaboratory/dcc:contact/dcc:name/dcc:content") == "Messraum Süd & Partner"
    assert text(root, ".//dcc:customer/dcc:name/dcc:content") == '<Fräsen> "GmbH"'
    assert [e.text for e in all_of(root, ".//dcc:respPerson/dcc:person/dcc:name/dcc:content")] == ["A. Meyer", "B. Lee"]
    assert text(root, ".//dcc:measuringEquipment//dcc:value") == "42"
    assert "0815" in [e.text for e in all_of(root, ".//dcc:item/dcc:identifications//dcc:value")]


def test_nothing_is_invented_and_what_is_missing_is_named(solution):
    root, missing = administration(solution, data=None)
    assert missing == ASKED
    assert text(root, ".//dcc:countryCodeISO3166_1") == "ZZ"
    for path in ("calibrationLaboratory/dcc:contact", "customer", "respPersons/dcc:respPerson/dcc:person"):
        assert text(root, f".//dcc:{path}/dcc:name/dcc:content") == "not stated"
    declared = [e.text for e in all_of(root, ".//dcc:statement/dcc:declaration/dcc:content")]
    (named,) = [t for t in declared if t.startswith("Not stated: ")]
    assert "serial number of the machine" in named and "ZZ" in named and solution.provenance["date"][:10] in named


def test_a_solution_in_memory_has_the_day_of_today(solution):
    """A fit in Python has no record of a command; the schema demands dates all the same."""
    root, missing = administration(replace(solution, provenance={}), data=None)
    day = text(root, ".//dcc:endPerformanceDate")
    assert "end" in missing and abs((date.fromisoformat(day) - datetime.now(UTC).date()).days) <= 1


def test_it_says_that_it_is_no_certificate(single_tool_solution, root, tmp_path):
    saved(single_tool_solution, tmp_path)
    head = (tmp_path / "result.xml").read_text(encoding="utf-8")[:400]
    assert "UNSIGNED RESULT FILE" in head and "not a calibration certificate" in head
    first = root.find(".//dcc:statement", SPACES)
    assert [e.text for e in all_of(first, "dcc:name/dcc:content")] == [
        "Unsigned result file",
        "Nicht signierte Ergebnisdatei",
    ]
    assert not [e for e in root.iter() if "Signature" in e.tag or e.tag.endswith("mainSigner")]


def test_both_languages_stand_in_every_fixed_text(root):
    for element in root.iter():
        languages = [e.get("lang") for e in all_of(element, "dcc:content") if e.get("lang")]
        assert languages in ([], ["en", "de"])
        assert all(e.text.strip() for e in all_of(element, "dcc:content"))


def test_the_language_asked_for_is_the_mandatory_one(solution, tmp_path):
    root, _ = administration(solution, lang="de")
    assert text(root, ".//dcc:mandatoryLangCodeISO639_1") == "de"
    with pytest.raises(InputError, match="no texts in 'fr'"):
        volid.save_dcc(solution, tmp_path / "other.xml", lang="fr")


def test_conditions_of_the_record_as_numbers_and_words(solution):
    stated = {"ambient_temperature_C": 20.1, "component_temperatures_C": {"bed": 19.85}, "load": "none & nothing"}
    campaign = replace(solution.campaign, conditions=stated)
    root, _ = administration(replace(solution, campaign=campaign))
    conditions = all_of(root, ".//dcc:influenceCondition")
    values = [
        (r.find("si:value", SPACES).text, r.find("si:unit", SPACES).text)
        for c in conditions
        for r in all_of(c, ".//si:real")
    ]
    assert values == [
        ("293.25", "\\kelvin"), ("20.1", "\\degreecelsius"), ("293.00", "\\kelvin"), ("19.85", "\\degreecelsius"),
    ]  # fmt: skip
    words = [e.text for c in conditions for e in all_of(c, ".//dcc:text/dcc:content")]
    assert "load: none & nothing" in words
    assert sum("NOT RECORDED" in word for word in words) == 4  # warm-up, feed, acceleration, active compensations


def test_conformity_by_the_rule_of_the_limits(solution):
    values = {"a": 8.0, "b": 9.5, "c": 10.5, "d": 12.0}
    evaluation = Evaluation("ISO 230-1", "", tuple(Quantity(key, 1e-3 * v, "mm", U=1e-3) for key, v in values.items()))
    limits = dict.fromkeys(values, 0.010)
    root, _ = administration(solution, conformity=judged(evaluation, limits))
    found = [e.text for e in all_of(root, ".//dcc:conformity")]
    assert found == ["pass", "conditionalPass", "conditionalFail", "fail"]
    assert len(all_of(root, ".//dcc:statement[@refType='basic_conformity']")) == 4
    statement = all_of(root, ".//dcc:statement[@refType='basic_conformity']")[1]
    assert [numbers(q, ".//si:value", "mm") for q in all_of(statement, ".//dcc:quantity")] == [[0.0095], [0.010]]
    assert "guard band" in text(statement, "dcc:declaration/dcc:content") and text(statement, "dcc:norm").startswith(
        "ISO 14253-1"
    )


def test_no_conformity_of_what_is_not_determined(solution):
    evaluation = judged(Evaluation("ISO 230-1", "", (Quantity("a", np.nan, "mm", U=np.nan),)), {"a": 0.01})
    root, _ = administration(solution, conformity=evaluation)
    statement = root.find(".//dcc:statement[@refType='basic_conformity']", SPACES)
    assert statement.find("dcc:conformity", SPACES) is None
    assert "not determined" in text(statement, "dcc:declaration/dcc:content")
    assert [numbers(q, ".//si:value", "mm") for q in all_of(statement, ".//dcc:quantity")] == [[0.010]]


def test_the_hash_is_that_of_the_file(solution, solution_file):
    from hashlib import sha256

    data = {key: value for key, value in FACTS.items() if key != "identifier"}
    root, _ = administration(solution, data, source=str(solution_file))
    expected = sha256(solution_file.read_bytes()).hexdigest()
    assert expected in [e.text for e in all_of(root, ".//dcc:coreData//dcc:value")]
    assert text(root, ".//dcc:uniqueIdentifier") == f"volid-{expected[:32]}"


def test_foreign_texts_are_escaped(solution):
    evil = "</dcc:content><x> & \x07 \x1b[2J ]]> \ufffe"
    campaign = replace(solution.campaign, title=evil, conditions={"note": evil, "load": evil})
    root, _ = administration(replace(solution, campaign=campaign), {**FACTS, "customer": {"name": evil}})
    root = ET.fromstring(ET.tostring(root))
    assert text(root, ".//dcc:customer/dcc:name/dcc:content") == "</dcc:content><x> & \\x07 \\x1b[2J ]]> \\ufffe"


def test_facts_of_the_record_and_those_given_before_them(solution):
    recorded = {"country": "AT", "begin": "2026-01-01", "person": {"name": "C. Doe"}}
    stated = {"dcc": recorded, "date": "2026-02-02", "instrument": "tracer 7", "load": "none"}
    campaign = replace(solution.campaign, conditions=stated)
    found = facts_of(campaign, {"country": "CH"})
    assert (found.country, found.begin, found.person) == ("CH", "2026-01-01", ({"name": "C. Doe"},))
    assert found.instrument == ({"name": "tracer 7"},)
    assert facts_of(replace(solution.campaign, conditions={"date": "2026-02-02"})).begin == "2026-02-02"
    root, _ = administration(replace(solution, campaign=campaign), data=None)
    assert not [
        e for e in root.iter() if "C. Doe" in (e.text or "") and "country" in e.text
    ]  # no condition of the results
    with pytest.raises(InputError, match=r"\[conditions.dcc\] end is 'x'"):
        facts_of(replace(solution.campaign, conditions={"dcc": {"end": "x"}}))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"country": "Germany"}, "two capital letters"),
        ({"begin": "tomorrow"}, "expected a date such as 2026-03-12"),
        ({"begin": "2026-03-12", "end": "2026-03-11"}, "is before begin"),
        ({"place": "home"}, "expected one of laboratory"),
        ({"laboratory": "Lab"}, "expected a table"),
        ({"person": [{"role": "head"}]}, "has no name"),
        ({"laboratory": {"nam": "x"}}, "'nam' is not known"),
        ({"labor": 1}, "'labor' is not known"),
        ({"identifier": "  "}, "expected a text"),
    ],
)
def test_wrong_facts_are_named(solution, tmp_path, data, message):
    with pytest.raises(InputError, match=message):
        volid.save_dcc(solution, tmp_path / "result.xml", data=data)
    assert not list(tmp_path.iterdir())


def test_an_existing_file_is_kept(solution, tmp_path):
    (tmp_path / "result.xml").write_text("mine")
    with pytest.raises(OutputError, match="exists"):
        volid.save_dcc(solution, tmp_path / "result.xml")
    assert (tmp_path / "result.xml").read_text() == "mine"


def test_no_numbers_behind_the_barrier(solution, tmp_path):
    adequacy = replace(solution.adequacy, questions=(Question("the readings are negated", about_values=True),))
    with pytest.raises(InputError, match="the readings are negated"):
        volid.save_dcc(replace(solution, adequacy=adequacy), tmp_path / "result.xml")
