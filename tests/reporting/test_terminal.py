"""What a terminal shows of tables, whole at any width, and of what is to be copied."""

from collections import Counter

import pytest
from rich.console import Console

from barnax.reporting.document import ReportTable, column
from barnax.reporting.first_screen import first_screen
from barnax.reporting.terminal import terminal_table, to_terminal
from barnax.results import Result
from helpers.golden import RESULT


def lines_of(block, width):
    console = Console(width=width, color_system=None)
    with console.capture() as seen:
        console.print(block)
    lines = [line.rstrip() for line in seen.get().splitlines()]
    assert max(map(len, lines)) <= width
    return lines


def table_of(heads, rows, texts=()):
    columns = tuple(column(head, "text" if head in texts else "number") for head in heads)
    return ReportTable("", columns, tuple(map(tuple, rows)))


def soc_table():
    """As wide as any: four tables over SOC, each with its interval."""
    heads, rows = ["SOC [%]"], [[f"{10 + 5 * row}"] for row in range(5)]
    for name in range(4):
        heads += [f"R{name} [mOhm]", f"R{name}, 95 %"]
        for row, cells in enumerate(rows):
            ends = "not determined" if row == 1 else f"8{row}.{name} to 9{row}.{name}"
            cells += [f"{name}{row}.4 (*)", ends]
    return table_of(heads, rows)


@pytest.mark.parametrize("width", range(60, 121))
def test_no_digit_of_a_table_is_cut_at_any_width(width):
    table = soc_table()
    seen = Counter(word for line in lines_of(terminal_table(table), width) for word in line.split())
    wanted = Counter(word for row in table.rows for cell in row[1:] for word in cell.split())
    assert {word: seen[word] for word in wanted} == wanted
    assert all(seen[row[0]] >= 1 for row in table.rows)


def test_a_value_stays_beside_its_interval_and_its_state_of_charge():
    lines = lines_of(terminal_table(soc_table()), 60)
    (line,) = (line for line in lines if "80.3 to 90.3" in line)
    assert line.split()[0] == "10"
    assert line.endswith("30.4 (*)    80.3 to 90.3")


def test_columns_below_have_all_that_names_their_row():
    heads = ["first", "second", *(f"difference {number} [mV]" for number in range(5))]
    rows = [["ibmo", other, *["-123.456"] * 5] for other in ("varpro", "lm")]
    lines = lines_of(terminal_table(table_of(heads, rows, heads[:2])), 60)
    named = [line.split()[:2] for line in lines if "-123.456" in line]
    assert named == [["ibmo", "varpro"], ["ibmo", "lm"]] * 2


def test_a_long_name_breaks_behind_its_separators():
    rows = [["dst_25degC_80soc_SP20-2.parquet", *["1.234"] * 6]]
    table = table_of(["record", *"abcdef"], rows, ["record"])
    first = [
        line.split()[0]
        for line in lines_of(terminal_table(table), 62)
        if "_" in line or "pa" in line
    ]
    assert "".join(first) == rows[0][0]
    assert all(part.endswith(("_", "-", ".", "parquet")) for part in first)
    assert len(first) > 1


@pytest.mark.parametrize("width", [60, 66, 72, 80])
def test_no_digit_of_the_first_screen_is_cut(width):
    whole, narrow = (
        " ".join(lines_of(to_terminal(first_screen(Result.from_json(RESULT))), each)).split()
        for each in (200, width)
    )
    numbers = {word for word in whole if any(map(str.isdigit, word))}
    assert len(numbers) > 10
    assert numbers <= {*narrow}
