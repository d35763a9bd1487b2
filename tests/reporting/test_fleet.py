"""The lines of a fleet: its progress and its end."""

from barnax.fleet import Progress
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
