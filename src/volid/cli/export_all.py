"""All controls at once: each into a folder of its own, and one table of what was written, what was refused and why."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from volid.cli.common import attention, conclude, in_options, print_json, tell
from volid.cli.left_over import files_in, left_over

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from volid.controllers import Controller
    from volid.controllers.export import Export, ExportRequest
    from volid.fitting.solution import Solution

WRITTEN, REFUSED, ASKS, OPEN_DATA = "written", "refused", "asks for the sign", "not determined"


REASON = 110  # characters of a reason where no control can be written


class Outcome(NamedTuple):
    """What became of one control. `words`: the types written, or the reason."""

    name: str
    status: str
    words: str
    made: Export | None = None


def refuse_existing(args: argparse.Namespace) -> None:
    """Raises `OutputError` before the work begins."""
    from volid.exceptions import OutputError

    if Path(args.output).exists() and not args.force:
        raise OutputError(f"{args.output} exists; choose another name or pass --force")


def list_controls(args: argparse.Namespace) -> int:
    """The controls with types, sign and limits, and the known ones for which nothing can be written."""
    from volid.controllers import CONTROLS
    from volid.controllers.unsupported import UNSUPPORTED
    from volid.report.text.basics import table

    found = [c.declaration for c in CONTROLS.values()]
    if args.json:
        each = [{"name": d.name, "title": d.title, "carries": dict(d.carries), "sign": d.sign} for d in found]
        print_json({"controls": each, "unsupported": UNSUPPORTED})
        return 0
    rows = [[d.name, d.title, ", ".join(d.carries), d.sign] for d in found]
    print("\n".join(table(["control", "", "types, the most complete first", "sign"], rows, left=4)))
    print("\nnothing can be written for:")
    print("\n".join(f"  {name}: {why}" for name, why in UNSUPPORTED.items()))
    return 0


def export_all(
    solution: Solution,
    request: ExportRequest,
    notes: list[str],
    args: argparse.Namespace,
    progress: Callable[[str], None],
) -> int:
    """Every control into its own folder; the exit status."""
    from volid.controllers import CONTROLS
    from volid.exceptions import InputError, cut
    from volid.io.basics.atomic import atomic_folder

    _refuse_strange_options(request, list(CONTROLS))
    found, before = [], files_in(args.output)
    with atomic_folder(args.output, args.force) as folder:
        for chosen in CONTROLS.values():
            progress(f"making the files of {chosen.declaration.name}")
            found.append(_tried(solution, request, chosen, folder, args))
        if not any(o.status == WRITTEN for o in found):
            reasons = _grouped((o.name, cut(o.words, REASON)) for o in found)
            raise InputError(f"no control can be written; volid export --cnc NAME says all of it. {'. '.join(reasons)}")
    _print(found, args)
    tell(args, notes)
    written = [f"{o.name}/{name}" for o in found if o.made is not None for name in names_of(o.made)]
    return conclude(args, attention(solution, named=True) + left_over(args.output, before, written))


def names_of(made: Export) -> list[str]:
    """Names of all files of an export."""
    from volid.io.exports import RECORD, SHEET

    return [*(f.name for f in made.written.files), SHEET, RECORD]


def _grouped(found: Iterable[tuple[str, str]]) -> list[str]:
    """Each sentence once, with the controls that it holds for, from pairs of both."""
    names: dict[str, list[str]] = {}
    for name, words in found:
        names.setdefault(words, []).append(name)
    return [f"{', '.join(n)}: {words}" for words, n in names.items()]


def _refuse_strange_options(request: ExportRequest, names: list[str]) -> None:
    """Raises `InputError` for an option that no control takes, because it does not name one."""
    from volid.exceptions import InputError

    for key in request.options:
        if key.partition(".")[0] not in names or "." not in key:
            raise InputError(
                f"--option {key}: with all controls an option begins with the name of one, such as linuxcnc.comp_file_type=1"
            )


def _tried(
    solution: Solution, request: ExportRequest, chosen: Controller, folder: Path, args: argparse.Namespace
) -> Outcome:
    """One control, or why not."""
    from volid.controllers.base import OPEN
    from volid.controllers.export import export_of
    from volid.exceptions import InputError, NotDeterminedError
    from volid.io.exports import save_export

    d = chosen.declaration
    own = {k.partition(".")[2]: v for k, v in request.options.items() if k.partition(".")[0] == d.name}
    if d.sign == OPEN and request.sign is None:
        return Outcome(d.name, ASKS, "public sources do not say which sign its values have; state --sign")
    asked = replace(request, options=own, sign=request.sign if d.sign == OPEN else None)
    try:
        made = export_of(solution, chosen, asked)
    except NotDeterminedError as error:
        return Outcome(d.name, OPEN_DATA, in_options(str(error).removeprefix(f"{d.name}: "), args))
    except InputError as error:
        words = in_options(str(error).removeprefix(f"{d.name}: "), args)
        return Outcome(d.name, REFUSED, words.replace("state it, as in ", f"state it, as in --option {d.name}."))
    save_export(
        made,
        folder / d.name,
        source=args.solution,
        command=args.command_line,
        words=lambda text: in_options(text, args),
    )
    return Outcome(d.name, WRITTEN, ", ".join(made.types), made)


def _print(found: list[Outcome], args: argparse.Namespace) -> None:
    from volid.report.text.basics import table

    if args.json:
        print_json({"controls": [_in_json(o) for o in found]})
        return
    rows = [[o.name, o.status, o.words] for o in found if o.made is not None]
    print("\n".join(table(["control", "", "types"], rows, left=3)))
    missing = [(o.name, f"{o.status}: {o.words}") for o in found if o.made is None]
    if missing:
        print("\nnot written:", *_grouped(missing), sep="\n  ")
    noted = [(o.name, in_options(note, args)) for o in found if o.made is not None for note in o.made.notes]
    if noted:
        print("\nnotes (in the sheets too):", *_grouped(noted), sep="\n  ")
    print(f"\n{sum(o.made is not None for o in found)} of {len(found)} controls written: {args.output}")


def _in_json(outcome: Outcome) -> dict[str, Any]:
    plain = {"cnc": outcome.name, "status": outcome.status, "words": outcome.words}
    return plain if outcome.made is None else {**plain, **in_json(outcome.made)}


def in_json(made: Export) -> dict[str, Any]:
    """An export for machine reading."""
    from dataclasses import asdict

    from volid.controllers.handover.sheet import checks_of

    return {
        "cnc": made.declaration.name,
        "types": made.types,
        "sign": made.job.sign,
        "files": [{"name": f.name, "what": f.what} for f in made.written.files],
        "parameters": [dict(zip(("name", "value", "meaning"), p, strict=True)) for p in made.written.parameters],
        "rounding": made.written.rounding,
        "sign_checks": [asdict(c) for c in checks_of(made)],
        "helping_axes": [asdict(h) for h in made.helping],
        "notes": made.notes,
    }
