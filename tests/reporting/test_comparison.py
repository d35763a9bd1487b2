"""The report of a comparison: its words, case by case, against `golden/comparison.txt`, and whole.

Every case is made so that one thing about it is worth a sentence or a cell; its name says which.
"""

from dataclasses import replace

import pytest

from barnax import ComparisonResult, Evaluation, evaluate
from barnax.reporting.comparison import (
    comparison_document,
    on_records,
    shown_differences,
    verdict_facts,
)
from barnax.reporting.document import Bullets, ReportTable
from barnax.reporting.illustrations import comparison_illustrations
from barnax.reporting.render import table_lines, to_markdown
from barnax.reporting.wording import blocks, sentences, table, wording
from barnax.search.answers import AtBound, Refinement
from helpers.comparisons import (
    CITY,
    DRIVE,
    make_comparison,
    make_difference,
    make_failure,
    make_optimum,
    make_refined,
    make_row,
)
from helpers.golden import GOLDEN, require_golden

# Errors in mV, on the record identified on and on others, by row.
Errors = dict[str, tuple[float, ...]]
UPPER = AtBound("tau2 [s]", "upper")
TWO: Errors = {"bmo so-rc": (25.0,), "pso so-rc": (23.0,)}
LEAD = "pso so-rc", "bmo so-rc"
BY_SEEDS = make_difference(*LEAD, (-3.0, -1.0), seeds=(28, 2, 0.001))
PAIR: Errors = {"ibmo so-rc": (25.0, 13.0), "ibmo iso-rc": (23.7, 13.5)}


def made(errors: Errors, *differences, **changes) -> ComparisonResult:
    return make_comparison(
        [make_row(name, *mv) for name, mv in errors.items()], differences, **changes
    )


RANKED = {
    "the lead was not tested": made(TWO),
    "the lead is more than chance": made(TWO, BY_SEEDS),
    "the same, stored the other way round": made(
        TWO, make_difference(*LEAD[::-1], (1.0, 3.0), seeds=(2, 28, 0.001))
    ),
    "the lead is no more than chance": made(TWO, make_difference(*LEAD, (-3.0, 1.0))),
    "the interval is too narrow": made(TWO, make_difference(*LEAD, (-3.0, -1.0), is_capped=True)),
    "other rows are worse or cannot be told apart": made(
        {f"{name} so-rc": (mv,) for name, mv in zip("abcd", (1, 2, 3, 4), strict=True)},
        make_difference("a so-rc", "b so-rc", (-2.0, -0.5)),
        make_difference("a so-rc", "c so-rc", (-5.0, 0.5)),
        make_difference("d so-rc", "a so-rc", (2.0, 4.0)),
    ),
    "the lead is shared": made({"lm so-rc": (23.0,), "varpro so-rc": (23.0 * (1 + 1e-7),)}),
    "another leads on another record": made({"a so-rc": (20.0, 30.0), "b so-rc": (21.0, 10.0)}),
    "one leads everywhere, tested on the second record alone": made(
        {"a so-rc": (20.0, 10.0), "b so-rc": (21.0, 30.0)},
        make_difference("a so-rc", "b so-rc", (-3.0, -1.0), record=CITY),
    ),
    "a single row": made({"a so-rc": (20.0,)}),
    "no row": made({}),
}
JUDGED = {
    "it does not carry over": made(PAIR),
    "chance explains what changes on the other record": made(
        PAIR,
        make_difference("ibmo so-rc", "ibmo iso-rc", (0.5, 2.0)),
        make_difference("ibmo so-rc", "ibmo iso-rc", (-1.5, 0.5), record=CITY),
    ),
    "equal errors": made({"ls so-rc": (25.0, 13.0), "ls iso-rc": (25.0, 12.0)}),
    "several records to validate on": made(
        {"ls so-rc": (25.0, 13.0, 20.0), "ls iso-rc": (24.0, 12.0, 21.0)}
    ),
    "the method that fits both best is asked": made(
        {
            "pso so-rc": (30.0, 10.0),
            "pso iso-rc": (20.0, 10.0),
            "lm so-rc": (24.0, 10.0),
            "lm iso-rc": (25.0, 10.0),
        }
    ),
    "no method ran both": made({"ls so-rc": (25.0,), "ibmo iso-rc": (20.0,)}),
    "three models": made({"lm so-rc": (3.0,), "lm iso-rc": (2.0,), "lm esc": (1.0,)}),
    "models without a name for what they add": made({"lm 1rc": (3.0,), "lm 3rc": (2.0,)}),
    "one model": made({"lm so-rc": (3.0,), "ls so-rc": (4.0,)}),
    "no row": made({}),
}
CHANGES = [
    ("better", []), ("worse", []), ("same", []),
    ("better", ["better"]), ("same", ["better", "same"]), ("worse", ["better"]),
    ("better", ["worse"]), ("same", ["worse"]), ("worse", ["worse"]), ("worse", ["same"]),
    ("better", ["same"]), ("same", ["same"]), ("better", ["better", "worse"]),
]  # fmt: skip


def compared(*rows, optima_mv=None) -> ComparisonResult:
    return make_comparison(rows, optima_mv=optima_mv)


def with_proof(status: str) -> ComparisonResult:
    result = compared(make_row("lm so-rc", 20.0))
    optimum = make_optimum(0.02, status=status, lower_bound_v=0.02 * (1 - 0.001))
    models = {"so-rc": result.models["so-rc"].model_copy(update={"optimum": optimum})}
    return result.model_copy(update={"models": models})


OF_TWO_MODELS = make_row("lm so-rc", 20.0), make_row("lm esc", 19.0)
OPTIMA = {
    "it is known of one model": compared(*OF_TWO_MODELS, optima_mv={"so-rc": 20.0}),
    "it is known of none": compared(*OF_TWO_MODELS),
    "it is certified": with_proof("certified"),
    "it is the best of a grid": with_proof("grid-verified"),
    "failures alone": compared(make_failure("ls so-rc", "No.")),
}
BOUNDS = {
    "a bound in one row": compared(
        make_row("a so-rc", 1.0, at_bound=(UPPER,)), make_row("b so-rc", 1.0)
    ),
    "a bound in every row": compared(
        make_row("a so-rc", 1.0, at_bound=(UPPER,)), make_row("b so-rc", 1.0, at_bound=(UPPER,))
    ),
}


def tables() -> dict[str, ReportTable]:
    refined = make_row("lm so-rc", 1.0, refined=make_refined(0.0204))
    # A gap of rounding errors is none.
    best = make_row("pso so-rc", 1.0, refined=make_refined(0.02 * (1 - 1e-15)))
    unrefined = make_row("ls so-rc", 1.0, refined=None)
    models = compared(refined, best, make_row("lm esc", 1.0), unrefined, optima_mv={"so-rc": 20.0})
    first, second = on_records(made({"a so-rc": (22.0, 9.0), "b so-rc": (21.0, 10.0)}))
    alone = make_row("b so-rc", 20.0, seeds=1)
    differences = made(
        {"a so-rc": (20.0,), "b so-rc": (22.0,), "c so-rc": (22.0,)},
        make_difference("a so-rc", "b so-rc", (-3.0, -1.0), seeds=(3, 0, 0.25)),
        make_difference("b so-rc", "c so-rc", (-1.0, 1.0), is_capped=True),
        make_difference("a so-rc", "c so-rc", (-3.0, -1.0), record=CITY),
    )
    timed = compared(make_row("a so-rc", 20.0, optimality_gap=0.021), alone)
    own, refined = blocks("comparison.parameters", models)
    of_first = on_records(differences)[0]
    return {
        "parameters, with what not every model has last": own,
        "refined, where something was": refined,
        "errors on the first record": table("comparison.errors", first),
        "errors on the second record": table("comparison.errors", second),
        "search, with the time": table(
            "comparison.search", timed, on_records(timed)[0], {"a so-rc": 1.234}
        ),
        "search, without": table(
            "comparison.search", compared(alone), on_records(compared(alone))[0], {}
        ),
        "bands that hold a sample": table("comparison.bands", first),
        "differences on the first record": table(
            "comparison.differences", of_first, shown_differences(differences, of_first)
        ),
    }


def test_every_case_is_worded_as_in_the_golden_file():
    lines = []
    for cases, part in (
        (RANKED, "ranking"),
        (JUDGED, "models"),
        (OPTIMA, "optima"),
        (BOUNDS, "bounds"),
    ):
        for name, result in cases.items():
            told = sentences(f"comparison.{part}", verdict_facts(result))
            lines += [f"# {name}", *told]
    lines += ["# the budget", wording("comparison.budget", made(TWO))]
    for identified, validated in CHANGES:
        others = ", ".join(validated) or "nothing"
        conclusion = wording("comparison.conclusion", [identified, *validated])
        lines.append(f"# {identified}, then {others}\n{conclusion}")
    for name, cells in tables().items():
        lines.append(f"# {name}\n{cells.caption}\n{table_lines(cells)}")
    require_golden(GOLDEN / "comparison.txt", "\n".join(lines) + "\n")


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


def test_a_comparison_s_report_has_every_part_the_verdict_first(comparison):
    document = comparison_document(comparison)
    assert isinstance(document.sections[0].blocks[0], Bullets)
    assert [section.title for section in document.sections] == [
        *("Verdict", "Warnings", "Parameters", "What was measured", "What was decided", "Search"),
        *(f"Identification: {DRIVE}", f"Validation: {CITY}", "How to repeat this"),
    ]
    text = to_markdown(document)
    for part in (
        *("the key 7", "| barnax", "the file is odd"),
        *("ibmo iso-rc: Biased.", "rls iso-rc gave no answer: No circuit belongs to its poles."),
    ):
        assert part in text


def test_a_comparison_with_its_records_gives_figures_over_time_too(comparison, identified):
    rows = [replace(row, evaluations=(identified, identified)) for row in comparison.answered]
    ran = comparison.model_copy(update={"rows": tuple(rows)})
    names = [each.name for each in comparison_illustrations(ran)]
    for role in ("identification", "validation-1"):
        assert {f"{role}-{kind}" for kind in ("voltages", "errors")} <= set(names)
    assert len(set(names)) == len(names)
