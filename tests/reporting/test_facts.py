"""A number of a result, and its interval, is the same in every digit, whoever prints it."""

import csv
from dataclasses import replace

import pytest

import barnax
from barnax import Result, TableFit
from barnax.export import get_exporter
from barnax.fit.node_interval import NodeInterval, sum_name
from barnax.reporting.document import ReportTable
from barnax.reporting.parameters import tables_csv
from barnax.reporting.view import View
from barnax.reporting.wording import blocks, table
from barnax.reporting.words import interval, symbol, with_unit, without_unit
from helpers.golden import RESULT
from helpers.results import make_table_result, with_constant, with_fit

STORED = Result.from_json(RESULT)


def stored_with(tables: Result) -> Result:
    """The stored result with the tables of one made by hand."""
    return STORED.model_copy(update={"tables": tables.tables, "model": tables.model})


def with_ends(result: Result, every: int = 1, **ends: float | None) -> Result:
    """The same with other ends of every interval, or of every second one."""

    def changed(intervals: tuple[NodeInterval, ...]) -> tuple[NodeInterval, ...]:
        numbered = enumerate(intervals)
        return tuple(own if number % every else replace(own, **ends) for number, own in numbered)

    fit = result.fit
    return with_fit(result, intervals=changed(fit.intervals), means=changed(fit.means))


def with_sum(result: Result) -> Result:
    """The same with pairs that have nearly one time constant."""
    _, first, second = means = result.fit.means
    total = replace(
        first,
        name=sum_name([first.name, second.name]),
        **{end: getattr(first, end) + getattr(second, end) for end in ("value", "low", "high")},
    )
    return with_fit(result, means=(*means, total))


def with_taus(result: Result) -> Result:
    """The same with intervals of the time constants, which no other record widens."""
    constants = result.fit.tables.constants.items()
    taus = (
        NodeInterval(name, None, value, 1e-2 * value, 0.0, 0.97 * value, 1.04 * value)
        for name, value in constants
    )
    return with_fit(result, intervals=(*result.fit.intervals, *taus))


ENDS = {
    "as they are": {},
    "at most": {"low": 0.0},
    "at most, without the other end": {"low": None},
    "at least": {"high": None},
    "not determined": {"low": None, "high": None},
    "every second one not determined": {"every": 2, "low": None, "high": None},
    "narrow": {"low": 0.012345, "high": 0.0123461},
    "of another record": {"record_low": 1e-3, "record_high": 0.2},
    "of another record, at most": {"record_low": 0.0, "record_high": 0.2},
    "of another record, open": {"record_low": 1e-3},
    "of another record, every second one": {"every": 2, "record_low": 1e-3, "record_high": 0.2},
    "of another record, which alone tells": {
        **{"low": None, "high": None},
        **{"record_low": 1e-3, "record_high": 0.2},
    },
}
TABLES = {name: with_taus(stored_with(make_table_result(name))) for name in ("so-rc", "esc")}
RESULTS = {
    "constant": STORED,
    "constants without intervals": with_constant(STORED, assessment=None),
}
RESULTS |= {
    f"{circuit}, {name}": with_ends(result, **ends)
    for circuit, result in TABLES.items()
    for name, ends in ENDS.items()
}
RESULTS |= {
    f"a sum, {name}": with_ends(with_sum(TABLES["so-rc"]), **ENDS[name])
    for name in ("as they are", "at most", "not determined", "of another record")
}


@pytest.fixture(params=RESULTS)
def result(request):
    return RESULTS[request.param]


Ends = tuple[float, float | None, float | None]


def expected(fit: TableFit) -> dict[tuple[str, float | None], Ends]:
    """Value and interval of every number that has one, by its label and SOC: where the spread of
    records is known, what another one would show of whatever goes over SOC."""
    over_soc = [*((own.name, own) for own in fit.intervals if own.soc is not None)]
    means = [*((f"mean {own.name}", own) for own in fit.means)]
    is_spread = any(own.record_low is not None for _, own in over_soc + means)
    ends = {
        (label, own.soc): (own.value, own.record_low, own.record_high)
        if is_spread
        else (own.value, own.low, own.high)
        for label, own in over_soc + means
    }
    constants = [own for own in fit.intervals if own.soc is None]
    return ends | {(own.name, None): (own.value, own.low, own.high) for own in constants}


def words(label: str, ends: Ends) -> tuple[str, str]:
    """A value and its interval as they are read."""
    name, (value, low, high) = label.removeprefix("mean "), ends
    shown = with_unit(name, value)
    return shown, without_unit(interval(name, low, high, value), shown)


every_table = pytest.mark.parametrize("name", [name for name in RESULTS if RESULTS[name].tables])


@every_table
def test_the_frame_and_the_csv_hold_every_number_with_its_interval(name):
    result = RESULTS[name]
    rows = {
        (row["table"], float(row["SOC"]) if row["SOC"] else None): row
        for row in csv.DictReader(tables_csv(result.fits).decode().splitlines())
    }
    frame = {row["SOC"]: row for row in result.to_frame().to_dicts()}
    for (label, soc), ends in expected(result.fit).items():
        row = rows[label, soc]
        assert [row["value"], row["low"], row["high"]] == [
            "" if end is None else repr(end) for end in ends
        ]
        here = next(iter(frame.values())) if soc is None else frame[soc]
        what, bracket, unit = label.partition(" [")
        for end, value in zip(("", " low", " high"), ends, strict=True):
            assert here[f"{what}{end}{bracket}{unit}"] == value
    without = rows.keys() - expected(result.fit).keys()
    assert all(rows[key]["low"] == rows[key]["high"] == "" for key in without)


def test_exports_hold_the_means_or_the_constants_with_their_ends_as_a_frame_does(result):
    content = get_exporter("csv").write(result).content.decode()
    values = {row["name"]: row["value"] for row in csv.DictReader(content.splitlines())}
    ends_of = expected(result.fit)
    if result.tables is None:
        rows = {row.pop("parameter"): (*row.values(),) for row in result.to_frame().to_dicts()}
        assessed = result.constant.assessment
        estimates = assessed.uncertainty.estimates if assessed else ()
        ends = {one.name: (one.value, one.low, one.high) for one in estimates}
        assert rows.items() >= ends.items()
        ends_of = {(f"mean {name}", None): ends[name] for name in ends if name.endswith("[Ohm]")}
    for (label, _), (value, low, high) in ends_of.items():
        if label.startswith("mean "):
            name = symbol(label if result.tables else label.removeprefix("mean "))
            assert values[name] == repr(value)
            assert values.get(f"{name} low", "None") == repr(low)
            assert values.get(f"{name} high", "None") == repr(high)


@every_table
def test_the_screen_the_report_and_results_side_by_side_say_the_same_words(name):
    result = RESULTS[name]
    rows = table("tables.headline", View(result)).rows
    on_screen = {row[0]: (row[1], row[2]) for row in rows}
    on_screen |= {row[4]: (row[5], row[6]) for row in rows if row[4]}
    means, constants, nodes = blocks("tables.answer", View(result))
    in_report = {(f"mean {row[0]}", None): row[1:] for row in means.rows}
    in_report |= {(row[0], None): row[1:] for row in constants.rows}
    heads = [column.head for column in nodes.columns]
    (beside,) = (
        table
        for section in barnax.show(result, result).document.sections
        for table in section.blocks
        if isinstance(table, ReportTable) and "change" in [column.head for column in table.columns]
    )
    compared = {row[0]: row[2] for row in beside.rows if row[1] == "–" or row[0][:4] == "mean"}
    sums = [label for label, _ in expected(result.fit) if " + " in label]
    for (label, soc), ends in expected(result.fit).items():
        value, ends_words = words(label, ends)
        if soc is not None:
            (row,) = (row for row in nodes.rows if row[0] == f"{100 * soc:g}")
            index = next(i for i, head in enumerate(heads) if head.startswith(symbol(label)))
            assert row[index + 1] == ends_words
            continue
        assert in_report[symbol(label), None] == (value, ends_words)
        assert compared[symbol(label)] == f"{value} ({ends_words})"
        is_part = any(label != total and symbol(label).split()[-1] in total for total in sums)
        if label in sums or not (is_part or (sums and label.startswith("tau"))):
            assert on_screen[symbol(label.removeprefix("mean "))] == (value, ends_words)
