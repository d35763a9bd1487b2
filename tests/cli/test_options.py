"""Options: what messages call them, that there are all of them, and those of one record."""

import re
from pathlib import Path

import pytest
from typer.main import get_command

import barnax
from barnax.cli.app import app
from barnax.cli.options import windows_of
from barnax.cli.session import as_flags
from barnax.errors import InputError
from barnax.model.window import Window

SOURCES = [path for path in Path(barnax.__file__).parent.rglob("*.py") if "plots" not in path.parts]
# An option in a message, with its value if it has one.
NAMED = re.compile(r"`([a-z][a-z_]*)(?:=[^`]*)?`")


def strings_of(path: Path) -> str:
    """A module's code without its docstrings and comments."""
    text = re.sub(r'"""[\s\S]*?"""', "", path.read_text(encoding="utf-8"))
    return "\n".join(
        line.partition("  # ")[0] for line in text.splitlines() if "# " not in line[:8]
    )


def test_every_option_that_a_message_names_exists():
    commands = get_command(app).commands.values()
    flags = {flag for command in commands for each in command.params for flag in each.opts}
    named = {name for path in SOURCES for name in NAMED.findall(strings_of(path))}
    assert {"initial_soc", "capacity", "ocv", "out"} <= named
    assert {as_flags(f"`{name}`") for name in named} <= flags


@pytest.mark.parametrize(
    ("text", "spelled"),
    [
        ("give `initial_soc=0.9`", "give --initial-soc 0.9"),
        ("`current_sign='charge-positive'` or `ocv`", "--current-sign charge-positive or --ocv"),
        ("a`b and `C1 [F]`", "a`b and `C1 [F]`"),
    ],
)
def test_a_message_is_spelled_for_who_reads_it(text, spelled):
    assert as_flags(text) == spelled


def test_a_record_s_own_start_replaces_the_common_one():
    given = {"start_time": ["60"], "initial_soc": ["0.9"], "score_to": ["900"]}
    assert windows_of({**given, "start_after_step": ["b.csv=3"]}) == {
        "": Window(start_time_s=60.0, initial_soc=0.9, score_to_s=900.0),
        "b.csv": Window(start_after_step=3, initial_soc=0.9, score_to_s=900.0),
    }


def test_what_contradicts_itself_is_refused_by_the_name_of_its_record():
    given = {"start_time": ["b.csv=60"], "start_after_step": ["b.csv=3"]}
    with pytest.raises(InputError, match=r"^b\.csv: give `start_time` or `start_after_step`"):
        windows_of(given)
