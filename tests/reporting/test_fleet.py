"""The lines of a fleet: its progress and its end."""

from pathlib import Path

from barnax.fleet import FleetCell, Progress
from barnax.reporting.fleet import closing_lines, problem_lines


def test_the_end_is_three_lines_that_count_what_was_done():
    state = Progress(finished=40, failed=2, skipped=3)
    assert closing_lines(state, Path("out"), 20.0) == [
        "38 cells identified, 2 failed, 3 already done, in 20 s, 2.0 a second.",
        "",
        "out/report.html   cells.parquet",
    ]
    assert (
        "the same command without it writes the report"
        in (closing_lines(state, Path("out"), 20.0, "3/10")[1])
    )
    assert closing_lines(Progress(skipped=5), Path("out"), 1.0)[0] == (
        "Nothing to do: 5 already done; `retry` repeats what failed."
    )


def test_what_is_wrong_in_a_row_is_named_with_its_cell_and_column():
    cells = [
        FleetCell("a", missing=("x.csv does not exist",)),
        FleetCell("b", window={"initial_soc": 95.0}, options={"model": "2rc"}),
        FleetCell("c", validate_window={"initial_soc": 95.0}),
        FleetCell("d", window={"initial_soc": 0.9}, options={"model": "1rc"}),
    ]
    missing, soc, circuit, of_validation = problem_lines(cells)
    assert missing == "a: x.csv does not exist"
    assert soc.startswith("b: initial_soc 95.0 is not a fraction")
    assert circuit.startswith("b: model '2rc' is not known; there are iso-rc, so-rc")
    assert of_validation.startswith("c: initial_soc 95.0")
