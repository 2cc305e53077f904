"""Every number of the page is the library's: read back from the HTML, found again by its key, and rounded as it should be."""

import math
import re

import numpy as np
import pytest
from support.page_numbers import FACTOR, Page, places, plain

import volid
from volid.compensation.residual.accuracy import motion_ranges, volume_sizes
from volid.report.contents.contents import gather
from volid.report.contents.outlook import DRAWS
from volid.report.language import ENGLISH, Texts
from volid.report.page.numbers import Numbers, places_of
from volid.report.page.page import page
from volid.report.text.summary import summary_data

OWN = (
    "verdict",
    "campaign",
    "compensation",
    "limits",
    "not_determined",
    "provenance",
)  # sections whose keys are known here
LIMITS = {"largest_deviation": 0.05, "EC0Y": 25e-6, "E[XYZ]?": 0.01, "E[ABC][XYZ]": 2e-5, "V_X": 1e-3}


@pytest.fixture(scope="module")
def contents(solution):
    return gather(solution, limits=LIMITS)


@pytest.fixture(scope="module", params=["en", "de"])
def found(contents, request):
    return Page(page(contents, Texts(request.param)))


class Library:
    """The numbers of a solution by their keys, from the library's own doors and not from what the page was made of."""

    def __init__(self, solution):
        self.solution, self.tool = solution, solution.most_used_tool()
        self.summary = summary_data(solution, self.tool, DRAWS)
        types = [[t] for t in ("L-POS", "L-STR", "L-SQU", "L-ANG", "L-VOL")]
        base = volid.compensation_base(solution, self.tool)
        self.columns = volid.forecast(solution, types, base, most_draws=DRAWS).columns
        self.rows = solution.functions(points=101)
        self.sizes, self.ranges = volume_sizes(solution, self.tool), motion_ranges(solution)
        self.volume_found = volid.volumetric_summary(solution, self.tool)

    def __call__(self, key):
        root, *path = key.split(".")
        own = {"evaluation": self.evaluation, "outlook": self.outlook, "tools": self.tools, "axes": self.axis}
        return own[root](*path) if root in own else self.of_summary(root, *path)

    def of_summary(self, *path):
        value = self.summary
        for step in path:
            if isinstance(value, list) and not step.isdigit():
                (value,) = [row for row in value if row["name"] == step]
            else:
                value = value[int(step)] if isinstance(value, list) else value[step]
        return value

    def evaluation(self, symbol, part):
        if part == "limit":
            forms = {"V_X": 1e-3, "largest_deviation": 0.05, "EC0Y": 25e-6}
            return forms.get(symbol, 0.01 if symbol[1] in "XYZ" else 2e-5)
        if symbol == "largest_deviation" or symbol.startswith("V_"):
            return self.volume(symbol, part)
        if "0" in symbol:
            row = self.solution.location(symbol)
            return row.value if part == "value" else 2.0 * row.u
        assert part in ("value", "U")
        values = [row.value for row in self.rows if row.name == symbol]
        return np.ptp(values) if part == "value" else self.ranges[symbol][1]

    def volume(self, symbol, part):
        if symbol == "largest_deviation":
            return self.sizes.largest.U[0] if part == "U" else self.volume_found.before_max
        i = "XYZABC".index(symbol[2])
        return self.sizes.accuracy.U[i] if part == "U" else self.volume_found.accuracy[i]

    def outlook(self, name, part, end=None):
        (column,) = [c for c in self.columns if c.name == name]
        p, at = (
            column.predictions[0],
            {"largest": 0, "interval": 0, "most": 1, "rms": 2, "tilt": 9, "tilt_interval": 9}[part],
        )
        return {None: p.value, "0": p.low, "1": p.high}[end][at]

    def tools(self, which, component=None):
        vectors = self.solution.campaign.tool_vectors()
        if component is not None:
            return vectors[int(which)][int(component)]
        lengths = np.linalg.norm(vectors, axis=1)
        return lengths.min() if which == "shortest" else lengths.max()

    def axis(self, letter, what, end):
        (row,) = [a for a in self.summary["axes"] if a["axis"] == letter]
        return row[what][int(end)]


@pytest.fixture(scope="module")
def library(solution):
    return Library(solution)


def test_every_number_of_the_page_is_the_librarys(found, library):
    own = [n for n in found.numbers if n.section in OWN]
    assert len(own) > 150
    wrong = [(n.key, n.value, library(n.key)) for n in own if not math.isclose(n.value, library(n.key), rel_tol=1e-12)]
    assert not wrong


def test_what_people_read_is_the_exact_number_rounded(found):
    """The text is the exact value in µm or µrad, or in the unit as it is, to within half of its last digit."""
    assert found.numbers
    for n in found.numbers:
        shown, ways = float(plain(n.text)), (1.0, FACTOR.get(n.unit, 1.0))
        half = 0.5 * 10.0 ** -places(n.text)
        near = [
            abs(shown - f * n.value) <= half * (1 + 1e-9) or abs(shown - f * n.value) <= 6e-3 * abs(shown) for f in ways
        ]
        assert any(near), n


def test_no_measured_number_stands_outside_its_element(found):
    """A number with µm or µrad is the library's, and so has its exact value beside it; 1 µrad = 1 µm/m is no measured one."""
    loose = [t for s, t in found.texts if s in OWN and re.search(r"\d\s*(µm|µrad)", t) and "1 µrad = 1 µm/m" not in t]
    assert not loose


def test_verdicts_are_those_of_the_evaluation(contents, solution):
    """E[XYZ]? = 10 µm: what exceeds it by more than U fails, by the rule of ISO 14253-1, computed here again."""
    for q in contents.evaluation.quantities:
        if q.limit is None:
            assert q.verdict == ""
        elif abs(q.value) <= q.limit - q.U:
            assert q.verdict == "pass"
        else:
            assert q.verdict == ("fail" if abs(q.value) > q.limit + q.U else "undecided")
    assert {q.verdict for q in contents.evaluation.quantities if q.limit is not None} >= {"pass", "fail"}


@pytest.mark.parametrize(
    ("U", "unit", "places_expected"),
    [
        (0.00123, "mm", 1),
        (0.0123, "mm", 0),
        (0.000096, "mm", 3),
        (0.0000996, "mm", 2),
        (25e-6, "rad", 0),
        (0.4e-6, "rad", 2),
    ],
)
def test_u_has_two_significant_digits(U, unit, places_expected):
    """GUM 7.2.6; 0.0996 µm rounds to 0.10 µm, which has two digits at two places."""
    assert places_of(U, unit) == places_expected


def test_what_is_not_determined_has_no_digits():
    numbers = Numbers(ENGLISH)
    for value in (None, math.nan, math.inf):
        for text in (numbers.number(value), numbers.with_u(value, 1e-3), numbers.place(value), numbers.general(value)):
            assert text.striptags() == "n.d." and "<data" not in text
    assert "n.d." in numbers.interval((1.0, None))
    assert numbers.with_u(12.3456e-3, None).striptags() == "12.3 µm"


def test_german_numbers_have_a_decimal_comma_and_the_same_value():
    text = Numbers(Texts("de")).with_u(-12.3456e-3, 0.0021, "mm", "k")
    assert text.striptags() == "−12,3 ± 2,1 µm"
    assert 'value="-0.0123456"' in text and 'data-key="k.U"' in text
    assert Numbers(Texts("de")).vector((0.0, -1.5, 2.0)).striptags() == "(0; −1,5; 2) mm"
