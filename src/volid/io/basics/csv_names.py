"""What is said where the columns of a CSV file are not those that were expected, or that `columns` and `ignore` name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from volid.exceptions import InputError
from volid.io.basics.csv_rows import NO_NAME, names_shown, shown
from volid.io.basics.toml_table import nearest


def check_names(
    source: str, present: Sequence[str], columns: Mapping[str, str], ignored: Sequence[str], where: str
) -> None:
    """Raises `InputError` for a name that is no column of `source`, a column of two names, or one that is also ignored."""
    for key, name in [*(("columns", c) for c in columns.values()), *(("ignore", c) for c in ignored)]:
        if name not in present:
            hint = nearest(name, present) or ";"
            raise InputError(
                f"{where}: {key} names '{shown(name)}', which is no column of {source}{hint} its columns: {names_shown(present)}"
            )
    for found in columns.values():
        names = [name for name, other in columns.items() if other == found]
        if len(names) > 1:
            raise InputError(
                f"{where}: columns gives '{shown(found)}' of {source} two names, {' and '.join(names)}; expected one column "
                "for each name"
            )
        if found in ignored:
            raise InputError(f"{where}: '{shown(found)}' stands under columns and under ignore; keep one of them")


def unknown_column(source: str, name: str, known: Sequence[str], present: Iterable[str]) -> InputError:
    """The `InputError` for a column that nothing knows, naming the nearest one that is known."""
    if name.startswith(NO_NAME):
        return InputError(
            f'{source}, header: {name} has no name; name it, or leave it out with ignore = ["{name}"] in the set'
        )
    hint = nearest(name, [k for k in known if k not in present])
    return InputError(
        f"{source}, header: unknown column '{shown(name)}'{hint or ';'} known columns: {', '.join(known)}; "
        "`columns` of the set renames others, `ignore` leaves them out"
    )


def missing_column(source: str, name: str, purpose: str, others: Sequence[str]) -> InputError:
    """The `InputError` for a column that is missing; one of the `others` may be its misspelling."""
    strangers = [c for c in others if nearest(c, [name])]
    hint = f"; found '{shown(strangers[0])}', which looks like it" if strangers else ""
    return InputError(f"{source}, header: column '{name}' is missing{hint}; {purpose}")
