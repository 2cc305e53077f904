"""A fit stops where no number moves any more, also where parameters are known only together."""

import numpy as np
import pytest
from support.places import MODELS

import volid
from volid.planning import step_diagonals


@pytest.mark.parametrize("seed", [2, 5])
def test_step_diagonals_whose_weak_combinations_move_by_rounding_converge(seed):
    machine = volid.load_machine(MODELS / "wYXbZt_vertical.toml")
    campaign, _ = volid.simulate(step_diagonals(machine), seed=seed)
    solution = volid.fit(campaign)
    assert solution.statistics.converged and solution.statistics.iterations < 20
    again = volid.fit(campaign)
    np.testing.assert_array_equal(np.asarray(again.parameters), np.asarray(solution.parameters))
