"""Correlations: those of the covariance, in blocks that cover every parameter once; none of what is not determined."""

import numpy as np
import pytest

from volid.report.contents.correlations import correlations_of


def test_matrix_is_the_correlation_of_the_covariance(solution):
    found = correlations_of(solution)
    kept = np.diagonal(solution.covariance) > 0.0
    u = np.sqrt(np.diagonal(solution.covariance)[kept])
    expected = solution.covariance[np.ix_(kept, kept)] / np.outer(u, u)
    assert found.matrix[np.ix_(kept, kept)] == pytest.approx(expected, abs=1e-9)
    assert np.nanmax(np.abs(found.matrix)) <= 1.0 + 1e-9


@pytest.mark.parametrize("name", ["solution", "rich_solution", "rotary_solution"])
def test_blocks_cover_every_parameter_once_and_are_named_after_their_function(name, request):
    solution = request.getfixturevalue(name)
    found = correlations_of(solution)
    covered = [i for block in found.blocks for i in range(block.parameters.start, block.parameters.stop)]
    assert covered == list(range(len(solution.covariance)))
    for function in solution.model.functions:
        (block,) = [b for b in found.blocks if b.parameters == function.parameters]
        assert function.name in block.name.split(" ")[0].split("+")
    assert len(found.labels) == len(solution.covariance)


def test_strong_pairs_are_the_largest_of_their_blocks(solution):
    found = correlations_of(solution)
    pairs = found.strong(limit=0.5)
    assert pairs
    assert [abs(p.correlation) for p in pairs] == sorted((abs(p.correlation) for p in pairs), reverse=True)
    for pair in pairs:
        i, j = (found.labels.index(label) for label in pair.parameters)
        a, b = (next(x for x in found.blocks if x.name == name).parameters for name in pair.blocks)
        assert pair.correlation == found.matrix[i, j]
        assert abs(pair.correlation) == np.nanmax(np.abs(found.matrix[a, b]))
        assert a != b


def test_what_is_not_determined_has_no_correlation(single_tool_solution):
    found, n = correlations_of(single_tool_solution), single_tool_solution.model.n_parameters
    null = single_tool_solution.null_space
    part = np.abs(null).max(axis=1) > 1e-3 * np.abs(null).max()
    assert part.any()
    assert np.isnan(found.matrix[:n][part]).all()
    named = {label for pair in found.strong(0.1) for label in pair.parameters}
    assert not named & {found.labels[i] for i in np.flatnonzero(part)}
