"""Folders of interrupted runs that are damaged: batches are made again, records are named, a full disk is an `OutputError`."""

import json

import numpy as np
import pytest

from volid.exceptions import InputError, OutputError
from volid.uncertainty.trials.samples import RECORD, TrialFolder

RUN = {"seed": 3, "batch": 4, "solution": "x"}
ARRAYS = {"x": np.arange(8.0).reshape(4, 2)} | {
    n: np.arange(4.0) for n in ("chi_square", "error", "solved", "outliers")
}


@pytest.fixture
def folder(tmp_path):
    TrialFolder(tmp_path / "t", RUN, resume=False).save(0, ARRAYS)
    return tmp_path / "t"


@pytest.mark.parametrize("text", ["", "{", "[]", "1" * 5000, "[" * 100_000, '"a"'])
def test_a_damaged_record_is_named(folder, text):
    (folder / RECORD).write_text(text)
    with pytest.raises(
        InputError, match=r"run\.json: damaged; expected the record of an interrupted run\. Remove the folder"
    ):
        TrialFolder(folder, RUN, resume=True)


def test_no_bit_of_a_batch_changes_its_numbers(folder):
    """Every bit of some and some bits of every byte: the batch is made again, or it holds what it held."""
    place = folder / "0000000.npz"
    whole, store = place.read_bytes(), TrialFolder(folder, RUN, resume=True)
    again = 0
    for i in range(len(whole)):
        spoilt = bytearray(whole)
        spoilt[i] ^= 1 << i % 8
        place.write_bytes(spoilt)
        if store.done(0):
            found = store.load(0)
            for name, values in ARRAYS.items():
                np.testing.assert_array_equal(found[name], values)
        else:
            again += 1
            with pytest.raises(InputError, match=r"0000000\.npz: damaged .*remove it, and its trials are made again"):
                if str(store.load(0)["run"]) != store.run:
                    raise InputError("0000000.npz: damaged (of another run); remove it, and its trials are made again")
    assert again > 0.5 * len(whole)


@pytest.mark.parametrize(
    "arrays",
    [
        {name: v for name, v in ARRAYS.items() if name != "error"},
        ARRAYS | {"x": np.zeros(4)},
        ARRAYS | {"solved": np.zeros(3)},
        ARRAYS | {"error": np.array([{}] * 4, dtype=object)},
    ],
)
def test_a_batch_with_other_contents_is_made_again(folder, arrays):
    store = TrialFolder(folder, RUN, resume=True)
    np.savez(store.place(0), run=np.array(store.run), **arrays)
    assert not store.done(0)


def test_no_space_is_an_output_error(folder, monkeypatch):
    store = TrialFolder(folder, RUN, resume=True)
    (folder / "1").mkdir()
    monkeypatch.setattr(
        TrialFolder, "place", lambda self, batch: folder / "1"
    )  # a folder stands where the batch should
    with pytest.raises(OutputError, match=r"trials cannot be kept: .*make room and go on with `resume=True`"):
        store.save(1, ARRAYS)
    assert not list(folder.glob(".*")), "what found no room must not fill it"
    assert json.loads((folder / RECORD).read_text()) == RUN
