"""A number of a result is the same in every digit, whoever prints it."""

import csv
import io
from dataclasses import replace

import pytest
from rich.console import Console, Group

import barnax
from barnax.export import get_exporter
from barnax.over_soc.node_interval import NodeInterval
from barnax.plots.soc_tables import drawn_tables
from barnax.reporting.first_screen import first_screen
from barnax.reporting.identification import identification_document
from barnax.reporting.parameters import tables_csv
from barnax.reporting.render import to_markdown
from barnax.reporting.soc_tables import answer_tables, headline
from barnax.reporting.terminal import to_terminal
from barnax.reporting.view import View
from barnax.reporting.words import figures, symbol, with_unit
from barnax.results import Result
from helpers.golden import RESULT
from helpers.results import make_table_result, with_constant

STORED = Result.from_json(RESULT)


def stored_with(tables: Result) -> Result:
    """The stored result with the tables of one made by hand."""
    return STORED.model_copy(update={"tables": tables.tables, "model": tables.model})


def told(result: Result, **ends: float | None) -> Result:
    """The same with other ends of every interval."""

    def changed(own: NodeInterval) -> NodeInterval:
        return replace(own, **ends)

    fits = tuple(
        replace(
            fit, intervals=tuple(map(changed, fit.intervals)), means=tuple(map(changed, fit.means))
        )
        for fit in result.fits
    )
    return result.model_copy(update={"tables": replace(result.fits, fits=fits)})


TABLES = {name: stored_with(make_table_result(name)) for name in ("so-rc", "esc")}
ENDS = {
    "as they are": {},
    "at most": {"low": 0.0},
    "at most, without the other end": {"low": None},
    "at least": {"high": None},
    "not determined": {"low": None, "high": None},
    "of another record": {"record_low": 1e-3, "record_high": 0.2},
    "of another record, open": {"record_low": 1e-3},
}
RESULTS = {
    "constant": STORED,
    "constants without intervals": with_constant(STORED, assessment=None),
} | {
    f"{circuit}, {name}": told(result, **ends)
    for circuit, result in TABLES.items()
    for name, ends in ENDS.items()
}


@pytest.fixture(params=RESULTS)
def result(request):
    return RESULTS[request.param]


def exported(result: Result) -> dict[str, str]:
    content = get_exporter("csv").write(result).content.decode()
    return {row["name"]: row["value"] for row in csv.DictReader(content.splitlines())}


def test_the_frame_and_the_csv_hold_every_fact(result):
    frame = result.to_frame()
    if result.tables is None:
        rows = {row["parameter"]: row for row in frame.to_dicts()}
        estimates = result.constant.estimates.items()
        for name, own in estimates:
            assert (rows[name]["value"], rows[name]["low"]) == (own.value, own.low)
        return
    rows = list(csv.DictReader(tables_csv(result.fits).decode().splitlines()))
    by_soc = {row["SOC"]: row for row in frame.to_dicts()}
    for fact, row in zip(result.fit.facts, rows, strict=True):
        told = ["" if end is None else repr(end) for end in (fact.value, fact.low, fact.high)]
        assert [row["table"], row["value"], row["low"], row["high"]] == [fact.label, *told]
        here = frame.row(0, named=True) if fact.soc is None else by_soc[fact.soc]
        assert here[fact.label] == fact.value


def test_exports_hold_the_means_or_the_constants_with_their_ends(result):
    values = exported(result)
    for fact in result.fit.facts:
        name = symbol(fact.label) if result.tables else symbol(fact.name)
        if fact.is_mean and " + " not in name:
            assert values[name] == repr(fact.value)
            assert values.get(f"{name} low", "None") == repr(fact.low)
            assert values.get(f"{name} high", "None") == repr(fact.high)


def test_the_screen_the_report_and_results_side_by_side_say_the_same(result):
    console = Console(file=io.StringIO(), width=200, color_system=None)
    console.print(Group(*to_terminal(first_screen(result))))
    screen = console.file.getvalue().split("\n")
    report = to_markdown(identification_document(result)).split("\n")
    beside = repr(barnax.show(result, result)).split("\n")
    for fact in result.fit.facts:
        if not fact.is_mean:
            continue
        name, value = symbol(fact.name), with_unit(fact.name, fact.value)
        (line,) = (line for line in screen if line.split()[:1] == [name])
        assert f"{name}  {value}" in " ".join(line.split(" " * 3)) or value in line
        if result.tables is None:
            row = next(row for row in report if row.startswith(f"| {name} [mOhm]"))
            printed = float(row.split("|")[2])
            assert f"{figures(printed)} mOhm" == value
        else:
            assert any(row.startswith(f"| {name} ") and f"| {value}" in row for row in report)
        named = name if result.tables is None else f"mean {name}"
        assert any(line.split("  ")[0].strip() == named and value in line for line in beside)


@pytest.mark.parametrize("name", [name for name in RESULTS if "constant" not in name])
def test_the_intervals_of_means_and_constants_are_the_same_on_screen_and_in_the_report(name):
    result = RESULTS[name]
    _, rows = headline(View(result))
    on_screen = {row[0]: row[2] for row in rows} | {row[4]: row[6] for row in rows if row[4]}
    means, constants, _ = answer_tables(result.fits)
    for symbol_, value, in_report in (*means.rows, *constants.rows):
        assert on_screen.get(symbol_, in_report).strip("–") == in_report.strip("–"), (
            symbol_,
            value,
        )


def test_not_determined_is_the_same_in_the_table_the_figure_and_the_csv(result):
    if result.tables is None:
        return
    _, _, nodes = answer_tables(result.fits)
    drawn = drawn_tables(result.fit)
    rows = list(csv.DictReader(tables_csv(result.fits).decode().splitlines()))
    are_of_another = "another record" in nodes.caption
    for place, name in enumerate(result.fit.tables.tables):
        words = [row[2 + 2 * place] for row in nodes.rows]
        table = drawn[name].seen.nodes
        ends = [row for row in rows if row["table"] == name and row["visited"] == "1"]
        for said, node, row in zip(words, table, ends, strict=True):
            is_open = (row["low"], row["high"]) == ("", "")
            assert node["is_open"] == is_open
            assert are_of_another or (said == "not determined") == is_open
