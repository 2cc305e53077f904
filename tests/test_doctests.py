"""The examples in the docstrings run, with paths relative to the repository root; every module of volid is looked at."""

import doctest
import pkgutil
from functools import cache
from importlib import import_module

import pytest
from support.places import ROOT

import volid
from volid.fitting.fit import fit

EXTRAS = ("matplotlib", "distributed")  # what a plain installation lacks
SLOW = ("volid.fitting.streamed", "volid.uncertainty.trials.monte_carlo")  # JAX compiles their programs
MODULES = [m.name for m in pkgutil.walk_packages(volid.__path__, "volid.") if not m.name.endswith("__main__")]


def examples(name):
    """The docstrings of a module that have examples."""
    try:
        module = import_module(name)
    except ModuleNotFoundError as missing:
        if missing.name in EXTRAS:
            pytest.skip(f"needs {missing.name}")
        raise
    return [test for test in doctest.DocTestFinder(exclude_empty=True).find(module) if test.examples]


@cache
def fitted(path):
    """The fit to a campaign of the repository, made once for the examples of all modules."""
    return fit(volid.load_campaign(path))


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n in SLOW else ()) for n in ("volid", *MODULES)]
)
def test_examples_run(name, monkeypatch, request):
    monkeypatch.chdir(ROOT)

    def fit_once(given, **options):
        return fitted(given.source) if not options and (ROOT / given.source).is_file() else fit(given, **options)

    monkeypatch.setattr(volid, "fit", fit_once)
    for test in examples(name):
        test.globs["getfixture"] = request.getfixturevalue  # as in doctests that pytest collects
        runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
        found = []
        runner.run(test, out=found.append)
        assert not runner.failures, "".join(found)


def test_examples_are_found():
    assert sum(len(examples(name)) for name in ("volid.campaign", "volid.fitting.fit", "volid.fitting.solution")) >= 5
