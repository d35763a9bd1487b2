"""Tables and the verdict of a comparison, for a terminal."""

from collections.abc import Mapping

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from .comparison import ComparisonResult
from .reporting import document
from .reporting.comparison_report import comparison_document
from .reporting.comparison_tables import (
    bands_table,
    errors_table,
    failures_table,
    parameters_table,
    search_table,
)
from .reporting.comparison_view import answered, records
from .table_layout import LAYOUT


def comparison_report(
    result: ComparisonResult, seconds: Mapping[str, float] | None = None
) -> list[RenderableType]:
    """Parameters, searches, errors on every record and by SOC, failures, and the verdict.

    The tables are those of the report; differences between rows stand only there.
    """
    blocks: list[RenderableType] = []
    if answered(result):
        blocks += [
            _table("Parameters, unrefined", parameters_table(result)),
            _table("Searches", search_table(result, seconds)),
        ]
        for place, name in enumerate(records(result)):
            blocks += [
                _table(f"Errors on {name}", errors_table(result, place)),
                _table(f"Errors on {name} by state of charge", bands_table(result, place)),
            ]
    if any(row.failure for row in result.rows):
        blocks.append(_table("Without an answer", failures_table(result)))
    return [*blocks, *_verdict(result)]


def _table(title: str, table: document.Table) -> Table:
    """A report's table as rich prints it."""
    shown = Table(title=escape(title), **LAYOUT)
    for column in table.columns:
        head = f"{column.name}\n[{column.unit}]" if column.unit else column.name
        shown.add_column(
            escape(head),
            justify="right" if column.role == "number" else "left",
            overflow="fold",
        )
    for place, row in enumerate(table.rows):
        shown.add_row(
            *(
                Text(cell, style="bold" if (place, index) in table.best else "")
                for index, cell in enumerate(row)
            )
        )
    return shown


def _verdict(result: ComparisonResult) -> list[RenderableType]:
    sections = comparison_document(result).sections
    return [
        Text(f"- {sentence}")
        for section in sections
        if section.title == "Verdict"
        for block in section.blocks
        if isinstance(block, document.Bullets)
        for sentence in block.items
    ]
