"""The columns of a table that hold quantities of a record, and their units.

A column name is an alias and a unit, in any of the usual spellings: Battery Data Format labels
("Current / A") and machine names ("current_ampere"), PyBaMM ("Current [A]"), Arbin
("Current(A)"), BioLogic ("I/mA"), and plain names ("current"), whose unit is then assumed.
"""

import difflib
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from .dialects import DIALECTS, OTHER_TABLES, PLAIN, Dialect
from .quantities import OCV_QUANTITIES, QUANTITIES, QUANTITY_OF, Quantity, Unit

# A unit stands behind a slash, # or comma, in brackets, or after a blank (machine names); Arbin
# numbers its auxiliary channels behind the bracket.
_UNIT = re.compile(
    r"^(?:\s*[/\[(#]\s*|\s*,\s*\(?|\s+(?:in\s+)?)(?P<unit>[^\])]*?)\s*(?:[\])]\s*\d*)?$"
)
# "h:min:s.ms", "h min s.ms", "Hours in hh:mm:ss.xxx", "mm:ss" and "ss.xxx" are forms of seconds.
_CLOCK_FORM = re.compile(r".*\bh+[: ]m.*|m+:s.*|s+\.x+")
# What the variables of scripts have behind a quantity: "t_data", "V_meas", "tvec".
_VARIABLE = re.compile(r"(?<=\w)( ?(data|vec|vector)| (meas|exp|array|values?))(?= ?[\[(/]|$)")
# "Re(Z)/Ohm", "-Im", "|Z|", "Zreal" and "Z''".
_IMPEDANCE = re.compile(r"[-|]?(re|im|z ?(re|im|real|imag|mod)?)(\b|$)|impedance")

# Aliases that carry their unit in themselves.
_SELF_EXPLAINING = re.compile("seconds|m?amps|volts|m?amp-hr|chgah|disah|ma|mv")
# Comparing spellings is slow, and no tester writes so many columns.
_COMPARED_NAMES = 1000
# The quantities that tell the time, and the current.
_CLOCKS, _CURRENTS = {"time", "step time", "date"}, {"current", "charge of the interval"}
# What the voltages of cells are called in short.
_CELLS = {"v", "u", "vc", "uc", "uz", "cv"}
NOTHING: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Column:
    """A column found: its place in the table, its name as written, and its unit.

    `is_unit_assumed` says that the name gives no unit and the quantity's own was taken,
    `is_unit_given` that the user says the unit, which then holds whatever the values look like.
    """

    index: int
    header: str
    quantity: Quantity
    unit: Unit
    is_unit_assumed: bool
    is_unit_given: bool = False


def find_columns(header: Sequence[str], quantities: Sequence[Quantity]) -> dict[str, Column]:
    """The column of each quantity that the header names, by the quantity's name.

    Where several columns could hold one quantity, the more specific alias wins, then the column
    that states its unit, then the first of two equal names.
    """
    found: dict[str, Column] = {}
    names = {name: index for index, name in reversed(list(enumerate(header)))}
    normals = {name: _VARIABLE.sub("", re.sub("[<>]", "", normal(name))) for name in names}
    for quantity in quantities:
        matches = (_match(index, name, normals[name], quantity) for name, index in names.items())
        candidates = [match for match in matches if match is not None]
        if candidates:
            _, found[quantity.name] = min(
                candidates, key=lambda match: (match[0], match[1].is_unit_assumed, match[1].index)
            )
    return found


def normal(name: str) -> str:
    """The name in lower case, with blanks for underscores, and u for micro."""
    # Wide brackets, and units in one letter.
    plain = unicodedata.normalize("NFKC", name).replace("μ", "u").lstrip("~# \ufeff")
    return re.sub(r"[\s_]+", " ", plain).strip().lower()


def unit_of(quantity: Quantity, text: str) -> Unit | None:
    """The unit of the quantity that the text spells, if it does."""
    spelled = normal(text).replace("^", "")
    if quantity.base_unit.symbol == "s" and _CLOCK_FORM.fullmatch(spelled):
        return quantity.base_unit
    # A lost degree sign is still one of Celsius.
    spelled = re.sub("[?\ufffdº]", "°", spelled)
    return quantity.units.get(spelled) or quantity.units.get(spelled.rstrip("."))


def named_column(header: Sequence[str], quantity: Quantity, given: str) -> Column | None:
    """The column that the user names, as "NAME" or "NAME:unit"; None where the header lacks it.

    Without a unit, the one at the end of the name holds, or the quantity's own.
    """
    name, _, spelled = given.rpartition(":")
    unit = unit_of(quantity, spelled) if name else None
    names = [(normal(name), index) for index, name in reversed(list(enumerate(header)))]
    # A unit may have been joined to the name from the row below.
    places = {name.partition(" [")[0]: index for name, index in names} | dict(names)
    if unit is None or normal(given) in places:
        name, unit = given, None
    if normal(name) not in places:
        return None
    index = places[normal(name)]
    if unit is not None:
        own = header[index]
        return Column(index, own, quantity, unit, is_unit_assumed=False, is_unit_given=True)
    return _with_its_unit(index, header[index], quantity)


def _with_its_unit(index: int, name: str, quantity: Quantity) -> Column:
    """The column with the unit in brackets or behind a slash at its name's end, if any."""
    stated = re.search(r"[/\[(]\s*([^/\[\]()]*?)\s*[\])]?\s*$", normal(name))
    unit = unit_of(quantity, stated[1]) if stated else None
    is_assumed = unit is None and "1" not in quantity.units
    return Column(index, name, quantity, unit or quantity.base_unit, is_assumed)


def _match(index: int, name: str, plain: str, quantity: Quantity) -> tuple[int, Column] | None:
    """Rank of the alias that the name is (0 is the most specific), and the column it names.

    An alias such as "programmdauer=ms" has that unit where the name states none.
    """
    # Most names are of none, and a file may have thousands of lines that could be its names.
    if not plain.startswith(quantity.beginnings):
        return None
    for rank, spelling in enumerate(quantity.aliases):
        alias, _, stated = spelling.partition("=")
        if plain == alias:
            # A bare T is a temperature to some and a time to others; a bare t is a time.
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


def likely_names(quantity: Quantity, header: Sequence[str]) -> list[str]:
    """Names in the header that may mean the quantity although they are not accepted for it.

    They contain an alias, are spelled nearly like one, or mean it in another language.
    """
    long = [alias for alias in quantity.aliases if len(alias) > 2 and "=" not in alias]
    likely = []
    for name in header[:_COMPARED_NAMES]:
        plain = normal(name)
        words = re.split(r"[\[(/]", plain)[0].strip()
        is_inside = any(word in plain for word in (*long, *quantity.foreign))
        if is_inside or difflib.get_close_matches(words, long, 1, 0.7):
            likely.append(name)
    return likely


def likely_column(quantity: Quantity, header: Sequence[str]) -> Column | None:
    """The only column that may hold the quantity, with the unit at its name's end, if any."""
    names = likely_names(quantity, header)
    if len(names) != 1:
        return None
    return _with_its_unit(list(header).index(names[0]), names[0], quantity)


def names_cell_voltage(name: str) -> bool:
    """True if a column of a pack is named like a voltage's or a cell's, and not something else's.

    >>> [names_cell_voltage(name) for name in ("V1", "Cell_01 [mV]", "Aux T 1 (C)", "Cell 1 temp")]
    [True, True, False, False]
    """
    plain = re.sub(r"\d+", "", normal(name))
    voltage = QUANTITY_OF["voltage"]
    units = [text.strip() for text in re.findall(r"[/\[(]([^/\[\]()]*)", plain)]
    if any(units):
        return any(unit_of(voltage, unit) for unit in units)
    if any(word in plain for word in ("volt", *voltage.foreign)):
        return True
    others = (alias for quantity in QUANTITIES for alias in (*quantity.aliases, *quantity.foreign))
    if any(word in plain for word in others if len(word) > 3 and word not in voltage.aliases):
        return False
    return bool(
        re.search("cell|zell|celda|单体", plain) or _CELLS & set(re.split("[^a-z]+", plain))
    )


def _bare(header: Sequence[str]) -> set[str]:
    """The names as marks give them, each with its unit and without."""
    names = {re.sub("[<>]", "", normal(name)).replace(" (", "(") for name in header}
    return names | {re.split(r" *[(\[/#,]", name)[0] for name in names}


def dialect_of(header: Sequence[str]) -> Dialect:
    """Whose names these are; `PLAIN` where they are nobody's."""
    names = _bare(header)
    return next((dialect for dialect in DIALECTS if dialect.is_marked(names)), PLAIN)


def columns_of(header: Sequence[str], given: Mapping[str, str] = NOTHING) -> dict[str, Column]:
    """The column of each quantity of a record that the header names.

    `given` holds the user's own names by quantity, as `columns` takes them, and comes first.
    """
    return find_columns(header, dialect_of(header).quantities) | find_given(header, given)


def find_given(header: Sequence[str], given: Mapping[str, str]) -> dict[str, Column]:
    """The columns that the user names, by quantity, of those that the header has."""
    named = {name: named_column(header, QUANTITY_OF[name], own) for name, own in given.items()}
    return {name: column for name, column in named.items() if column is not None}


def names_record(header: Sequence[str], given: Mapping[str, str] = NOTHING) -> bool:
    """True if the header names a clock, a current and a voltage."""
    found = columns_of(header, given).keys() if len(header) > 2 else set()
    return "voltage" in found and bool(found & _CURRENTS) and bool(found & _CLOCKS)


def with_units(
    header: Sequence[str], below: Sequence[str], given: Mapping[str, str] = NOTHING
) -> tuple[tuple[str, ...], bool]:
    """The names with the units that stand in the cells below them, and whether they do."""
    units = [cell.strip("[]()") for cell in below]
    units += [""] * (len(header) - len(units))
    own = {column.index: column for column in columns_of(header, given).values()}
    spelled = {
        k: unit_of(own[k].quantity, units[k])
        for k in own
        if units[k] and own[k].quantity.is_required
    }
    if not spelled or not all(
        unit and (own[k].is_unit_assumed or unit == own[k].unit) for k, unit in spelled.items()
    ):
        return tuple(header), False
    return tuple(
        name
        if (k in own and not own[k].is_unit_assumed)
        or not any(unit_of(quantity, units[k]) for quantity in QUANTITIES)
        else f"{name} [{units[k]}]"
        for k, name in enumerate(header)
    ), True


def other_table(header: Sequence[str]) -> str | None:
    """The kind of a table that is known to be no record; None for any other."""
    names = _bare(header)
    if "freq" in names and any(map(_IMPEDANCE.match, names)):
        return "an impedance spectrum"
    held = (what for mark, what in OTHER_TABLES.items() if names.issuperset(mark.split(" & ")))
    return next(held, None)


def is_ocv_table(header: Sequence[str], given: Mapping[str, str] = NOTHING) -> bool:
    """True if the header names SOC and a voltage, but no record, nor what the user calls the clock
    or the current of one."""
    ocv = find_columns(header, OCV_QUANTITIES).keys()
    named = find_given(header, given).keys() & (_CLOCKS | _CURRENTS)
    return "SOC" in ocv and len(ocv) > 1 and not named and not names_record(header)
