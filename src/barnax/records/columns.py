"""The columns of a table that hold quantities of a record, and their units.

A column name is an alias and a unit, in any of the usual spellings: Battery Data Format labels
("Current / A") and machine names ("current_ampere"), PyBaMM ("Current [A]"), Arbin ("Current(A)"),
BioLogic ("I/mA"), and plain names ("current"), whose unit is then assumed.
"""

import difflib
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from ..errors import InputError
from .dialects import CHARGE, DIALECTS, DISCHARGE, OTHER_TABLES, PLAIN, Dialect, Sign
from .quantities import NEEDED, OCV_QUANTITIES, QUANTITIES, QUANTITY_OF, Quantity, Unit

# A unit follows a slash, # or comma, is in brackets, or follows a blank (machine names); Arbin
# numbers its auxiliary channels after the bracket.
_UNIT = re.compile(
    r"^(?:\s*[/\[(#]\s*|\s*,\s*\(?|\s+(?:in\s+)?)(?P<unit>[^\])]*?)\s*(?:[\])]\s*\d*)?$"
)
# "h:min:s.ms", "h min s.ms", "Hours in hh:mm:ss.xxx", "mm:ss" and "ss.xxx" are forms of seconds.
_CLOCK_FORM = re.compile(r".*\bh+[: ]m.*|m+:s.*|s+\.x+")
# The sign of the current while discharging: "Current (A), discharge positive", "I [A] (+ =
# charge)", "Current (charge positive) [A]".
_SIGN = re.compile(
    r"(?<=.)[ ,;:(\[]+((dis)?charg(e|ing)\W*(is )?(pos(itive)?|neg(ative)?|\+)"
    r"|(pos(itive)?|neg(ative)?|\+)\W*(is |on |for )?(dis)?charg(e|ing))[)\]]*(?=\s*[/\[(]|$)"
)
# What scripts append to the names of variables: "t_data", "V_meas", "tvec".
_VARIABLE = re.compile(r"(?<=\w)( ?(data|vec|vector)| (meas|exp|array|values?))(?= ?[\[(/]|$)")
# "Re(Z)/Ohm", "-Im", "|Z|", "Zreal" and "Z''".
_IMPEDANCE = re.compile(r"[-|]?(re|im|z ?(re|im|real|imag|mod)?)(\b|$)|impedance")

# Aliases that include their unit.
_SELF_EXPLAINING = re.compile("seconds|m?amps|volts|m?amp-hr|chgah|disah|ma|mv")
# Comparing spellings is slow, and no tester writes so many columns.
_COMPARED_NAMES = 1000
# Quantities that determine the time, and the current.
_CLOCKS, _CURRENTS = {"time", "step time", "date"}, {"current", "charge of the interval"}
# Short names of cell voltages.
_CELLS = {"v", "u", "vc", "uc", "uz", "cv"}
NOTHING: Mapping[str, str] = MappingProxyType({})
# What `columns` may name.
NAMES = tuple(name for name in QUANTITY_OF if name not in ("date", "charge of the interval"))


@dataclass(frozen=True)
class Column:
    """A column: its index in the table, its name as written, and its unit.

    `is_unit_assumed`: the name has no unit, and the quantity's default is used. `is_unit_given`:
    the user has given the unit, which holds whatever the values look like.
    """

    index: int
    header: str
    quantity: Quantity
    unit: Unit
    is_unit_assumed: bool
    is_unit_given: bool = False

    @property
    def sign(self) -> Sign | None:
        """The sign of the current in the name, if any."""
        if words := _SIGN.search(normal(self.header)):
            return DISCHARGE if ("dis" in words[0]) is ("neg" not in words[0]) else CHARGE
        return None


def normal(name: str) -> str:
    """The name in lower case, with blanks for underscores, and u for micro."""
    # Wide brackets, and units in a single character.
    plain = unicodedata.normalize("NFKC", name).replace("μ", "u").lstrip("~# \ufeff")
    return re.sub(r"[\s_]+", " ", plain).strip().lower()


def unit_of(quantity: Quantity, text: str) -> Unit | None:
    """The unit of the quantity with this spelling, if any."""
    spelled = normal(text).replace("^", "")
    if quantity.base_unit.symbol == "s" and _CLOCK_FORM.fullmatch(spelled):
        return quantity.base_unit
    # A lost degree sign still means Celsius.
    spelled = re.sub("[?\ufffdº]", "°", spelled)
    return quantity.units.get(spelled) or quantity.units.get(spelled.rstrip("."))


def in_its_unit(index: int, name: str, quantity: Quantity) -> Column:
    """The column with the unit in brackets or after a slash at the end of its name, if any."""
    stated = re.search(r"[/\[(]\s*([^/\[\]()]*?)\s*[\])]?\s*$", _SIGN.sub("", normal(name)))
    unit = unit_of(quantity, stated[1]) if stated else None
    is_assumed = unit is None and "1" not in quantity.units
    return Column(index, name, quantity, unit or quantity.base_unit, is_assumed)


def _match(index: int, name: str, plain: str, quantity: Quantity) -> tuple[int, Column] | None:
    """The rank of the matching alias (0 is the most specific), and its column.

    An alias such as "programmdauer=ms" has this unit if the name states none.
    """
    # Most names match nothing, and a file may have thousands of lines that could be its header.
    if not plain.startswith(quantity.beginnings):
        return None
    for rank, (alias, stated) in enumerate(quantity.aliases.items()):
        if plain == alias:
            # A bare T is a temperature or a time; a bare t is a time.
            is_bare = alias == "t" and not stated
            if is_bare and (name.strip()[:1] != "t" or quantity.name != "time"):
                continue
            unit = quantity.units[stated.lower()] if stated else quantity.base_unit
            is_plain = "1" in quantity.units or bool(_SELF_EXPLAINING.fullmatch(alias))
            return rank, Column(index, name, quantity, unit, is_unit_assumed=not is_plain)
        if plain.startswith(alias) and (rest := _UNIT.match(plain[len(alias) :])):
            unit = unit_of(quantity, rest["unit"])
            if unit is not None:
                return rank, Column(index, name, quantity, unit, is_unit_assumed=False)
    return None


def names_cell_voltage(name: str) -> bool:
    """True if a column of a pack is named like a voltage or a cell, and not like anything else.

    >>> [names_cell_voltage(name) for name in ("V1", "Cell_01 [mV]", "Aux T 1 (C)", "Cell 1 temp")]
    [True, True, False, False]
    """
    plain = re.sub(r"\d+", "", normal(name))
    voltage = QUANTITY_OF["voltage"]
    units = [text.strip() for text in re.findall(r"[/\[(]([^/\[\]()]*)", plain)]
    if any(units):
        return any(unit_of(voltage, unit) for unit in units)
    if any(word in plain for word in ("volt", "spannung", "电压", *voltage.foreign)):
        return True
    others = (alias for quantity in QUANTITIES for alias in (*quantity.aliases, *quantity.foreign))
    if any(word in plain for word in others if len(word) > 3 and word not in voltage.aliases):
        return False
    letters = set(re.split("[^a-z]+", plain))
    return bool(_CELLS & letters or re.search("cell|zell|celda|单体", plain))


@dataclass(frozen=True)
class Header:
    """The names of a table's columns and their meanings, each looked up once.

    `given` are the user's names by quantity, as in `columns`; they take precedence.
    """

    names: tuple[str, ...]
    given: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def _normal(self) -> tuple[str, ...]:
        return tuple(map(normal, self.names))

    @cached_property
    def _bare(self) -> set[str]:
        """The names as in `marks`, each with its unit and without."""
        names = {re.sub("[<>]", "", name).replace(" (", "(") for name in self._normal}
        return names | {re.split(r" *[(\[/#,]", name)[0] for name in names}

    @cached_property
    def dialect(self) -> Dialect:
        """The make with these names; `PLAIN` if unknown."""
        return next((dialect for dialect in DIALECTS if dialect.is_marked(self._bare)), PLAIN)

    @cached_property
    def columns(self) -> Mapping[str, Column]:
        """The column of each quantity of a record, by the names."""
        return {**self._named, **self.given_columns}

    @cached_property
    def _named(self) -> Mapping[str, Column]:
        return self.find(self.dialect.quantities)

    @cached_property
    def given_columns(self) -> Mapping[str, Column]:
        """The columns that the user names, by quantity, if they exist."""
        named = {name: self.named(QUANTITY_OF[name], text) for name, text in self.given.items()}
        return {name: column for name, column in named.items() if column is not None}

    @cached_property
    def is_record(self) -> bool:
        """True if there are names of a clock, a current and a voltage."""
        return self._names_record(self.columns)

    def _names_record(self, columns: Mapping[str, Column]) -> bool:
        names = columns.keys() if len(self.names) > 2 else set()
        return "voltage" in names and bool(names & _CURRENTS) and bool(names & _CLOCKS)

    @cached_property
    def ocv_columns(self) -> Mapping[str, Column]:
        """The column of each quantity of a table of OCV over SOC, by the names."""
        return self.find(OCV_QUANTITIES)

    @cached_property
    def is_ocv_table(self) -> bool:
        """True if there are names of SOC and a voltage, but none of a record, not even one given
        for its clock or current."""
        if "SOC" not in self.ocv_columns or len(self.ocv_columns) < 2:
            return False
        is_given = self.given_columns.keys() & (_CLOCKS | _CURRENTS)
        return not is_given and not self._names_record(self._named)

    @cached_property
    def other_table(self) -> str | None:
        """The kind of a known table that is not a record; None for any other."""
        # A single frequency column next to samples may be that of an impedance at one frequency.
        is_spelled = "frequency" in self._bare and len(self.columns.keys() & NEEDED) < 2
        if ("freq" in self._bare or is_spelled) and any(map(_IMPEDANCE.match, self._bare)):
            return "an impedance spectrum"
        kinds = OTHER_TABLES.items()
        held = (kind for mark, kind in kinds if self._bare.issuperset(mark.split(" & ")))
        return next(held, None)

    def find(self, quantities: Iterable[Quantity]) -> dict[str, Column]:
        """The column of each named quantity, by the quantity's name.

        If several columns could hold a quantity, the more specific alias wins, then the column that
        states its unit, then the first of two equal names.
        """
        columns: dict[str, Column] = {}
        bare = (_SIGN.sub("", re.sub("[<>]", "", name)) for name in self._normal)
        plain = [_VARIABLE.sub("", name) for name in bare]
        cells = list(zip(range(len(plain)), self.names, plain, strict=True))
        for quantity in quantities:
            candidates = [match for cell in cells if (match := _match(*cell, quantity))]
            if candidates:
                best = min(candidates, key=lambda match: (match[0], match[1].is_unit_assumed))
                columns[quantity.name] = best[1]
        return columns

    def named(self, quantity: Quantity, given: str) -> Column | None:
        """The column that the user names, as "NAME" or "NAME:unit"; None if there is none.

        Without a unit, the one at the end of the name applies, or else the quantity's default.
        """
        if fitting := self.fitting(given):
            return in_its_unit(fitting[0], self.names[fitting[0]], quantity)
        name, _, spelled = given.rpartition(":")
        unit, fitting = unit_of(quantity, spelled), self.fitting(name)
        if not (name and unit and fitting):
            return None
        return Column(fitting[0], self.names[fitting[0]], quantity, unit, False, is_unit_given=True)

    def fitting(self, given: str) -> list[int]:
        """The columns that fit a user's name best: the same spelling, else another spelling, else
        with a unit that was added from the row below."""
        plain, bare = normal(given), [name.partition(" [")[0] for name in self._normal]
        for wanted, names in ((given, self.names), (plain, self._normal), (plain, bare)):
            if wanted in names:
                return [index for index, name in enumerate(names) if name == wanted]
        return []

    def likely(self, quantity: Quantity) -> list[Column]:
        """The columns that may hold the quantity although their names are not accepted, with the
        unit at the end of the name, if any.

        Their names contain an alias, are spelled similarly, or are a translation.
        """
        long = [alias for alias in quantity.aliases if len(alias) > 2]
        likely = []
        for index, plain in enumerate(self._normal[:_COMPARED_NAMES]):
            words = re.split(r"[\[(/]", plain)[0].strip()
            is_inside = any(word in plain for word in (*long, *quantity.foreign))
            if is_inside or difflib.get_close_matches(words, long, 1, 0.7):
                likely.append(in_its_unit(index, self.names[index], quantity))
        return likely

    def with_units(self, below: Sequence[str]) -> "Header":
        """The header with units from the cells below the names; unchanged if there are none."""
        units = [cell.strip("[]()") for cell in below]
        units += [""] * (len(self.names) - len(units))
        columns = {column.index: column for column in self.columns.values()}
        needed = [column for column in columns.values() if column.quantity.name in NEEDED]
        below_it = ((column, units[column.index]) for column in needed)
        spelled = [(column, unit_of(column.quantity, text)) for column, text in below_it if text]
        agree = (unit and (one.is_unit_assumed or unit == one.unit) for one, unit in spelled)
        if not spelled or not all(agree):
            return self
        names = list(self.names)
        for index, unit in enumerate(units[: len(names)]):
            is_stated = index in columns and not columns[index].is_unit_assumed
            if not is_stated and any(unit_of(quantity, unit) for quantity in QUANTITIES):
                names[index] += f" [{unit}]"
        return Header(tuple(names), self.given)


def read_columns(given: Mapping[str, str] | str) -> dict[str, str]:
    """The user's names by quantity, from a mapping or from text such as "current=I[mA]:mA,...".

    A name may contain commas and equality signs, because only a quantity begins the next entry; a
    name that looks like another quantity, such as ",amps=", has to be given in a mapping. Raises
    InputError for anything that is not a quantity of a record.

    >>> read_columns("time=Zeit:min,current=Strom, gemessen:mA")
    {'time': 'Zeit:min', 'current': 'Strom, gemessen:mA'}
    """
    if not given:
        return {}
    if isinstance(given, str):
        quantities = "|".join(map(re.escape, NAMES))
        parts = re.split(rf"(?:^|,)\s*({quantities})\s*=", given)
        unknown = parts[0].strip() or ("" if len(parts) > 1 else "nothing")
        given = dict(zip(parts[1::2], map(str.strip, parts[2::2]), strict=True))
        # A mistyped quantity is not taken as part of the previous name.
        others = (re.search(r",\s*(\w+)\s*=", name) for name in given.values())
        unknown = next((other[1] for other in others if other), unknown)
    else:
        unknown = next((name for name in given if name not in NAMES), "")
    if unknown or not all(given.values()):
        words = f"{unknown!r} is no quantity" if unknown else "a quantity has no name"
        raise InputError(
            f"`columns`: {words}; write them as 'time=NAME:s,current=NAME:mA,voltage=NAME', with "
            f"a unit after a colon if the name has none; there are {', '.join(NAMES)}."
        )
    return dict(given)
