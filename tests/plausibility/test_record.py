"""The record of ISO/TR 16907 9.1: items found by their keys, from tables and several files, and what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from volid.campaign import Environment
from volid.plausibility.record import FURTHER, ITEMS, record


def stated(solution, conditions, **changes):
    found = record(replace(solution.campaign, conditions=conditions, **changes))
    return {item.name: item for item in found}


def test_nothing_stated_is_missing_but_what_every_reading_states(solution):
    items = stated(solution, {})
    assert [name for name, item in items.items() if not item.is_missing] == ["positions", "tool_length", "tool_offset"]
    assert set(items) == {*ITEMS, *FURTHER}


@pytest.mark.parametrize(
    ("key", "item", "value", "text"),
    [
        ("warm_up", "warm_up", "30 min", "30 min"),
        ("machine_condition", "warm_up", "cold", "cold"),
        ("ambient_temperature_C", "ambient_temperature", 20.1, "20.1 °C"),
        ("acceleration_m_s2", "acceleration", 3.0, "3 m/s²"),
        ("tool_length_mm", "tool_length", [150.0, 200.0], "150, 200 mm"),
        ("tool_offset_mm", "tool_offset", [[0.0, 0.0], [80.0, 0.0]], "(0, 0), (80, 0) mm"),
        ("active_compensations", "active_compensations", [], ""),
        ("active_compensations", "active_compensations", ["L-POS", "thermal"], "L-POS; thermal"),
        ("component_temperatures_C", "component_temperatures", {"bed": 20.0, "table": 21.5}, "bed 20, table 21.5 °C"),
        ("operator", "operator", "N. N.", "N. N."),
    ],
)
def test_an_item_is_found_by_its_key_and_has_its_unit(solution, key, item, value, text):
    found = stated(solution, {key: value})[item]
    assert found.stated == ((key, text),) and not found.is_missing


def test_other_keys_stay_as_they_are(solution):
    items = stated(solution, {"synthetic": True, "shift": "night", "loading": 3})
    assert items[""].stated == (("synthetic", "yes"), ("shift", "night"))
    assert items["load"].stated == (("loading", "3"),)


def test_records_of_single_files_keep_their_names(solution):
    items = stated(solution, {"a.toml": {"load": "none", "warm_up": "1 h"}, "b.toml": {"load": "200 kg"}})
    assert items["load"].stated == (("a.toml: load", "none"), ("b.toml: load", "200 kg"))
    assert items["warm_up"].stated == (("a.toml: warm_up", "1 h"),)


def test_logs_and_columns_count_as_measured(solution):
    air = {"air_temperature_C": 20.0, "pressure_hPa": 1000.0, "humidity_percent": 40.0, "material_1_C": 20.3}
    room = Environment("room", {k: np.array([v]) for k, v in air.items()}, corrected=False)
    items = stated(solution, {}, environments=(room,))
    assert items["ambient_temperature"].measured == (("log", "room"),)
    assert items["component_temperatures"].measured == (("log", "room: material_1_C"),)
    assert not items["ambient_temperature"].is_missing
