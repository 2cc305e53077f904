"""Grids of one compensation type, asked for by keywords."""

from volid.compensation.grids.builder import build_grids
from volid.compensation.grids.request import GridRequest
from volid.compensation.tables.sampling import Sampling


def effect_grids(solution, kind, base, sampling=None, **options):
    """Grids of one type; `options`: the other fields of `GridRequest`."""
    return build_grids(solution, GridRequest(kind, base, Sampling() if sampling is None else sampling, **options))
