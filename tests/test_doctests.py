"""The examples in the docstrings run, with paths relative to the repository root; every module of volid is looked at."""

import dataclasses
import doctest
import inspect
import pkgutil
import re
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


def documented():
    """Public classes and functions by name. Constants, whose docstring is that of their type, need no example."""
    found = {name: getattr(volid, name) for name in volid.__all__}
    found |= {f"plot.{name}": getattr(volid.plot, name) for name in volid.plot.__all__}
    return {name: thing for name, thing in found.items() if inspect.isclass(thing) or inspect.isfunction(thing)}


def arguments(thing):
    """Names of the parameters of a function or of a class's constructor; an exception takes a message alone."""
    if inspect.isclass(thing) and issubclass(thing, Exception):
        return []
    return list(inspect.signature(thing).parameters)


def section(text, title):
    """The indented lines below a title of a docstring, such as `Args:`; empty when the docstring does not have it."""
    found = re.search(rf"^{title}:\n((?:    .*\n?|\n)*)", inspect.cleandoc(text), re.MULTILINE)
    return found.group(1) if found else ""


def listed(text):
    """The arguments that a docstring describes; several may share an entry."""
    entries = re.findall(r"^    ((?:\w+, )*\w+): ", section(text, "Args"), re.MULTILINE)
    return {name for entry in entries for name in entry.split(", ")}


def raised(thing):
    """Source of what a caller runs first: the function, or what constructs the class."""
    if not inspect.isclass(thing):
        return inspect.getsource(thing)
    start = vars(thing).get("__post_init__" if dataclasses.is_dataclass(thing) else "__init__")
    return inspect.getsource(start) if start else ""


def test_examples_are_found():
    things = documented()
    assert {name for name in volid.__all__ if name not in things} == {"COMPENSATION_TYPES", "CONTROLS", "plot"}
    examples_of = doctest.DocTestParser().get_examples
    assert [name for name, thing in things.items() if not examples_of(thing.__doc__)] == []


def test_every_argument_is_described():
    missing = {name: set(arguments(thing)) - listed(thing.__doc__) for name, thing in documented().items()}
    assert {name: lacking for name, lacking in missing.items() if lacking} == {}


def test_input_errors_are_described():
    """Those that the function itself raises, or its docstring speaks of, stand in a section of their own."""
    things = {n: t for n, t in documented().items() if not (inspect.isclass(t) and issubclass(t, Exception))}
    raising = {name for name, thing in things.items() if "raise InputError" in raised(thing)}
    described = {name for name, thing in things.items() if "InputError: " in section(thing.__doc__, "Raises")}
    assert {"fit", "simulate"} <= described
    assert raising - described == set()
    assert [name for name, thing in things.items() if re.search(r"\bRaises `", thing.__doc__)] == []
