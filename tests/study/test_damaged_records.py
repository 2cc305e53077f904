"""Campaigns kept by an interrupted study whose files are damaged are done again; no changed number is taken."""

import json

import pytest
from support.places import MODELS

import volid
from volid.io.study_results import CampaignFolder
from volid.study.campaigns import COLUMNS, Design, Study

STUDY = Study({"m": volid.load_machine(MODELS / "wYXbZt_vertical.toml")}, (Design("standard"),), seeds=(1,))
(TASK,) = STUDY.tasks
RECORD = {n: {str: "ä", int: 7, float: 0.25, bool: True}[kind] for n, (kind, _) in COLUMNS.items()}
RECORD |= {"error": "", "differences": {"field": [1.0, 2]}, "u_of": {"field": [0.5, float("nan")]}}


@pytest.fixture
def folder(tmp_path):
    store = CampaignFolder(tmp_path / "results.campaigns", STUDY, resume=False)
    store.save(TASK, RECORD)
    return store


def test_what_was_kept_comes_back(folder):
    assert repr(folder.done()) == repr({TASK: RECORD})


def test_one_of_an_earlier_version_without_checksum_comes_back(folder):
    folder.place(TASK).write_text(json.dumps(RECORD))
    assert repr(folder.done()) == repr({TASK: RECORD})


def test_no_bit_changes_a_number(folder):
    whole = folder.place(TASK).read_bytes()
    for i in range(0, 8 * len(whole), 11):
        spoilt = bytearray(whole)
        spoilt[i // 8] ^= 1 << i % 8
        folder.place(TASK).write_bytes(spoilt)
        assert repr(folder.done()) in ("{}", repr({TASK: RECORD}))


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", "[" * 100_000, "1" * 5000, json.dumps({**RECORD, "rms": "0.25"}),
        json.dumps({**RECORD, "rejected": 1}), json.dumps({k: v for k, v in RECORD.items() if k != "error"}),
        json.dumps({**RECORD, "more": 1}), json.dumps({**RECORD, "sha256": "0"}), json.dumps({**RECORD, "error": None}),
        json.dumps({**RECORD, "u_of": {"field": [0.5]}}), json.dumps({**RECORD, "differences": {"field": ["a", 1.0]}}),
        json.dumps({**RECORD, "u_of": None, "differences": None}),
    ],
)  # fmt: skip
def test_a_damaged_one_is_done_again(folder, text):
    folder.place(TASK).write_text(text)
    assert folder.done() == {}
