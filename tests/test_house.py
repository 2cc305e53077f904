"""The house stays one that a newcomer finds the way in: few doors, few floors, short functions, names that lead somewhere.

A function's length is its lines of code, from `def` to its end: decorators, docstring, comments and blank lines do not count, the
lines of functions within it do. Its branches are what a reader has to follow: each `if` (statement or expression), each loop,
each `for` of a comprehension, and each `and` and `or`; those of functions within it count.
"""

import ast
import importlib
import io
import re
import statistics
import tokenize
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest
from support.places import ROOT, SOURCE

from volid.effects import TYPES
from volid.io.instruments import FORMATS
from volid.observations import KINDS

PACKAGE = SOURCE / "volid"
FILES = sorted(PACKAGE.rglob("*.py"))
PAGES = sorted(
    p for f in ("*.md", "models/*.md", "datasets/*.md", "datasets/*/*.md", "benchmarks/*.md") for p in ROOT.glob(f)
)
ENTRIES, LAYERS = 24, 14  # at most, at the top of the package and in the import contract
SHORT, SHARE, LONGEST, PARAMETERS, BRANCHES = 20, 0.9, 45, 7, 16
# Functions that may take more parameters, and why
MANY_PARAMETERS = {
    "compensation/package.py:compensate": "public: its keywords become one `CompensationRequest` at once",
    "compensation/residual/forecast.py:forecast": "public: its keywords become a request, the control options and the fields",
    "controllers/export.py:export": "public: its keywords become one `Job` at once",
    "fitting/equations/optimistix_solver.py:postprocess": "optimistix calls it, with these arguments",
    "fitting/fit.py:fit": "public: each keyword goes to one stage of the fit",
    "io/evaluations/evaluate.py:circular": "public: its keywords become one `Stated` at once",
    "multilateration/adjustment.py:adjust_network": "public: each keyword goes to one step of the adjustment",
    "planning/ball_bar.py:cone_frustum": "public: its arguments become one `_Test` at once",
    "planning/circles.py:circles": "public: its arguments become one `_Test` at once",
    "uncertainty/trials/monte_carlo.py:monte_carlo": "public: keywords go to the run and to what carries it out",
}


class Function(NamedTuple):
    """A function or method of the package: where it stands, its lines of code, its parameters without self, its branches."""

    place: str
    lines: int
    parameters: int
    branches: int


def place(file: Path) -> str:
    return str(file.relative_to(PACKAGE))


def documented(tree: ast.AST) -> list[ast.AST]:
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    return [n for n in ast.walk(tree) if isinstance(n, kinds) and ast.get_docstring(n) is not None]


class Source(NamedTuple):
    """A file of the package: where it stands, its tree, its lines of code by their number."""

    place: str
    tree: ast.Module
    code: dict[int, str]


@cache
def sources() -> list[Source]:
    found = []
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        tree, lines = ast.parse(text), text.splitlines()
        found.append(Source(place(file), tree, {i: lines[i - 1] for i in sorted(lines_of_code(text, tree))}))
    return found


def lines_of_code(text: str, tree: ast.AST) -> set[int]:
    """Numbers of the lines that hold code: not blank, not only a comment, no docstring."""
    nothing = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    found: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in nothing:
            found.update(range(token.start[0], token.end[0] + 1))
    for node in documented(tree):
        found.difference_update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return found


def branches(tree: ast.AST) -> int:
    kinds = ast.If | ast.IfExp | ast.For | ast.AsyncFor | ast.While | ast.comprehension
    nodes = list(ast.walk(tree))
    return sum(isinstance(n, kinds) for n in nodes) + sum(len(n.values) - 1 for n in nodes if isinstance(n, ast.BoolOp))


@cache
def functions() -> list[Function]:
    found = []
    for source in sources():
        for node in ast.walk(source.tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                length = sum(i in source.code for i in range(node.lineno, node.end_lineno + 1))
                count = len(names) - (names[:1] in (["self"], ["cls"]))
                found.append(Function(f"{source.place}:{node.name}", length, count, branches(node)))
    return found


def lines_with(pattern: str, but: tuple[str, ...] = ()) -> list[str]:
    """Places of the package where a line of code matches, but for the rooms named."""
    rooms = [source for source in sources() if source.place.split("/")[0] not in but]
    return [f"{s.place}:{i}: {line.strip()}" for s in rooms for i, line in s.code.items() if re.search(pattern, line)]


def contracts() -> list[dict]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]


def test_few_entries_at_the_top():
    entries = sorted(p.name for p in PACKAGE.iterdir() if p.name != "__pycache__")
    assert len(entries) <= ENTRIES, entries


def test_few_layers_and_every_room_in_one():
    (layers,) = [c["layers"] for c in contracts() if c["type"] == "layers"]
    assert len(layers) <= LAYERS
    named = {room.strip() for layer in layers for room in layer.split("|")}
    rooms = {Path(source.place).parts[0].removesuffix(".py") for source in sources()} - {"__init__", "__main__"}
    assert named == rooms
    assert not [c["name"] for c in contracts() if c.get("ignore_imports")]


@pytest.mark.parametrize(("room", "table"), [("observations", KINDS), ("effects", TYPES), ("io.instruments", FORMATS)])
def test_every_kind_stands_in_the_contract_of_independence(room, table):
    """One file per kind; none may import another, and only what the contract lists is checked for that."""
    files = {type(entry).__module__ for entry in table.values()}
    own = [set(c["modules"]) for c in contracts() if c["type"] == "independence"]
    (listed,) = [modules for modules in own if any(m.startswith(f"volid.{room}.") for m in modules)]
    assert listed == files, f"pyproject.toml, independence of {room}: add {files - listed}, remove {listed - files}"


def module_of(file: str) -> str:
    return ".".join(("volid", *Path(file).with_suffix("").parts)).removesuffix(".__init__")


def imports(tree: ast.AST, modules: set[str]) -> set[str]:
    """Which of `modules` a module imports, anywhere in it; of `from a import b` a.b where that is one of them, else a.

    What stands under `if TYPE_CHECKING` is for type checkers alone and never imported.
    """
    named = [n for n in ast.walk(tree) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    for_types = {node for block in named for statement in block.body for node in ast.walk(statement)}
    found = set()
    for node in set(ast.walk(tree)) - for_types:
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports name their module in full"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            found.update(name if name in modules else node.module for name in inner)
    return found & modules


def test_modules_do_not_import_each_other_in_a_circle():
    """Imports within functions count: they hide a circle, they do not open it."""
    own = {module_of(source.place): source.tree for source in sources()}
    graph = {module: imports(tree, own.keys()) for module, tree in own.items()}
    # `import volid` is the public door: methods of a solution, and the controls that are volid's own files, call public
    # functions, each imported when it is first used
    through_the_door = {"volid.controllers.neutral.own_files", "volid.fitting.solution"}
    assert {module for module, below in graph.items() if "volid" in below} == through_the_door
    for module in through_the_door:
        graph[module].remove("volid")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_modules_are_read_in_one_sitting():
    lengths = [len(f.read_text(encoding="utf-8").splitlines()) for f in FILES if f.name != "__init__.py"]
    assert 90 <= statistics.median(lengths) <= 200, statistics.median(lengths)


def test_functions_are_short():
    short = [f.lines < SHORT for f in functions()]
    assert sum(short) >= SHARE * len(short), f"{sum(short)} of {len(short)}"
    assert [f for f in functions() if f.lines > LONGEST] == []


def test_branches_are_counted():
    text = "def f(x):\n    for y in x:\n        if y and x or y:\n            return [a for b in x for a in b if a]\n"
    assert branches(ast.parse(text)) == 1 + 1 + 2 + 2


def test_functions_have_few_branches():
    assert {f.place for f in functions() if f.branches >= BRANCHES} == set()


def test_functions_take_few_parameters():
    many = {f.place for f in functions() if f.parameters > PARAMETERS}
    assert many - MANY_PARAMETERS.keys() == set()
    assert MANY_PARAMETERS.keys() - many == set(), "no exception that is none"
    assert not [p for p in MANY_PARAMETERS if p.split(":")[1].startswith("_")], "public ones only"


def test_only_kinds_know_what_kind_they_are():
    """Who asks a set for its kind would have to be changed when one more comes."""
    asks = r"\bkind\s*[=!]=\s*[\"']|\.kind\s*([=!]=|(not )?in\b)"
    assert lines_with(asks, but=("observations",)) == []


def imported(tree: ast.AST) -> set[str]:
    """First names of the modules that a file imports."""
    plain = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    plain |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level}
    return {name.split(".")[0] for name in plain}


def test_modules_under_another_licence_stay_outside():
    """LinuxCNC's own modules are GPL: tests and examples run them as programs of their own."""
    assert imported(ast.parse("import hal.x\nfrom linuxcnc import stat")) == {"hal", "linuxcnc"}
    assert [s.place for s in sources() if imported(s.tree) & {"hal", "linuxcnc", "_hal", "emccanon", "gcode"}] == []


def asks_for_engines(tree: ast.AST) -> list[str]:
    """Calls that make an engine (`Compiled(…)`, `Interpreted(…)`), or ask whether something is of its class or its equations'."""
    calls = [ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    asks = r"((\w+\.)*(Compiled|Interpreted)\(|(isinstance|issubclass)\(.*\b(Compiled|Interpreted)(Equations)?\b)"
    return [call for call in calls if re.match(asks, call)]


def test_engines_are_chosen_in_one_place():
    found = {source.place: asks_for_engines(source.tree) for source in sources()}
    found = {place: calls for place, calls in found.items() if calls}
    assert found.keys() == {"fitting/equations/choice.py"}, found


def test_modules_of_tests_have_names_of_their_own():
    """pytest imports them by their bare names, and takes two of one name for a mistake."""
    names = [p.name for p in sorted(Path(__file__).parent.rglob("test_*.py"))]
    assert [n for n in sorted(set(names)) if names.count(n) > 1] == []


def test_tables_are_written_in_one_place():
    """Where no text becomes a cell that a spreadsheet runs."""
    assert {line.split(":")[0] for line in lines_with(r"csv\.(writer|DictWriter)\(")} == {"io/basics/cells.py"}


def test_figures_are_made_where_pyplot_does_not_keep_them():
    """It would hold every figure until somebody closes it."""
    assert lines_with(r"\bimport.*pyplot\b|\bplt\.") == []


def test_the_library_does_not_speak_of_options_of_the_command_line():
    assert lines_with(r"(?<![\w-])--(?!xla_)[a-z]", but=("cli",)) == []


# ------------------------------------------------------------------------------------------------ names lead somewhere


def resolves(name: str) -> bool:
    """Whether a dotted name is a module of the package or something in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ImportError:
            continue
        for part in parts[n:]:
            if not hasattr(found, part):
                return part in getattr(found, "__annotations__", {})
            found = getattr(found, part)
        return True
    return False


def texts() -> dict[str, str]:
    """Pages and docstrings by their place."""
    found = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in PAGES}
    for source in sources():
        found[f"src/volid/{source.place}"] = "\n".join(ast.get_docstring(node) for node in documented(source.tree))
    return found


def test_dotted_names_in_texts_lead_somewhere():
    named = {(where, n) for where, text in texts().items() for n in re.findall(r"\bvolid(?:\.[A-Za-z_]\w*)+", text)}
    files = {"volid.egg"}
    assert sorted((w, n) for w, n in named if n not in files and not resolves(n)) == []


def test_files_named_in_texts_are_there():
    """A path as from the root of the repository, the package, or the folder of the text or one in it."""
    missing = []
    for where, text in texts().items():
        for name in re.findall(r"`((?:[\w.]+/)*\w+\.py)`", text):
            folder = (ROOT / where).parent
            starts = (ROOT, PACKAGE, SOURCE, folder, *(p for p in folder.iterdir() if p.is_dir() and folder != ROOT))
            if not any((start / name).exists() for start in starts):
                missing.append((where, name))
    assert missing == []


@pytest.mark.parametrize("stage", ["ruff check", "mypy", "lint-imports"])
def test_quick_checks_come_before_the_tests(stage):
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert text.index(stage) < text.index("pytest")


def test_colours_are_named_in_the_palette_alone():
    """White is the paper. A grey as a number, a colour by name or in hexadecimal digits, and a map of colours are colours."""
    named = r"""["'](black|gr[ae]y|red|green|blue|orange|silver|dim\w*|light\w+|dark\w+|C\d|k|r|b|g)["']"""
    written = (
        rf"""\b(color|c|fc|ec|mfc|mec|facecolor|edgecolor|colors|cmap)\s*=\s*({named}|["']0?\.\d+["']|["']\w+_r["'])"""
    )
    python = [x for x in lines_with(written) if "palette.py" not in x]
    hexadecimal = re.compile(r"#[0-9A-Fa-f]{6}\b|#[0-9A-Fa-f]{3}\b|\brgba?\(")
    assets = [p for kind in ("css", "js", "html") for p in sorted((PACKAGE / "report").rglob(f"*.{kind}"))]
    drawn = [p for p in FILES if place(p).startswith("report/") and p.name != "palette.py"]
    found = [f"{place(p)}: {m}" for p in (*assets, *drawn) for m in hexadecimal.findall(p.read_text(encoding="utf-8"))]
    assert not python + found
