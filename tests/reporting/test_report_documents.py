"""Whole reports of a comparison."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from report_reader import ReportReader

from barnax.cell import CircuitParameters
from barnax.global_optimum import GlobalOptimum, Landscape
from barnax.reporting.comparison import comparison_document
from barnax.reporting.document import Bullets, Picture
from barnax.reporting.illustrations import comparison_illustrations
from barnax.reporting.render import to_html, to_markdown
from barnax.search.evaluate import Evaluation, evaluate
from barnax.search.refine import Optimum, Refinement
from sample_comparisons import CITY, DRIVE, make_comparison, make_failure, make_row

LARGEST_REPORT = 4_000_000
HOSTILE = "<b>&amp; {{ drive }}|*.csv"


@pytest.fixture(scope="module")
def comparison():
    rows = [
        make_row("ibmo so-rc", 25.0, 13.0, optimality_gap=0.02),
        make_row("ibmo iso-rc", 23.7, 13.5, optimality_gap=0.0, notes=("Biased.",)),
        make_failure("rls iso-rc", "No circuit belongs to its poles."),
    ]
    return make_comparison(rows, optima_mv={"so-rc": 24.5})


@pytest.fixture(scope="module")
def identified(refinement: Refinement) -> Evaluation:
    return evaluate(refinement.search.problem.prepared, refinement.parameters)


def titles(document):
    return [section.title for section in document.sections]


def test_a_comparison_s_report_has_every_part_the_verdict_first(comparison):
    document = comparison_document(comparison)
    assert isinstance(document.sections[0].blocks[0], Bullets)
    assert titles(document) == [
        "Verdict",
        "Warnings",
        "Parameters",
        "What was measured",
        "What was decided",
        "Search",
        f"Identification: {DRIVE}",
        f"Validation: {CITY}",
        "How to repeat this",
    ]


def test_what_repeats_it_and_what_methods_say_stand_in_it(comparison):
    text = to_markdown(comparison_document(comparison))
    for part in (
        *("barnax compare drive.csv", "the key 7", "| barnax", "the file is odd"),
        *("ibmo iso-rc: Biased.", "rls iso-rc gave no answer: No circuit belongs to its poles."),
    ):
        assert part in text


def test_without_warnings_there_is_no_section_for_them():
    quiet = make_comparison([make_row("lm so-rc", 25.0)], warnings=())
    assert {"Warnings"}.isdisjoint(titles(comparison_document(quiet)))


def test_a_comparison_without_a_single_answer_is_a_report_all_the_same():
    document = comparison_document(make_comparison([make_failure("ls so-rc", "No.")]))
    assert document.sections[0].blocks[0].items == (
        "No row has an answer.",
        "ls so-rc gave no answer: No.",
    )


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
    offline = SimpleNamespace(trajectory=None)
    rows = [
        SimpleNamespace(name=name, evaluations=(identified, identified), median=offline)
        for name in "ab"
    ]
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
    assert "so-rc" in shown["landscape-so-rc"].caption


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


def test_a_report_is_the_same_every_time(comparison):
    pages = [
        to_html(comparison_document(comparison, comparison_illustrations(comparison)))
        for _ in range(2)
    ]
    assert pages[0] == pages[1]
