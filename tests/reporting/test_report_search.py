"""How far rows stayed from the optimum, what failed, where the box decided, where errors lie."""

from barnax.reporting.comparison_sentences import (
    bound_sentences,
    budget_sentence,
    failure_sentences,
    gap_sentences,
    note_sentences,
    optimum_sentences,
    soc_sentence,
)
from barnax.search.refine import AtBound
from sample_comparisons import make_comparison, make_errors, make_failure, make_row


def optimality_gaps(*rows, optima_mv=None):
    return list(gap_sentences(make_comparison(rows, optima_mv=optima_mv)))


def test_rows_at_the_optimum_are_said_to_reach_it():
    rows = [make_row(f"{name} so-rc", 20.0, optimality_gap=0.0005) for name in ("lm", "varpro")]
    assert optimality_gaps(*rows, optima_mv={"so-rc": 20.0}) == [
        "Before refinement, every row reaches the global optimum of so-rc, 20.00 mV, to 0.1 %. "
        "After refinement, every row reaches it, to 0.1 %."
    ]


def test_rows_above_the_optimum_are_told_by_how_much():
    rows = [
        make_row("bmo so-rc", 22.0, optimality_gap=0.1, refined_rmse_v=0.02),
        make_row("lm so-rc", 20.0, optimality_gap=0.0),
        make_row("pso so-rc", 21.0, optimality_gap=0.05, refined_rmse_v=0.023),
    ]
    assert optimality_gaps(*rows, optima_mv={"so-rc": 20.0}) == [
        "Before refinement, lm so-rc reaches the global optimum of so-rc, 20.00 mV, to 0.1 %; the "
        "optimality gap is 10 % for bmo so-rc and 5 % for pso so-rc. After refinement, bmo so-rc "
        "and lm so-rc reach it, to 0.1 %; the optimality gap is 15 % for pso so-rc."
    ]


def test_where_no_row_reaches_the_optimum_it_is_said():
    (sentence,) = optimality_gaps(
        make_row("bmo so-rc", 22.0, optimality_gap=0.1, refined_rmse_v=None),
        optima_mv={"so-rc": 20.0},
    )
    assert sentence == (
        "Before refinement, no row reaches the global optimum of so-rc, 20.00 mV; the optimality "
        "gap is 10 % for bmo so-rc."
    )


def test_a_model_without_a_known_optimum_is_said_to_have_none():
    sentences = optimality_gaps(
        make_row("lm so-rc", 20.0, optimality_gap=0.0),
        make_row("lm esc", 19.0),
        optima_mv={"so-rc": 20.0},
    )
    assert len(sentences) == 2
    assert sentences[1].startswith("The global optimum of esc is not known")


def test_an_optimum_is_told_with_how_sure_it_is():
    result = make_comparison(
        [make_row("lm so-rc", 20.0, optimality_gap=0.0)], optima_mv={"so-rc": 20.0}
    )
    sure = {"optimum_status": "certified", "optimum_proved_gap": 0.001}
    models = {"so-rc": result.models["so-rc"].model_copy(update=sure)}
    result = result.model_copy(update={"models": models})
    assert "of so-rc, 20.00 mV (certified), to 0.1 %" in next(iter(gap_sentences(result)))
    assert list(optimum_sentences(result)) == [
        "The global optimum of so-rc is proved: no circuit in the bounds is more than 0.1 % better."
    ]


def test_models_without_a_known_optimum_are_told_together():
    (sentence,) = optimality_gaps(make_row("lm so-rc", 20.0), make_row("lm esc", 19.0))
    assert sentence.startswith("The global optimum of so-rc and esc is not known")


def test_a_model_without_an_answer_has_no_optimality_gap():
    result = make_comparison([make_failure("ls so-rc", "No.")])
    assert list(gap_sentences(result)) == []


def test_a_bound_is_told_with_the_rows_that_are_at_it():
    place = AtBound("tau2 [s]", "upper")
    rows = [make_row("a so-rc", 1.0, at_bound=(place,)), make_row("b so-rc", 1.0)]
    assert list(bound_sentences(make_comparison(rows))) == [
        "tau2 at its upper bound in a so-rc: set by the bounds, not by the data."
    ]
    rows = [
        make_row("a so-rc", 1.0, at_bound=(place,)),
        make_row("b so-rc", 1.0, at_bound=(place,)),
    ]
    assert "in every row" in next(iter(bound_sentences(make_comparison(rows))))


def test_failures_and_notes_say_whose_they_are():
    rows = [make_failure("rls so-rc", "no circuit"), make_row("ls so-rc", 1.0, notes=("Biased.",))]
    result = make_comparison(rows)
    assert list(failure_sentences(result)) == ["rls so-rc gave no answer: no circuit."]
    assert list(note_sentences(result)) == ["ls so-rc: Biased."]


def test_the_share_of_the_error_at_a_low_state_of_charge_is_that_of_the_squares():
    # 100 samples with twice the error hold 400 of 1300 parts of the squares.
    assert soc_sentence(make_comparison([make_row("lm so-rc", 20.0)]), 0) == (
        "10 % of the samples lie below 20 % state of charge, and they have 31 % of the squared "
        "error of lm so-rc."
    )


def test_a_record_without_low_states_of_charge_is_said_to_have_none():
    row = make_row("lm so-rc", 20.0, identification=make_errors("drive.csv", 0.02, low_samples=0))
    assert soc_sentence(make_comparison([row]), 0).startswith("No scored sample of drive.csv")


def test_an_answer_without_any_error_has_no_share_of_it():
    assert "have 0 % of" in soc_sentence(make_comparison([make_row("lm so-rc", 0.0)]), 0)


def test_the_budget_is_told_in_full():
    sentence = budget_sentence(make_comparison([make_row("lm so-rc", 20.0)]))
    for part in ("300 evaluations", "30 candidates", "9 generations", "3 seeds", "key 7", "rc"):
        assert part in sentence
