"""Text, tables and code as Markdown that reads well as it stands."""

import re
import unicodedata

from .document import Table

# Special wherever they stand: a bracket only where a link could follow, an underscore only at
# the edge of a word, for units and names of files are full of them.
SPECIAL = re.compile(r"[\\`*<|~$]|\](?=[(\[:])|(?<![^\W_])_|_(?![^\W_])")
# What begins a list, a heading, a quotation or a rule at the start of a line.
LEADING = re.compile(r"^(\d*)(>|[-+.)=#](?=[\s=#>-]|$))")
FENCE = "```"


def escape_markdown(text: str) -> str:
    """Text that no Markdown reader takes for markup, on one line.

    >>> print(escape_markdown("a_b.csv [mV] | *c*"))
    a_b.csv [mV] \\| \\*c\\*
    """
    escaped = SPECIAL.sub(r"\\\g<0>", " ".join(text.split())).replace("&", "&amp;")
    return LEADING.sub(r"\1\\\2", escaped)


def code_block(text: str) -> str:
    """Text between fences that are longer than any in it."""
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    fence = "`" * max(len(FENCE), longest + 1)
    return f"{fence}\n{text}\n{fence}"


def table_lines(table: Table) -> str:
    """A table whose columns are aligned in the source too."""
    head = [escape_markdown(column.head) for column in table.columns]
    body = [
        [
            f"**{escape_markdown(cell)}**" if (row, place) in table.best else escape_markdown(cell)
            for place, cell in enumerate(cells)
        ]
        for row, cells in enumerate(table.rows)
    ]
    is_number = [column.role == "number" for column in table.columns]
    widths = [
        max(3, *(_width(line[place]) for line in [head, *body])) for place in range(len(head))
    ]
    rule = [
        "-" * (width - 1) + ":" if right else "-" * width
        for width, right in zip(widths, is_number, strict=True)
    ]
    lines = [
        " | ".join(
            _padded(cell, width, right)
            for cell, width, right in zip(cells, widths, is_number, strict=True)
        )
        for cells in [head, rule, *body]
    ]
    return "\n".join(f"| {line} |" for line in lines)


def _padded(cell: str, width: int, to_the_right: bool) -> str:
    blanks = " " * (width - _width(cell))
    return blanks + cell if to_the_right else cell + blanks


def _width(text: str) -> int:
    """Columns of a terminal: wide letters take two."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)
