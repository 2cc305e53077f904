"""The tool vector that outputs refer to: of the rows that see the tool, as the kind of each set states it."""

from __future__ import annotations

import numpy as np
from support.places import MODELS

import volid
from volid.observations import KINDS
from volid.observations.used_tool import most_used_tool

SHORT, LONG = (0.0, 0.0, -100.0), (10.0, 0.0, -200.0)


def rows(kind: str, tool: tuple[float, float, float], m: int) -> volid.ObservationSet:
    k = len(KINDS[kind].readings)
    still = np.zeros((m, 3))
    return volid.ObservationSet(kind, kind, still, still, np.tile(tool, (m, 1)), np.zeros((m, k)), np.ones((m, k)))


def campaign(*sets: volid.ObservationSet) -> volid.Campaign:
    return volid.Campaign(volid.load_machine(MODELS / "wYXbZt_vertical.toml"), sets=sets)


def test_the_tool_of_most_rows_counts():
    assert most_used_tool(campaign(rows("distance", SHORT, 2), rows("point", LONG, 5))) == LONG


def test_a_kind_that_sees_another_body_by_itself_does_not_count(monkeypatch):
    monkeypatch.setattr(type(KINDS["point"]), "target_body", lambda self, options: "bed", raising=False)
    assert most_used_tool(campaign(rows("distance", SHORT, 2), rows("point", LONG, 5))) == SHORT
    assert most_used_tool(campaign(rows("point", LONG, 5))) == LONG, "no set sees the tool"
