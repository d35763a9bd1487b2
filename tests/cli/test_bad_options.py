"""Options that cannot be used: exit status 2, a message to act on, nothing written."""

import pytest

from barnax.bundled import BUNDLED

from .conftest import BUDGET, OCV


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("--method", "nope"), ("--method 'nope'", "ibmo-printed, ibmo-centered, bmo")),
        (("--model", "nope"), ("--model 'nope'", "iso-rc, so-rc")),
        (("--score-from", "2000"), ("--score-to 1500.0 s must come after --score-from 2000.0 s",)),
        (("--score-from", "1e9", "--score-to", "2e9"), ("identification.parquet", "widen")),
        (("--score-steps", "7;8"), ("--score-steps '7;8'", "write step numbers, such as 7,8")),
        (("--score-steps", "7"), ("identification.parquet", "step column", "--score-from")),
        (("--start-after-step", "3"), ("identification.parquet", "step column", "--start-time")),
        (("--start-time", "-5"), ("identification.parquet", "clock runs from 0 to 19679 s")),
        (("--start-time", "5", "--start-after-step", "3"), ("not both",)),
        (("--start-time", "700"), ("identification.parquet", "row ", "give --initial-soc")),
        (("--initial-soc", "80"), ("--initial-soc 80.0", "from 0 (empty) to 1 (full)")),
        (("--initial-direction", "0"), ("--initial-direction 0", "+1", "-1")),
        (("--rest-current", "-1"), ("--rest-current -1.0 A must be positive",)),
        (("--rest-current", "50"), ("ocv_charge.parquet", "a lower --rest-current")),
        (("--capacity", "-2"), ("capacity must be positive, in Ah; -2.0",)),
        (("--capacity", "nan"), ("capacity must be positive, in Ah; nan",)),
        (("--fix", "C1 [F]"), ("--fix 'C1 [F]'", 'such as "C1 [F]=500"')),
        (("--fix", "C1 [F]=lots"), ("--fix 'C1 [F]=lots'", 'such as "C1 [F]=500"')),
        (("--fix", "R9 [Ohm]=1"), ("'R9 [Ohm]' is not a parameter", "R0 [Ohm], R1 [Ohm]")),
        (("--fix", "R0 [Ohm]=-1"), ("'R0 [Ohm]' cannot be fixed at -1.0", "positive")),
        (("--fix", "C1 [F]=5", "--fix", "tau1 [s]=5"), ("'tau1 [s]' or 'C1 [F]', not both",)),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_an_unusable_option_is_refused_with_a_remedy(refuse, words, parts):
    message = refuse("identify", *BUDGET, *words)
    assert message.startswith("error: ")
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("words", "choices"),
    [
        (("--coordinates", "nope"), ("rc", "log")),
        (("--ocv-fit", "nope"), ("polynomial", "interpolated")),
        (("--hysteresis-fit", "nope"), ("continuous", "independent")),
        (("--current-sign", "nope"), ("charge-positive", "discharge-positive")),
        (("--current-hold", "nope"), ("forward", "backward")),
        (("--seeds", "0"), ("--seeds", "1")),
        (("--population", "2"), ("--population", "4")),
        (("--iterations", "x"), ("--iterations", "integer")),
        (("--key", "-1"), ("--key", "0")),
        (("--frce",), ("--frce", "--force")),
    ],
    ids=lambda value: value[0],
)
def test_what_the_parser_can_tell_is_a_usage_error_that_lists_the_choices(refuse, words, choices):
    message = refuse("identify", *BUDGET, *words)
    assert message.startswith("Usage: ")
    for choice in choices:
        assert choice in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('[bounds]\n"R0 [Ohm]" = [0.1, 0.01]', ("'R0 [Ohm]' are [0.1, 0.01]", "lower one smaller")),
        ('[bounds]\n"R7 [Ohm]" = [1, 2]', ("'R7 [Ohm]' is not a parameter", "R0 [Ohm], R1 [Ohm]")),
        ('[bounds]\n"R0 [Ohm]" = 0.1', ("'R0 [Ohm]' must be two numbers", "[lower, upper]")),
        ('[bounds]\n"R0 [Ohm]" = ["a", 1]', ("'R0 [Ohm]' must be two numbers",)),
        ('[bounds]\n"R0 [Ohm]" = [0.0, inf]', ("'R0 [Ohm]' are [0.0, inf]", "positive")),
        ('[bounds]\n"C1 [F]" = [1, 2]\n"tau1 [s]" = [1, 2]', ("'tau1 [s]' or 'C1 [F]', not both",)),
        ('[box]\n"R0 [Ohm]" = [1, 2]', ("must hold one table, [bounds]",)),
        ("[bounds\n", ("is not a TOML file", "line 1")),
        ("\x00\x01", ("is not a TOML file",)),
    ],
)
def test_unusable_bounds_are_refused_under_the_files_name(refuse, tmp_path, text, parts):
    (tmp_path / "box.toml").write_text(text)
    message = refuse("identify", *BUDGET, "--bounds", "box.toml")
    for part in ("box.toml", *parts):
        assert part in message


@pytest.mark.parametrize("name", ["absent.toml", "."])
def test_bounds_that_cannot_be_read_are_refused(refuse, name):
    assert f"{name}: cannot be read" in refuse("identify", *BUDGET, "--bounds", name)


def test_a_record_without_an_ocv_test_is_refused(refuse):
    message = refuse("identify", BUNDLED.record, *BUDGET)
    assert "identification.parquet: an OCV test of the same cell is needed" in message
    assert "--ocv" in message


@pytest.mark.parametrize("words", [OCV, ("--validate", BUNDLED.validation)])
def test_files_without_a_record_are_refused(refuse, words):
    assert "give a RECORD to identify on" in refuse("identify", *words, *BUDGET)


def test_no_command_at_all_shows_the_help(run):
    outcome = run()
    assert outcome.status == 2
    assert "identify" in outcome.out + outcome.err
