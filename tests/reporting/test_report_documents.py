"""Whole reports: of a comparison, of an identification."""

import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from report_reader import ReportReader

from barnax.cell import CircuitParameters
from barnax.global_optimum import GlobalOptimum, Landscape, find_global_optimum
from barnax.plots.sources import record_roles
from barnax.reporting import (
    comparison_document,
    comparison_illustrations,
    identification_document,
    identification_illustrations,
    to_html,
    to_markdown,
)
from barnax.reporting.document import Bullets, Picture
from barnax.reporting.identification import validation_sentences
from barnax.results import JointPart, MetricsPart, Result, make_result
from barnax.search.evaluate import Evaluation, evaluate
from barnax.search.refine import Optimum, Refinement
from sample_comparisons import CITY, DRIVE, make_comparison, make_failure, make_row

LARGEST_REPORT = 4_000_000
HOSTILE = "<b>&amp; {{ drive }}|*.csv"


@pytest.fixture(scope="module")
def comparison():
    rows = [
        make_row("ibmo so-rc", 25.0, 13.0, optimality_gap=0.02),
        make_row("ibmo iso-rc", 23.7, 13.5, optimality_gap=0.0),
        make_failure("rls iso-rc", "No circuit belongs to its poles."),
    ]
    return make_comparison(rows, optima_mv={"so-rc": 24.5})


@pytest.fixture(scope="module")
def identified(refinement: Refinement) -> Evaluation:
    return evaluate(refinement.search.problem.prepared, refinement.parameters)


@pytest.fixture(scope="module")
def result(refinement: Refinement, identified: Evaluation) -> Result:
    return make_result(
        refinement, [identified], [identified], command=["barnax", "identify", "a b"]
    )


def titles(document):
    return [section.title for section in document.sections]


def test_a_comparison_s_report_has_every_part(comparison):
    assert titles(comparison_document(comparison)) == [
        "Verdict",
        "Warnings",
        "What was measured",
        "What was decided",
        "Parameters",
        "Search",
        f"Identification: {DRIVE}",
        f"Validation: {CITY}",
        "Without an answer",
        "How to repeat this",
    ]


def test_its_first_lines_say_who_leads_and_whether_the_model_pays(comparison):
    summary = comparison_document(comparison).summary
    assert summary == (
        "Lowest error: ibmo iso-rc on drive.csv (23.70 mV); ibmo so-rc on city.csv (13.00 mV). "
        "By ibmo, the hysteresis correction (iso-rc) lowers the identification error by 1.30 mV "
        "and raises the validation error by 0.50 mV: on these data it does not pay."
    )


def test_a_row_that_leads_everywhere_is_named_once():
    summary = comparison_document(make_comparison([make_row("lm so-rc", 25.0, 13.0)])).summary
    assert summary == "Lowest error: lm so-rc on drive.csv (25.00 mV) and city.csv (13.00 mV)."


def test_what_is_wanted_to_repeat_it_stands_in_it(comparison):
    text = to_markdown(comparison_document(comparison))
    for part in ("barnax compare drive.csv", "the key 7", "| barnax", "the file is odd"):
        assert part in text


def test_without_warnings_or_failures_there_are_no_sections_for_them():
    quiet = make_comparison([make_row("lm so-rc", 25.0)], warnings=())
    assert {"Warnings", "Without an answer"}.isdisjoint(titles(comparison_document(quiet)))


def test_a_comparison_without_a_single_answer_is_a_report_all_the_same():
    document = comparison_document(make_comparison([make_failure("ls so-rc", "No.")]))
    assert document.summary == "No row has an answer; the reasons are below."
    assert "ls so-rc gave no answer: No." in to_markdown(document)


def test_the_seconds_of_the_rows_are_shown_where_they_are_known(comparison):
    text = to_markdown(comparison_document(comparison, seconds={"ibmo so-rc": 1.5}))
    assert "time [s]" in text
    assert "time [s]" not in to_markdown(comparison_document(comparison))


def test_a_stored_comparison_gives_the_figures_of_the_cell_and_the_seeds(comparison):
    names = [each.name for each in comparison_illustrations(comparison)]
    assert names == ["ocv", "hysteresis", "convergence", "parameters"]


def test_every_figure_of_a_comparison_finds_its_place(comparison):
    drawn = comparison_illustrations(comparison)
    document = comparison_document(comparison, drawn)
    assert {each.name for each in document.pictures} == {each.name for each in drawn}
    html = to_html(document)
    assert ReportReader(html).count("img") == len(drawn)
    assert len(html) < LARGEST_REPORT


def test_a_comparison_with_its_records_gives_figures_over_time_too(comparison, identified):
    rows = [SimpleNamespace(name=name, evaluations=(identified, identified)) for name in "ab"]
    names = [
        each.name
        for each in comparison_illustrations(comparison, cast(Any, SimpleNamespace(answered=rows)))
    ]
    for role in ("identification", "validation-1"):
        assert {f"{role}-{kind}" for kind in ("condition", "voltages", "errors")} <= set(names)
    assert len(set(names)) == len(names)


def make_optimum(*tau_s):
    """A global optimum in the middle of a bowl over these time constants."""
    distance = sum(np.ix_(*(np.log(each / each[len(each) // 2]) ** 2 for each in tau_s)))
    landscape = Landscape(tau_s, None, 0.02 * (1 + distance), np.zeros((3, *distance.shape)))
    circuit = CircuitParameters(0.05, (0.01,) * len(tau_s), (1000.0,) * len(tau_s))
    return GlobalOptimum((Optimum(0.02, circuit, 1, False),), (), None, landscape)


def test_the_landscape_stands_in_the_search_with_what_is_sure_about_the_optimum(comparison):
    tau_s = np.geomspace(1.0, 100.0, 9)
    optimum = make_optimum(tau_s, tau_s)
    drawn = comparison_illustrations(comparison, None, {"so-rc": optimum, "iso-rc": optimum})
    document = comparison_document(comparison, drawn)
    (search,) = [section for section in document.sections if section.title == "Search"]
    shown = {block.name: block for block in search.blocks if isinstance(block, Picture)}
    assert {"landscape-so-rc", "landscape-iso-rc"} <= shown.keys()
    assert optimum.verdict in shown["landscape-so-rc"].caption


def test_what_has_not_two_time_constants_has_no_landscape(comparison):
    optima = {"so-rc": make_optimum(np.geomspace(1.0, 100.0, 9))}
    names = [each.name for each in comparison_illustrations(comparison, None, optima)]
    assert not any(name.startswith("landscape") for name in names)


def test_hostile_names_of_files_stay_names():
    rows = [make_row("lm so-rc", 25.0, 13.0)]
    document = comparison_document(make_comparison(rows, names={"identification": HOSTILE}))
    page = ReportReader(to_html(document))
    assert HOSTILE in page.text
    plain = ReportReader(to_html(comparison_document(make_comparison(rows))))
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in plain.tags]


def test_an_identification_s_report_has_every_part_and_figure(refinement, identified, result):
    drawn = identification_illustrations(refinement, [identified], [identified])
    document = identification_document(result, drawn)
    assert titles(document) == [
        "Verdict",
        *(["Warnings"] if result.warnings else []),
        "What was measured",
        "What was decided",
        "Parameters",
        "Errors",
        "Search",
        "How to repeat this",
    ]
    assert {each.name for each in document.pictures} == {each.name for each in drawn}
    html = to_html(document)
    assert ReportReader(html).open == []
    assert len(html) < LARGEST_REPORT


def test_an_identification_s_report_tells_its_numbers(result):
    text = to_markdown(identification_document(result))
    assert f"errs by {1e3 * result.refined.rmse_v:.2f} mV (RMSE)" in text
    assert "barnax identify 'a b'" in text
    assert f"{result.search.evaluations} evaluations" in text
    for optimum in result.refined.optima:
        assert f"{1e3 * optimum.rmse_v:.4f}" in text


def test_an_identification_s_report_tells_how_far_it_is_from_the_global_optimum(
    refinement, identified
):
    optimum = find_global_optimum(refinement.search.problem, prove=False)
    result = make_result(refinement, [identified], optimum=optimum)
    text = to_markdown(identification_document(result))
    assert f"The lowest RMSE in the box is {1e3 * optimum.rmse_v:.6g} mV" in text
    seeds_v = [seed.rmse_v for seed in refinement.search.seeds]
    optimality_gap = 100 * (np.median(seeds_v) / optimum.rmse_v - 1)
    assert f"median seed {optimality_gap:.2g} %" in text
    assert result.global_optimum.median_gap == pytest.approx(optimality_gap / 100)


def test_what_was_made_from_python_has_no_command(result):
    silent = result.model_copy(update={"command": ()})
    text = to_markdown(identification_document(silent))
    assert "This was made from Python, not by a command." in text


def test_records_identified_together_stand_one_by_one_and_as_a_whole(result):
    own = result.metrics.identification
    parts = tuple(
        JointPart(
            initial_soc=0.5,
            initial_soc_reason="given",
            metrics=own.model_copy(update={"record": name}),
        )
        for name in ("one.csv", "two.csv")
    )
    text = to_markdown(identification_document(result.model_copy(update={"jointly": parts})))
    assert "The simulation of one.csv starts at a state of charge of 0.500 (given)." in text
    assert re.search(r"\| two.csv +\| identification", text)
    assert "all of these" in text


@pytest.mark.parametrize(
    ("own_mv", "other_mv", "said"),
    [
        (20.0, 30.0, "it errs by 30.00 mV, 50 % more than on what it was fitted to."),
        (20.0, 15.0, "it errs by 15.00 mV, 25 % less than on what it was fitted to."),
        (20.0, 20.1, "it errs by 20.10 mV, as on the record it was fitted to."),
        (0.0, 20.0, "which it was not fitted to, it errs by 20.00 mV."),
    ],
)
def test_errors_on_other_records_are_held_against_its_own(own_mv, other_mv, said):
    def metrics(rmse_mv):
        numbers = dict.fromkeys(("r2", "r2_paper", "mape_percent", "ce_v", "max_v"), 0.5)
        return MetricsPart(record="x", rmse_v=rmse_mv / 1e3, samples=10, **numbers)

    (sentence,) = validation_sentences(metrics(own_mv), (metrics(other_mv),))
    assert sentence.endswith(said)


def test_without_a_record_to_validate_on_nothing_is_claimed(result):
    (sentence,) = validation_sentences(result.metrics.identification, ())
    assert sentence.startswith("No record was given for validation")


def test_files_of_one_record_carry_no_number_of_several_do():
    assert record_roles(2, 1) == ["identification-1", "identification-2", "validation-1"]


def test_the_verdict_comes_first(comparison, result):
    for document in (comparison_document(comparison), identification_document(result)):
        assert isinstance(document.sections[0].blocks[0], Bullets)
        assert document.sections[0].title == "Verdict"


def test_a_report_is_the_same_every_time(comparison):
    pages = [
        to_html(comparison_document(comparison, comparison_illustrations(comparison)))
        for _ in range(2)
    ]
    assert pages[0] == pages[1]
