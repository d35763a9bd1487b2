"""The lines of a fleet: its progress and its end."""

from barnax.fleet import FleetCell, Progress
from barnax.reporting.fleet import problem_lines
from barnax.reporting.wording import wording


def test_progress_is_the_throughput_and_the_end_counts_what_was_done():
    state = Progress(finished=40, failed=2, skipped=3)
    assert wording("fleet.done", state, 20.0) == (
        "38 cells identified, 2 failed, 3 already done, in 20 s, 2.0 a second."
    )
    assert wording("fleet.done", Progress(skipped=5), 1.0) == (
        "Nothing to do: 5 already done; `retry` repeats what failed."
    )
    state = Progress(finished=30, failed=2)
    assert wording("fleet.progress", state, 20.0) == "1.5 cells a second, 2 failed"


def test_what_is_wrong_in_a_row_is_named_with_its_cell_and_column():
    cells = [
        FleetCell("a", missing=("x.csv does not exist",)),
        FleetCell("b", window={"initial_soc": 95.0}, options={"model": "2rc"}),
        FleetCell("c", validate_window={"initial_soc": 95.0}),
        FleetCell("d", window={"initial_soc": 0.9}, options={"model": "1rc"}),
    ]
    missing, soc, circuit, of_validation = problem_lines(cells, {})
    assert missing == "a: x.csv does not exist"
    assert soc.startswith("b: initial_soc 95.0 is not a fraction")
    assert circuit.startswith("b: model '2rc' is not known; there are iso-rc, so-rc")
    assert of_validation.startswith("c: initial_soc 95.0")
