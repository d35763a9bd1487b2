"""Who leads on each record, said only as firmly as the intervals allow."""

import pytest

from barnax.reporting.comparison_sentences import ranking_sentences
from sample_comparisons import DRIVE, make_comparison, make_difference, make_row


def told(*rows, differences=()):
    return list(ranking_sentences(make_comparison(rows, differences)))


def test_the_lowest_error_is_named_with_its_row():
    (first, _) = told(make_row("bmo so-rc", 25.0), make_row("pso so-rc", 23.0))
    assert first.startswith(
        "On drive.csv, the identification record, pso so-rc has the lowest RMSE, 23.00 mV."
    )


def test_a_lead_whose_interval_leaves_out_zero_is_more_than_chance():
    difference = make_difference("pso so-rc", "bmo so-rc", (-3.0, -1.0), seeds=(28, 2, 0.001))
    rows = make_row("bmo so-rc", 25.0), make_row("pso so-rc", 23.0)
    assert (
        "The lead of 2.00 mV over the next, bmo so-rc, is significant: its 95 % interval "
        "over time, 1.00 to 3.00 mV, excludes zero. Seed by seed, it wins 28 times and loses 2 "
        "times (Wilcoxon signed-rank p = 0.001)."
    ) in told(*rows, differences=[difference])[0]


def test_the_order_in_which_a_difference_is_stored_does_not_matter():
    rows = make_row("bmo so-rc", 25.0), make_row("pso so-rc", 23.0)
    one = make_difference("pso so-rc", "bmo so-rc", (-3.0, -1.0), seeds=(28, 2, 0.001))
    other = make_difference("bmo so-rc", "pso so-rc", (1.0, 3.0), seeds=(2, 28, 0.001))
    assert told(*rows, differences=[one]) == told(*rows, differences=[other])


def test_a_lead_whose_interval_holds_zero_is_no_more_than_chance():
    difference = make_difference("pso so-rc", "bmo so-rc", (-3.0, 1.0))
    rows = make_row("bmo so-rc", 24.0), make_row("pso so-rc", 23.0)
    (first, _) = told(*rows, differences=[difference])
    assert "is not significant: its 95 % interval over time, -1.00 to 3.00 mV, includes" in first
    assert "Seed by seed" not in first


def test_an_interval_that_is_too_narrow_is_doubted():
    difference = make_difference("pso so-rc", "bmo so-rc", (-3.0, -1.0), is_capped=True)
    rows = make_row("bmo so-rc", 25.0), make_row("pso so-rc", 23.0)
    assert "so the interval is too narrow)." in told(*rows, differences=[difference])[0]


def test_a_lead_that_was_not_tested_is_only_stated():
    (first, _) = told(make_row("bmo so-rc", 25.0), make_row("pso so-rc", 23.0))
    assert first.endswith("The next is bmo so-rc, with 2.00 mV more.")


def test_the_other_rows_are_worse_or_cannot_be_told_apart():
    rows = [
        make_row(f"{name} so-rc", error) for name, error in zip("abcd", (1, 2, 3, 4), strict=True)
    ]
    differences = [
        make_difference("a so-rc", "b so-rc", (-2.0, -0.5)),
        make_difference("a so-rc", "c so-rc", (-5.0, 0.5)),
        make_difference("d so-rc", "a so-rc", (2.0, 4.0)),
    ]
    (first, _) = told(*rows, differences=differences)
    assert "c so-rc is not significantly different either." in first
    assert first.endswith("d so-rc is significantly worse.")


def test_rows_that_found_the_same_share_the_lead():
    (first, _) = told(make_row("lm so-rc", 23.0), make_row("varpro so-rc", 23.0 * (1 + 1e-7)))
    assert first.endswith("lm so-rc and varpro so-rc have the lowest RMSE, 23.00 mV.")


def test_a_leader_that_does_not_lead_on_another_record_is_told_its_place():
    rows = [make_row("a so-rc", 20.0, 30.0), make_row("b so-rc", 21.0, 10.0)]
    _, second = told(*rows)
    assert second.startswith(
        "On city.csv, a validation record, b so-rc has the lowest RMSE, 10.00 mV. "
        "a so-rc, the best in identification, is number 2 of 2 with 30.00 mV."
    )


def test_a_leader_that_leads_everywhere_is_told_no_place():
    rows = [make_row("a so-rc", 20.0, 10.0), make_row("b so-rc", 21.0, 30.0)]
    assert "number" not in told(*rows)[1]


def test_without_a_record_to_validate_on_nothing_is_claimed_of_others():
    assert told(make_row("a so-rc", 20.0))[-1].startswith("There is no validation record")
    assert "no validation record" not in " ".join(told(make_row("a so-rc", 20.0, 10.0)))


def test_a_single_row_has_nothing_to_be_compared_with():
    assert told(make_row("a so-rc", 20.0))[0] == (
        f"On {DRIVE}, the RMSE of a so-rc is 20.00 mV; there is no other row to compare with."
    )


@pytest.mark.parametrize("record", ["drive.csv", "city.csv"])
def test_differences_of_one_record_are_not_told_of_another(record):
    rows = [make_row("a so-rc", 20.0, 10.0), make_row("b so-rc", 21.0, 30.0)]
    sentences = told(
        *rows, differences=[make_difference("a so-rc", "b so-rc", (-3, -1), record=record)]
    )
    has_interval = ["interval" in sentence for sentence in sentences]
    assert has_interval == [record == "drive.csv", record == "city.csv"]
