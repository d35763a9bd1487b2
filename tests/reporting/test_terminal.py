"""What a terminal shows of tables, whole at any width, and of what is to be copied."""

from collections import Counter

import pytest
from rich.console import Console, Group
from rich.text import Text

from barnax.reporting.document import Bullets, Column, Document, Section, Table, make_table
from barnax.reporting.first_screen import first_screen
from barnax.reporting.terminal import bare_table, next_lines, terminal_table, to_terminal
from barnax.results import Result
from helpers.golden import RESULT


def lines_of(block, width):
    console = Console(width=width, color_system=None)
    with console.capture() as seen:
        console.print(block)
    lines = [line.rstrip() for line in seen.get().splitlines()]
    assert max(map(len, lines)) <= width
    return lines


def soc_table():
    """As wide as any: four tables over SOC, each with its interval."""
    cells = {"SOC [%]": lambda row: f"{10 + 5 * row}"}
    for name in ("R0", "R1", "R2", "R3"):
        cells[f"{name} [mOhm]"] = lambda row, name=name: f"{name[1]}{row}.4 (*)"
        cells[f"{name}, 95 %"] = lambda row, name=name: (
            "not determined" if row == 1 else f"8{row}.{name[1]} to 9{row}.{name[1]}"
        )
    return make_table("", range(5), cells)


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


def test_a_percentage_in_a_head_stays_in_one_line():
    heads = lines_of(terminal_table(soc_table()), 120)[:3]
    assert " ".join(heads).count("95 %") == 4


def test_only_a_very_long_word_goes_on_in_the_next_line():
    cells = {
        "parameter": lambda _: "tau1",
        "record": lambda _: 40 * "x",
        "RMSE": lambda _: "1.2345",
    }
    lines = lines_of(terminal_table(make_table("", [0], cells, ["parameter", "record"])), 44)
    assert any("parameter" in line and "RMSE" in line for line in lines)
    assert "".join(lines).count("x") == 40


@pytest.mark.parametrize("width", [60, 66, 72, 80])
def test_no_digit_of_the_first_screen_is_cut(width):
    whole, narrow = (
        " ".join(lines_of(Group(*first_screen(Result.from_json(RESULT))), each)).split()
        for each in (200, width)
    )
    numbers = {word for word in whole if any(map(str.isdigit, word))}
    assert len(numbers) > 10
    assert numbers <= {*narrow}


def test_what_is_to_be_copied_is_in_one_line():
    command = f"barnax identify {12 * 'drive.csv '}--out out"
    texts = [each for each in next_lines("do it", command) if isinstance(each, Text)]
    assert [each.no_wrap for each in texts if command in each.plain] == [True]


@pytest.mark.parametrize("width", [60, 72, 80])
def test_options_to_be_copied_stay_in_one_line_in_a_table_and_in_a_sentence(width):
    options = "--start-after-step 12 --columns 'current=I / A:mA'"
    heads = (Column("found", role="text"), Column("remedy", role="text"))
    table = Table("", heads, ((9 * "much text ", f"for all give {options}, so"),))
    told = Bullets((f"What is wrong: give {options} here.",))
    document = Document("", "", (Section("", (table, told)),))
    console = Console(width=width, color_system=None)
    with console.capture() as seen:
        for block in to_terminal(document):
            console.print(block, crop=False)
    assert sum(options in line for line in seen.get().splitlines()) == 2


def test_an_interval_stays_in_one_line_and_its_time_constant_below_where_there_is_no_room():
    rows = [
        ("half hysteresis", "4.3 mV", "0 to 13", "0.69 to 9.9", "", "", ""),
        ("R2", "18 mOhm", "not determined", "13.9 to 18.3", "tau2", "138 s", "2 min to 1.1 h"),
    ]
    heads = ["", "at 50 % SOC", "this record", "above 10 % SOC", "", "", ""]
    numbers = [place in (1, 5) for place in range(7)]
    lines = lines_of(bare_table(heads, rows, numbers, (5, 6)), 78)
    (low,) = (line for line in lines if "0 to 13" in line)
    assert low.endswith("0.69 to 9.9")
    assert lines[-1].split(maxsplit=2) == ["R2", "tau2", "138 s  2 min to 1.1 h"]
