"""A sum must hold what was active while measuring: all of it, once, and with the contents that the record holds."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import ROOT

import volid
from volid.campaign import ActiveFiles
from volid.controllers.existing.measured_state import not_in_sum

X = b"0 0 0\n250 250.010 250.010\n500 500 500\n"  # 10 µm too far at mid-travel
Z = b"0 0 0\n100 100.020 100.020\n325 325 325\n"  # 20 µm at 100
NAMES = {"x.comp": X, "z.comp": Z}


@pytest.fixture(scope="module")
def solution():
    """EXX and EZZ, measured with one file for each."""
    campaign = volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml")
    files = tuple(ActiveFiles(f"L-POS: {n} for linuxcnc", "linuxcnc", {n: c}) for n, c in NAMES.items())
    record = {**campaign.conditions, "active_compensations": [f.text for f in files]}
    return volid.fit(replace(campaign, conditions=record, active_files=files))


def loaded(solution, folder, **contents):
    """Files `x` and `z` with these contents, as a user names them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        (folder / f"{name}.comp").write_bytes(content)
    return volid.load_compensation([folder / f"{n}.comp" for n in contents], "linuxcnc", solution.machine)


def moves(made, x, z):
    """What the files do to the machine in the state in which it was measured, X and Z [mm]."""
    machine = made.solution.machine
    q = machine.order(X=x, Y=100.0, Z=z)[None]
    step = (made.added_control().command(q, np.zeros(3)) - q)[0]
    return step[machine.index("X")], step[machine.index("Z")]


def test_a_file_that_was_active_and_is_not_in_the_sum_brings_its_errors_back(solution, tmp_path):
    """Without z.comp Z goes 20 µm further at 100 than while measuring, beside what the new values do."""
    whole = volid.export(solution, "linuxcnc", add_to=volid.recorded_compensations(solution.campaign))
    part = volid.export(solution, "linuxcnc", add_to=[loaded(solution, tmp_path, x=X)])
    none = volid.export(solution, "linuxcnc")
    assert not [n for n in whole.notes if "REPLACE" in n]
    assert [n for n in part.notes if n.startswith("z.comp of L-POS: z.comp") and "is not in the sum" in n]
    x, z = moves(whole, 250.0, 100.0)
    assert moves(part, 250.0, 100.0) == pytest.approx((x, z + 0.020), abs=1e-9)
    assert moves(none, 250.0, 100.0) == pytest.approx((x + 0.010, z + 0.020), abs=1e-9)


def test_both_files_in_one_read_are_all_that_was_active(solution, tmp_path):
    assert not_in_sum(solution.campaign, [loaded(solution, tmp_path, x=X, z=Z)]) == []


def test_a_file_with_another_content_than_while_measuring_is_named(solution, tmp_path):
    changed = loaded(solution, tmp_path, x=X.replace(b".010", b".030"), z=Z)
    (said,) = not_in_sum(solution.campaign, [changed])
    assert said.startswith("x.comp: by the record it held something else while the campaign was measured")
    assert moves(volid.export(solution, "linuxcnc", add_to=[changed]), 250.0, 100.0)[0] == pytest.approx(
        moves(volid.export(solution, "linuxcnc"), 250.0, 100.0)[0] - 0.030, abs=1e-9
    )


def test_a_file_is_not_added_twice(solution, tmp_path):
    recorded = volid.recorded_compensations(solution.campaign)
    with pytest.raises(volid.InputError, match=r"x\.comp would be added twice"):
        volid.export(solution, "linuxcnc", add_to=[loaded(solution, tmp_path, x=X), *recorded])
