"""Numbers for the script of the page come back as they were, and the library is the one that was installed."""

import base64
import gzip
import json
from importlib.resources import files

import numpy as np
import pytest
from support.compensated import machine_and_solution

from volid.report.contents.deviation_field import deviation_fields
from volid.report.language import ENGLISH
from volid.report.page.packing import library, packed
from volid.report.page.page import _as_script
from volid.report.page.sections.field import _data
from volid.report.page.sections.stations import _plain
from volid.report.plot.field import scale_of


def unpacked(text):
    counts = np.frombuffer(base64.b64decode(text["data"]), "<i2").astype(float)
    counts[counts == -32768] = np.nan
    return counts * text["scale"]


@pytest.mark.parametrize("size", [0.0, 1e-7, 3.3, 5e4])
def test_numbers_come_back_to_a_65000th_of_the_largest(size):
    values = size * np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3))
    values[2, 1] = np.nan
    back = unpacked(packed(values)).reshape(5, 3)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
    assert np.nanmax(np.abs(back - values)) <= size / 65_000 + 1e-300


def test_the_library_unpacks_to_the_installed_one():
    installed = (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    assert gzip.decompress(base64.b64decode(library())) == installed
    assert "<" not in library()  # nothing ends the element that holds it


def test_the_data_of_the_field_are_the_field():
    solution = machine_and_solution("tilting table", seed=4)[1]
    found = deviation_fields(solution, (0.0, 0.0, -150.0), [["R-VOL"]], most=3)
    data = json.loads(str(_as_script(_data(found, scale_of(found), ENGLISH))))
    k, p, s = data["counts"]
    assert (k, p, s) == found.values.shape[:3]
    for number, text in enumerate(data["fields"]):
        field = 1e3 * found.values.reshape(-1, *found.values.shape[3:])[number]
        np.testing.assert_allclose(unpacked(text).reshape(field.shape), field, atol=np.abs(field).max() / 65_000)
    maps = np.array(data["motions"]).reshape(-1, 3, 4)
    np.testing.assert_allclose(maps, 1e3 * found.motions.reshape(-1, 3, 4), rtol=1e-6)
    u = 2e3 * found.u.reshape(k * p, -1)
    np.testing.assert_allclose([unpacked(t) for t in data["u"]], u, atol=u.max() / 65_000)


def test_names_bring_no_tags_into_a_drawing():
    assert "<" not in _plain("<a href='javascript:1'>S1</a>")
