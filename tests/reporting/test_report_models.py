"""Whether a model pays, said from the changes on each record."""

import itertools

import pytest

from barnax.reporting.comparison_sentences import conclusion, model_sentences
from sample_comparisons import CITY, make_comparison, make_difference, make_row


def told(*rows, differences=()):
    return list(model_sentences(make_comparison(rows, differences)))


def test_the_issue_s_own_sentence():
    rows = make_row("ibmo so-rc", 25.0, 13.0), make_row("ibmo iso-rc", 23.7, 13.5)
    assert told(*rows) == [
        "With ibmo, the hysteresis correction (iso-rc) lowers the identification error by 1.30 mV "
        "and raises the validation error by 0.50 mV: on these data it does not help."
    ]


def test_a_difference_that_chance_explains_does_not_count():
    rows = make_row("ibmo so-rc", 25.0, 13.0), make_row("ibmo iso-rc", 23.7, 13.5)
    differences = [
        make_difference("ibmo so-rc", "ibmo iso-rc", (0.5, 2.0)),
        make_difference("ibmo so-rc", "ibmo iso-rc", (-1.5, 0.5), record=CITY),
    ]
    (sentence,) = told(*rows, differences=differences)
    assert "raises the validation error by 0.50 mV (not significant)" in sentence
    assert sentence.endswith("the gain does not carry over, so on these data it does not help.")


@pytest.mark.parametrize(
    ("optima_mv", "said"),
    [
        ({"so-rc": 23.4, "iso-rc": 23.2}, "it lowers the identification error by 0.20 mV."),
        ({"so-rc": 23.2, "iso-rc": 23.4}, "it raises the identification error by 0.20 mV."),
        ({"so-rc": 23.2, "iso-rc": 23.2}, "it does not change the identification error."),
    ],
)
def test_known_optima_tell_the_model_s_worth_from_the_method_s(optima_mv, said):
    rows = make_row("bmo so-rc", 26.0), make_row("bmo iso-rc", 27.0)
    (sentence,) = model_sentences(make_comparison(rows, optima_mv=optima_mv))
    assert sentence.endswith(f"whatever the method, {said}")


def test_one_optimum_alone_says_nothing_of_the_other_model():
    rows = make_row("bmo so-rc", 26.0), make_row("bmo iso-rc", 27.0)
    (sentence,) = model_sentences(make_comparison(rows, optima_mv={"so-rc": 23.0}))
    assert "optima" not in sentence


def test_equal_errors_are_left_as_they_are():
    rows = make_row("ls so-rc", 25.0, 13.0), make_row("ls iso-rc", 25.0, 12.0)
    (sentence,) = told(*rows)
    assert "does not change the identification error and lowers the validation error" in sentence
    assert sentence.endswith(": on these data it helps.")


def test_several_records_to_validate_on_are_named():
    rows = make_row("ls so-rc", 25.0, 13.0, 20.0), make_row("ls iso-rc", 24.0, 12.0, 21.0)
    (sentence,) = told(*rows)
    assert "lowers the validation error on city.csv by 1.00 mV" in sentence
    assert "raises the validation error on city-1.csv by 1.00 mV" in sentence
    assert sentence.endswith(": it helps on some of these records, but not on others.")


def test_the_method_that_fits_both_best_is_asked():
    rows = [
        make_row("pso so-rc", 30.0, 10.0),
        make_row("pso iso-rc", 20.0, 10.0),
        make_row("lm so-rc", 24.0, 10.0),
        make_row("lm iso-rc", 25.0, 10.0),
    ]
    assert told(*rows)[0].startswith("With lm, the hysteresis correction (iso-rc) raises")


def test_models_that_no_method_shares_are_not_judged():
    (sentence,) = told(make_row("ls so-rc", 25.0), make_row("ibmo iso-rc", 20.0))
    assert sentence.startswith("No method ran both so-rc and iso-rc")


def test_dynamic_hysteresis_is_held_against_both_others():
    rows = [
        make_row(f"lm {model}", error) for model, error in (("so-rc", 3), ("iso-rc", 2), ("esc", 1))
    ]
    sentences = told(*rows)
    assert [sentence.partition(" lowers")[0] for sentence in sentences] == [
        "With lm, the hysteresis correction (iso-rc)",
        "With lm, the dynamic hysteresis (esc)",
        "With lm, hysteresis that follows the charge passed (esc instead of iso-rc)",
    ]


def test_models_without_a_name_for_what_they_add_are_set_side_by_side():
    (sentence,) = told(make_row("lm 1rc", 3.0), make_row("lm 3rc", 2.0))
    assert sentence.startswith("With lm, 3rc instead of 1rc lowers")


def test_one_model_alone_needs_no_sentence():
    assert told(make_row("lm so-rc", 3.0), make_row("ls so-rc", 4.0)) == []
    assert told() == []


@pytest.mark.parametrize(
    ("identified", "validated", "said"),
    [
        ("better", [], "it is not known whether the gain carries over"),
        ("worse", [], "on this record it does not help"),
        ("same", [], "no significant difference"),
        ("better", ["better"], "on these data it helps"),
        ("same", ["better", "same"], "on these data it helps"),
        ("worse", ["better"], "it helps in validation, but not in identification"),
        ("better", ["worse"], "on these data it does not help"),
        ("same", ["worse"], "on these data it does not help"),
        ("worse", ["worse"], "on these data it does not help"),
        ("worse", ["same"], "on these data it does not help"),
        ("better", ["same"], "the gain does not carry over"),
        ("same", ["same"], "no significant difference"),
        ("better", ["better", "worse"], "it helps on some of these records"),
    ],
)
def test_every_combination_of_changes_has_its_conclusion(identified, validated, said):
    assert said in conclusion(identified, validated)


def test_it_never_pays_where_every_other_record_gets_worse():
    for identified in ("better", "same", "worse"):
        for validated in itertools.product(["worse"], ["worse", "same"]):
            assert conclusion(identified, validated).endswith("does not help")
