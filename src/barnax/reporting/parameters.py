"""The parameters of a result with their intervals: as a data frame, and results side by side."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..cell.parameters import OCV_CORRECTION
from ..errors import InputError
from ..results import Result
from .document import Bullets, Document, Section, Table, make_table
from .render import to_fragment
from .words import NOTHING, between, degrees, joined, millivolt, percent, shown, symbol, with_unit

if TYPE_CHECKING:
    import polars

    from ..over_soc import TableFit

# Where tables are compared.
COMPARED_SOC = (0.1, 0.3, 0.5, 0.7, 0.9)
# An interval over more than this factor would hide a doubling.
TOO_WIDE = 2.0


class Known(NamedTuple):
    """A parameter, in its own unit, with the ends of its interval where it has one; at an SOC."""

    name: str
    soc: float | None
    value: float
    low: float | None = None
    high: float | None = None

    @property
    def words(self) -> str:
        if self.low is None or self.high is None:
            return with_unit(self.name, self.value)
        (value, unit), (low, low_unit), (high, high_unit) = (
            shown(self.name, end) for end in (self.value, self.low, self.high)
        )
        if not unit == low_unit == high_unit:
            return f"{value} {unit} ({between(self.name, self.low, self.high)})"
        return f"{value} ({low} to {high}) {unit}".rstrip()

    @property
    def place(self) -> str:
        """What it is of."""
        return symbol(self.name) + ("" if self.soc is None else f" at {percent(self.soc)} SOC")

    def is_beyond(self, other: "Known") -> bool | None:
        """Whether the intervals have nothing in common; None where one has none."""
        if None in (self.low, self.high, other.low, other.high):
            return None
        return self.low > other.high or self.high < other.low  # pyright: ignore[reportOperatorIssue]

    @property
    def is_wide(self) -> bool:
        """Whether its interval would hide a doubling."""
        if self.low is None or self.high is None:
            return False
        return self.low <= 0 or self.high > TOO_WIDE * self.low

    def change_words(self, other: "Known") -> str:
        """What comes of comparing it with another."""
        match self.is_beyond(other):
            case None:
                return "no interval"
            case True:
                return "beyond"
            case _:
                return "too wide to tell" if self.is_wide or other.is_wide else "within"


def parameters_frame(result: Result) -> "polars.DataFrame":
    """`Result.to_frame`."""
    import polars as pl

    if result.tables is None:
        rows = [(known.name, known.value, known.low, known.high) for known in _constants(result)]
        number = dict.fromkeys(("value", "low", "high"), pl.Float64)
        return pl.DataFrame(rows, {"parameter": pl.String, **number}, orient="row")
    nodes = [
        ({} if degc is None else {"temperature [degC]": degc}) | row
        for degc, fit in result.tables.found.by_degc
        for row in _node_rows(fit)
    ]
    return pl.DataFrame(nodes, infer_schema_length=None)


def _node_rows(fit: "TableFit") -> Iterator[dict[str, Any]]:
    """Every node: its SOC, whether samples visit it, and every value with its interval."""
    tables = fit.tables
    known = {(node.name, node.soc): node for node in fit.intervals}
    visited = tables.visited or (True,) * len(tables.nodes)
    for place, (soc, is_visited) in enumerate(zip(tables.nodes, visited, strict=True)):
        row: dict[str, Any] = {"SOC": soc, "is visited": is_visited}
        values = [(name, soc, own[place]) for name, own in tables.tables.items()]
        values += [(name, None, own) for name, own in tables.constants.items()]
        for name, at, value in values:
            found = known.get((name, at))
            what, bracket, unit = name.partition(" [")
            row[name] = value
            for end in ("low", "high"):
                ended = None if found is None else getattr(found, end)
                row[f"{what} {end}{bracket}{unit}"] = ended
        yield row


def _constants(result: Result) -> list[Known]:
    """The constant circuit's parameters and time constants."""
    found = result.constant.estimates.values()
    if not found:
        own = result.constant.parameters.to_dict()
        return [Known(name, None, value) for name, value in own.items()]
    return [Known(known.name, None, known.value, known.low, known.high) for known in found]


def _tabulated(fit: "TableFit") -> Iterator[Known]:
    """Tables at a few states of charge between visited nodes, and the constants."""
    for name in fit.tables.tables:
        known = [node for node in fit.of_table(name) if node.low is not None]
        if name == OCV_CORRECTION or not known:
            # A correction is of an OCV, which is another result's no more.
            continue
        soc = np.array([node.soc for node in known], float)
        for at in COMPARED_SOC:
            if soc[0] <= at <= soc[-1]:
                ends = ([getattr(node, of) for node in known] for of in ("value", "low", "high"))
                yield Known(name, at, *(float(np.interp(at, soc, own)) for own in ends))
    known_ends = {node.name: (node.low, node.high) for node in fit.intervals if node.soc is None}
    for name, value in fit.tables.constants.items():
        yield Known(name, None, value, *known_ends.get(name, (None, None)))


@dataclass(frozen=True, repr=False)
class SideBySide:
    """Results side by side; a console and a notebook show it as tables.

    Attributes:
        document: The tables and what they come to.
        differing: For each result after the first, what differs from that beyond both intervals.
        too_wide: Likewise, of what the intervals are too wide to tell: one of them spans more than
            a factor of two.
    """

    document: Document
    differing: Mapping[str, tuple[str, ...]]
    too_wide: Mapping[str, tuple[str, ...]]

    def __repr__(self) -> str:
        from .terminal import to_text

        return to_text(self.document)

    def _repr_html_(self) -> str:
        return to_fragment(self.document)


def show(*results: Result | str | Path, names: tuple[str, ...] = ()) -> SideBySide:
    """Two or more results side by side, and what differs beyond their intervals.

    Two cells, two ages or two temperatures of one cell: every parameter with its 95 % interval, and
    the change from the first result. Intervals that do not overlap tell a difference; that they do
    overlap tells none, which is careful, and nothing at all where one of them spans more than a
    factor of two. Tables are compared at some states of charge, with each
    other; beside a constant circuit, that of the other result is compared.

    Args:
        results: Results, their folders or their files.
        names: What each is called; by default its records, numbered where these are alike.

    Raises `InputError` for fewer than two results, and for names that do not fit.

    >>> import barnax
    >>> result = barnax.identify(setup="li2023", seeds=0, advise=False)
    >>> barnax.show(result, result, names=("fresh", "aged")).differing
    {'aged': ()}
    """
    found = [result if isinstance(result, Result) else Result.load(result) for result in results]
    if len(found) < 2:
        raise InputError(f"{len(found)} result given; give two or more to show side by side")
    called = names or _names(found)
    if len({*called}) != len(found):
        raise InputError(f"the names {', '.join(called)} are not {len(found)} different ones")
    have_tables = all(result.tables for result in found)
    known = [
        {(parameter.name, parameter.soc): parameter for parameter in own}
        for own in (
            _tabulated(result.tables.fit) if have_tables and result.tables else _constants(result)
            for result in found
        )
    ]
    rows = list(dict.fromkeys(key for own in known for key in own))
    first, *others = known
    told = {
        name: {
            key: first[key].change_words(own[key]) for key in rows if key in first and key in own
        }
        for name, own in zip(called[1:], others, strict=True)
    }
    differing, too_wide = (
        {
            name: tuple(first[key].place for key, change in words.items() if change == said)
            for name, words in told.items()
        }
        for said in ("beyond", "too wide to tell")
    )
    said = []
    for name, words in told.items():
        beyond, wide = differing[name], _places(key for key in words if words[key][:3] == "too")
        verb = "differ" if len(beyond) > 1 else "differs"
        text = f"{name}: {joined(beyond) or 'nothing'} {verb} from {called[0]} beyond the intervals"
        said.append(f"{text}; for {wide} they are too wide to tell." if wide else f"{text}.")
    if len({result.model for result in found}) > 1:
        said.append("The circuits differ, so the same name may stand for another part of the cell.")
    what = "Tables over SOC" if have_tables else "Constant circuits"
    sections = (
        Section("Differences", (Bullets(tuple(said)),)),
        Section("Results", (_results_table(called, found, have_tables),)),
        Section(what, (_parameters_table(called, known, rows),)),
    )
    document = Document(joined(list(called), "beside"), "", sections)
    return SideBySide(document, differing, too_wide)


def _places(keys: Iterable[tuple[str, float | None]]) -> str:
    """Parameters, each with all its states of charge."""
    found: dict[str, list[str]] = {}
    for name, soc in keys:
        found.setdefault(symbol(name), []).extend([] if soc is None else [f"{100 * soc:g}"])
    return joined([f"{name} at {joined(at)} % SOC" if at else name for name, at in found.items()])


def _names(results: list[Result]) -> tuple[str, ...]:
    names = [result.name for result in results]
    if len({*names}) == len(names):
        return tuple(names)
    return tuple(f"{place}: {name}" for place, name in enumerate(names, 1))


def _results_table(called: tuple[str, ...], results: list[Result], have_tables: bool) -> Table:
    """What each is of, and how well it fits."""
    own = results if have_tables else [result.without_tables() for result in results]
    of = dict(zip(called, own, strict=True))

    def temperature(name: str) -> str:
        degc = dict.fromkeys(degrees(at) for _, at in of[name].measured_at if at is not None)
        over = of[name].tables and of[name].tables.found.reference_degc  # pyright: ignore[reportOptionalMemberAccess]
        return (
            f"tables at {degrees(over)}"
            if over is not None
            else joined(list(degc))
            if degc
            else NOTHING
        )

    def validation(name: str) -> str:
        errors = [millivolt(part.rmse_v) for part in of[name].metrics.validation]
        return joined(errors) if errors else NOTHING

    cells = {
        "result": str,
        "circuit": lambda name: of[name].model,
        "temperature": temperature,
        "capacity [Ah]": lambda name: f"{of[name].cell_at().capacity_ah:.4g}",
        "RMSE": lambda name: millivolt(of[name].metrics.identification.rmse_v),
        "validation": validation,
    }
    return make_table("", called, cells, ["result", "circuit", "temperature", "validation"])


def _parameters_table(
    called: tuple[str, ...],
    known: list[dict[tuple[str, float | None], Known]],
    rows: list[tuple[str, float | None]],
) -> Table:
    """Each parameter of each result with its interval, and the change from the first."""

    def value(place: int, key: tuple[str, float | None]) -> str:
        return known[place][key].words if key in known[place] else NOTHING

    def change(place: int, key: tuple[str, float | None]) -> str:
        if key not in known[0] or key not in known[place] or not known[0][key].value:
            return NOTHING
        one, other = known[0][key], known[place][key]
        return f"{100 * (other.value / one.value - 1):+.3g} %, {one.change_words(other)}"

    cells: dict[str, Any] = {
        "parameter": lambda key: symbol(key[0]),
        "SOC": lambda key: NOTHING if key[1] is None else percent(key[1]),
    }
    for place, name in enumerate(called):
        cells[name] = partial(value, place)
        if place:
            cells["change" if len(called) == 2 else f"change to {name}"] = partial(change, place)
    caption = (
        "Values with their 95 % intervals. Beyond: the intervals do not overlap. Within: they do, "
        "and the results do not tell a difference. Too wide to tell: they do, and one spans more "
        "than a factor of two."
    )
    return make_table(caption, rows, cells, list(cells))
