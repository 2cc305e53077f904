"""Numbers on the page: rounded for people, and in full for programs, in one and the same element.

    <data value="1.2345e-05" data-unit="mm" data-key="squareness.EC0Y.value">12.3</data>

`value` is the library's number in mm, rad, degrees or without unit, to its last digit; the text is what people read: µm and µrad,
rounded so that U has two significant digits (GUM 7.2.6), with the decimal sign of the language. `data-key` says which number of
the contents it is, so that a program, and the tests of volid, find every number of the page again. All sections write their
numbers with `Numbers`; none formats one itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from volid.report.language import Texts

MICRO = {"mm": (1e3, "µm"), "rad": (1e6, "µrad")}  # library's unit: factor and unit of the page
THIN = "\u202f"  # between a number and its unit, where no line breaks
MINUS = "\u2212"
SIGNIFICANT = 2  # digits of U


def places_of(expanded: float | None, unit: str = "mm", fallback: int = 1) -> int:
    """Decimal places, in the unit of the page, that show two significant digits of U; `fallback` where U is unknown or 0.

    Args:
        expanded: Expanded uncertainty, in the library's unit.
        unit: "mm" and "rad" are shown in µm and µrad, others as they are.
        fallback: Decimal places without U.

    >>> places_of(0.00123), places_of(0.0123), places_of(25e-6, "rad"), places_of(None)
    (1, 0, 0, 1)
    """
    if expanded is None or not math.isfinite(expanded) or expanded <= 0.0:
        return fallback
    size = float(f"{expanded * MICRO.get(unit, (1.0, unit))[0]:.{SIGNIFICANT - 1}e}")
    return max(0, SIGNIFICANT - 1 - math.floor(math.log10(size)))


@dataclass(frozen=True)
class Numbers:
    """Numbers of a page in one language; each method gives HTML that is safe.

    In the contents' unit "mm" numbers are shown in µm, in "rad" in µrad; all other units are shown as they are, and positions,
    in mm or degrees, by `place`. What is None, NaN or infinite reads "n.d." (not determined).

    Args:
        texts: The language.

    >>> from volid.report.language import ENGLISH
    >>> print(Numbers(ENGLISH).with_u(21.34e-6, 2.1e-6, "rad", "squareness.EC0Y").striptags())
    21.3 ± 2.1 µrad
    """

    texts: Texts

    def plain(self, value: float | None, unit: str = "mm", key: str = "", places: int = 1) -> Markup:
        """The number alone, for a cell of a table whose header names the unit.

        Args:
            value: In the library's unit.
            unit: The library's unit: "mm", "rad", "°" or "".
            key: Which number of the contents it is, such as "squareness.EC0Y.value".
            places: Decimal places in the unit of the page.
        """
        if value is None or not math.isfinite(value):
            return self.unknown()
        factor = MICRO.get(unit, (1.0, unit))[0]
        return self._data(value, self.digits(round(value * factor, places) + 0.0, places), unit, key)

    def number(self, value: float | None, unit: str = "mm", key: str = "", places: int = 1) -> Markup:
        """The number with its unit."""
        return self._with_unit(self.plain(value, unit, key, places), value, unit)

    def with_u(self, value: float | None, expanded: float | None, unit: str = "mm", key: str = "") -> Markup:
        """The number ± its expanded uncertainty U, and the unit; keys are `key`.value and `key`.U."""
        places = places_of(expanded, unit)
        number = self.plain(value, unit, _of(key, "value"), places)
        if value is None or not math.isfinite(value) or expanded is None or not math.isfinite(expanded):
            return self._with_unit(number, value, unit)
        both = Markup("{} ± {}").format(number, self.plain(expanded, unit, _of(key, "U"), places))
        return self._with_unit(both, value, unit)

    def interval(
        self, bounds: Sequence[float | None] | None, unit: str = "mm", key: str = "", places: int | None = None
    ) -> Markup:
        """A coverage interval "10.1 to 14.2 µm"; keys are `key`.0 and `key`.1."""
        if bounds is None or any(b is None or not math.isfinite(b) for b in bounds):
            return self.unknown()
        low, high = (float(b) for b in bounds if b is not None)
        shown = places_of(0.5 * (high - low), unit) if places is None else places
        ends = (self.plain(v, unit, _of(key, str(i)), shown) for i, v in enumerate((low, high)))
        return self._with_unit(Markup(" {} ").format(self.texts("page.to")).join(ends), low, unit)

    def place(self, value: float | None, unit: str = "mm", key: str = "", digits: int = 6) -> Markup:
        """A position or a length of everyday size, in mm or degrees as it stands, with at most so many digits and its unit."""
        if value is None or not math.isfinite(value):
            return self.unknown()
        number = self._data(value, self._general(value, digits), unit, key)
        return Markup('<span class="number">{}{}{}</span>').format(number, _gap(unit), unit)

    def position(self, value: float | None, unit: str = "mm", key: str = "") -> Markup:
        """Where a machine stood, to 0.1 mm or 0.01°: finer than that no place in a machine is looked for.

        >>> from volid.report.language import ENGLISH
        >>> Numbers(ENGLISH).position(12345.678).striptags().split(), str(Numbers(ENGLISH).position(-24.7349, "°").striptags())
        (['12345.7', 'mm'], '−24.73°')
        """
        if value is None or not math.isfinite(value):
            return self.unknown()
        shown = f"{round(value, 2 if unit == '°' else 1) + 0.0:.9g}"
        number = self._data(value, self._signs(shown), unit, key)
        return Markup('<span class="number">{}{}{}</span>').format(number, _gap(unit), unit)

    def with_interval(
        self,
        value: float | None,
        bounds: Sequence[float | None] | None,
        unit: str = "mm",
        keys: tuple[str, str] = ("", ""),
    ) -> Markup:
        """The number with its 95 % coverage interval, "0.97 µm (95 %: 0.80 to 1.18 µm)"; `keys` of both."""
        if bounds is None or value is None or any(b is None for b in bounds):
            return self.number(value, unit, keys[0])
        low, high = (float(b) for b in bounds if b is not None)
        number = self.number(value, unit, keys[0], places_of(0.5 * (high - low), unit))
        return Markup("{} ({} {})").format(number, self.texts("page.interval_95"), self.interval(bounds, unit, keys[1]))

    def vector(self, values: Sequence[float], unit: str = "mm", key: str = "") -> Markup:
        """A vector such as (0, 0, −150) mm."""
        inside = (self._data(v, self._general(v), unit, _of(key, str(i))) for i, v in enumerate(values))
        separator = "; " if self.texts.language == "de" else ", "
        return Markup("({}){}{}").format(Markup(separator).join(inside), _gap(unit), unit)

    def count(self, value: int, key: str = "") -> Markup:
        """A whole number, with groups of three digits from five digits on."""
        text = f"{value:,}".replace(",", THIN) if abs(value) >= 10_000 else f"{value}"
        return self._data(value, text.replace("-", MINUS), "", key)

    def general(self, value: float | None, key: str = "", digits: int = 3) -> Markup:
        """A number without unit to so many significant digits, such as a unit weight or a probability."""
        if value is None or not math.isfinite(value):
            return self.unknown()
        return self._data(value, self._general(value, digits), "", key)

    def unit(self, unit: str) -> str:
        """The unit of the page for one of the library, for headers: "µm" for "mm"."""
        return MICRO.get(unit, (1.0, unit))[1]

    def unknown(self) -> Markup:
        """What stands for a number that the data do not determine."""
        title, short = self.texts("page.not_determined"), self.texts("page.not_determined_short")
        return Markup('<abbr class="none" title="{}">{}</abbr>').format(title, short)

    def digits(self, value: float, places: int) -> str:
        """The number with so many decimal places, in signs of the language."""
        return self._signs(f"{value:.{places}f}")

    def _general(self, value: float, digits: int = 6) -> str:
        return self._signs(f"{value:.{digits}g}")

    def _signs(self, text: str) -> str:
        text = text.replace("-", MINUS)
        return text.replace(".", ",") if self.texts.language == "de" else text

    def _with_unit(self, number: Markup, value: float | None, unit: str) -> Markup:
        if value is None or not math.isfinite(value):
            return number
        return Markup('<span class="number">{}{}{}</span>').format(number, _gap(unit), self.unit(unit))

    def _data(self, value: float, text: str, unit: str, key: str) -> Markup:
        exact = repr(value.item() if hasattr(value, "item") else value)
        named = Markup(' data-key="{}"').format(key) if key else Markup("")
        of_unit = Markup(' data-unit="{}"').format(unit) if unit else Markup("")
        return Markup('<data value="{}"{}{}>{}</data>').format(exact, of_unit, named, text)


def _of(key: str, part: str) -> str:
    return f"{key}.{part}" if key else ""


def _gap(unit: str) -> str:
    return "" if unit in ("", "°") else THIN
