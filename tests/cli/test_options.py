"""Options: what messages call them, that there are all of them, and those of one record."""

import re
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import barnax
from barnax import Notice, Window
from barnax.cli.app import app
from barnax.cli.options import windows_of
from barnax.cli.session import RESEARCH, Session, as_flags
from barnax.job import PLANNED

# Figures and optimizers are called from Python alone.
SOURCES = [
    path
    for path in Path(barnax.__file__).parent.rglob("*.py")
    if not {"plots", "optimizers"} & {*path.parts}
]
# An option in a message, with its value if it has one.
NAMED = re.compile(r"`([a-z][a-z_]*)(?:=[^`]*)?`")


def strings_of(path: Path) -> str:
    """A module's code without its docstrings and comments."""
    text = re.sub(r'"""[\s\S]*?"""', "", path.read_text(encoding="utf-8"))
    return "\n".join(
        line.partition("  # ")[0] for line in text.splitlines() if "# " not in line[:8]
    )


COMMANDS = get_command(app).commands


def test_every_option_that_a_message_names_exists():
    flags = {flag for each in COMMANDS.values() for own in each.params for flag in own.opts}
    named = {name for path in SOURCES for name in NAMED.findall(strings_of(path))}
    assert {"initial_soc", "capacity", "ocv", "out"} <= named
    assert {as_flags(f"`{name}`") for name in named - RESEARCH} <= flags
    # What a message tells to put in a plan is a key of one, and no option.
    assert {*PLANNED} >= RESEARCH
    assert not {as_flags(f"`{name}`").split()[0] for name in RESEARCH} & flags


def helped(*words):
    lines = CliRunner().invoke(app, [*words]).output.splitlines()
    return lines, {re.split("[ ,/]", line[2:])[0] for line in lines if line.startswith("  -")}


@pytest.mark.parametrize("command", [*COMMANDS, ""])
def test_help_is_one_screen_and_all_of_it_names_every_option_whole(command):
    lines, usual = helped(*filter(None, [command]), "--help")
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert not [line for line in lines[1:] if line.endswith("...") or "…" in line]
    if command:
        lines, every = helped(command, "--help-all")
        assert max(map(len, lines)) <= 80
        own = [each for each in COMMANDS[command].params if each.param_type_name == "option"]
        assert every - {"--help"} == {each.opts[0] for each in own}
        assert usual <= every


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


def test_a_value_for_one_record_replaces_the_common_one():
    given = {"start_time": ["60"], "initial_soc": ["0.9"], "score_to": ["900", "b.csv=800"]}
    assert windows_of({**given, "start_after_step": ["b.csv=3"]}) == {
        "": Window(start_time_s=60.0, initial_soc=0.9, score_to_s=900.0),
        "b.csv": Window(start_after_step=3, initial_soc=0.9, score_to_s=800.0),
    }


def test_a_long_stage_says_without_a_terminal_how_much_time_is_left(capsys):
    waits = iter([False, False, True])
    task, ended = SimpleNamespace(elapsed=20.0, completed=1, total=4), SimpleNamespace()
    ended.wait = lambda seconds: next(waits)
    Session(is_quiet=False)._report("Searching", task, ended)
    assert capsys.readouterr().err == 2 * "Searching: 0:00:20, 1 of 4, about 0:01:00 left\n"


def test_only_a_command_that_is_not_quiet_reports_a_long_stage(capsys, monkeypatch):
    monkeypatch.setattr("barnax.cli.session.PATIENCE_S", 0.01)
    for is_quiet in (True, False):
        with Session(is_quiet).watch("Searching"):
            time.sleep(0.5)
        assert ("Searching: " in capsys.readouterr().err) == (not is_quiet)


def test_what_was_assumed_of_a_file_is_a_note_among_warnings_too(capsys):
    merged = Notice("repeats.merged", {"rows": 3, "alike": "exact"}, "a.csv")
    Session(is_quiet=False).warn([merged, merged.rated("warning")])
    kinds = [line.split()[0] for line in capsys.readouterr().err.splitlines()]
    assert kinds == ["warning:", "note:"]
