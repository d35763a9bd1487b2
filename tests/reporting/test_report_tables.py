"""The tables of a comparison hold its numbers, in the units of their heads."""

import itertools

import pytest

from barnax.reporting.document import Column, Table
from barnax.reporting.tables import (
    bands_table,
    differences_table,
    errors_table,
    failures_table,
    methods_table,
    parameters_table,
    refined_table,
    search_table,
)
from barnax.search.refine import AtBound
from sample_comparisons import CITY, make_comparison, make_difference, make_failure, make_row

UPPER = AtBound("R0 [Ohm]", "upper")


def heads(table):
    return [column.head for column in table.columns]


def test_parameters_stand_pair_by_pair_with_what_not_every_model_has_last():
    table = parameters_table(
        make_comparison([make_row("lm so-rc", 1.0), make_row("lm esc", 1.0, at_bound=(UPPER,))])
    )
    assert heads(table) == [
        "row",
        "R0 [mOhm]",
        "R1 [mOhm]",
        "C1 [F]",
        "tau1 [s]",
        "R2 [mOhm]",
        "C2 [F]",
        "tau2 [s]",
        "gamma [1/SOC]",
    ]
    assert table.rows == (
        ("lm so-rc", "50", "10", "1000", "10", "20", "5000", "100", "–"),
        ("lm esc", "50", "10", "1000", "10", "20", "5000", "100", "300"),
    )
    assert table.caption.endswith("not refined. R0 at its upper bound in lm esc.")


def test_refined_parameters_stand_with_the_error_they_give():
    rows = [make_row("lm so-rc", 1.0, refined_rmse_v=0.0195)]
    rows.append(make_row("ls so-rc", 1.0, refined_parameters=None, refined_rmse_v=None))
    table = refined_table(make_comparison(rows))
    assert [row[0] for row in table.rows] == ["lm so-rc"]
    assert (heads(table)[-1], table.rows[0][-1]) == ("RMSE [mV]", "19.500")


def test_the_lowest_error_is_the_one_to_be_read_first():
    rows = [make_row("a so-rc", 22.0, 9.0), make_row("b so-rc", 21.0, 10.0)]
    table = errors_table(make_comparison(rows), 0)
    assert heads(table)[1:] == [
        "RMSE [mV]",
        "R2",
        "R2 (paper)",
        "MAPE [%]",
        "CE [V]",
        "max [mV]",
        "samples",
    ]
    assert table.rows[1] == (
        "b so-rc",
        "21.000",
        "0.9900",
        "0.9910",
        "0.400",
        "12.30",
        "160.0",
        "1000",
    )
    assert table.best == {(1, 1)}
    assert errors_table(make_comparison(rows), 1).best == {(0, 1)}


def test_the_search_table_holds_the_spread_the_gap_and_the_time():
    rows = [make_row("a so-rc", 20.0, optimality_gap=0.021, refined_rmse_v=0.0199)]
    rows.append(make_row("b so-rc", 20.0, seeds=1, spread=None, evaluations=None))
    table = search_table(make_comparison(rows), {"a so-rc": 1.234})
    assert table.rows == (
        ("a so-rc", "20.000", "20.000", "20.400", "1.000", "2.1", "19.900", "3", "300", "1.23"),
        ("b so-rc", "20.000", "–", "–", "–", "–", "20.000", "1", "–", "–"),
    )
    assert heads(table)[-1] == "time [s]"
    assert heads(search_table(make_comparison(rows)))[-1] == "evaluations"


def test_bands_without_a_sample_have_no_column():
    table = bands_table(make_comparison([make_row("a so-rc", 20.0)]), 0)
    assert heads(table) == [
        "row",
        "0–10 % RMSE [mV]",
        "0–10 % mean [mV]",
        "20–100 % RMSE [mV]",
        "20–100 % mean [mV]",
    ]
    assert table.rows == (("a so-rc", "40.000", "-20.000", "20.000", "1.000"),)
    assert "Samples: 100 in 0–10 % and 900 in 20–100 %." in table.caption


def test_differences_stand_with_their_interval_and_the_seeds():
    rows = [make_row("a so-rc", 20.0), make_row("b so-rc", 22.0), make_row("c so-rc", 22.0)]
    differences = [
        make_difference("a so-rc", "b so-rc", (-3.0, -1.0), seeds=(3, 0, 0.25)),
        make_difference("b so-rc", "c so-rc", (-1.0, 1.0), is_capped=True),
        make_difference("a so-rc", "c so-rc", (-3.0, -1.0), record=CITY),
    ]
    table = differences_table(make_comparison(rows, differences), 0)
    assert table.rows == (
        ("a so-rc", "b so-rc", "-2.000", "-3.000", "-1.000", "yes", "3–0", "0.25"),
        ("b so-rc", "c so-rc", "0.000", "-1.000", "1.000", "no†", "–", "–"),
    )
    assert "†: the residuals stay correlated longer than a block" in table.caption


def test_of_very_many_pairs_only_those_asked_for_are_shown():
    names = [f"{method} {model}" for method in "abcd" for model in ("so-rc", "iso-rc")]
    rows = [make_row(name, 20.0 + place) for place, name in enumerate(names)]
    differences = [
        make_difference(*pair, (-2.0, -1.0)) for pair in itertools.combinations(names, 2)
    ]
    table = differences_table(make_comparison(rows, differences), 0)
    shown = {row[:2] for row in table.rows}
    with_leader = {("a so-rc", name) for name in names[1:]}
    of_one_method = {(f"{method} so-rc", f"{method} iso-rc") for method in "abcd"}
    assert shown == with_leader | of_one_method
    assert "Shown are the pairs with the leader" in table.caption


def test_methods_stand_once_with_their_source():
    rows = [make_row("lm so-rc", 1.0), make_row("lm iso-rc", 1.0)]
    assert methods_table(make_comparison(rows)).rows == (("lm", "made by hand"),)


def test_rows_without_an_answer_stand_apart():
    rows = [make_row("lm so-rc", 1.0), make_failure("rls so-rc", "No circuit.")]
    result = make_comparison(rows)
    assert failures_table(result).rows == (("rls so-rc", "No circuit."),)
    assert [row[0] for row in parameters_table(result).rows] == ["lm so-rc"]


def test_a_table_whose_rows_do_not_fit_its_columns_is_refused():
    with pytest.raises(ValueError, match="a row of 2 cells under 1 columns"):
        Table("", (Column("one"),), (("1", "2"),))
