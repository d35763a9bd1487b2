"""The report of an identification: golden files of one stored result, and what changes in it.

What was decided before the search, each with its reason, is in `golden/decisions.txt`.
"""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from barnax import Result, Window
from barnax.cell import SegmentedHysteresis
from barnax.cli.session import as_flags
from barnax.records import Decision
from barnax.reporting.first_screen import first_screen, next_step
from barnax.reporting.identification import identification_document, search_boxes
from barnax.reporting.illustrations import record_roles
from barnax.reporting.render import to_markdown
from barnax.reporting.view import View
from barnax.reporting.wording import sentences, wording
from barnax.search.answers import AtBound
from barnax.settings import Registration
from helpers.golden import GOLDEN, RESULT, require_golden, without_blanks
from helpers.report_reader import screen_of
from helpers.results import make_table_result, metrics_of, with_constant

STORED = Result.from_json(RESULT)
WINDOWS = [
    Window(),
    Window(start_time_s=60.0, capacity_ah=1.9),
    Window(start_after_step=3, score_steps=(7, 8), score_to_s=9.0),
    Window(score_from_s=5.0, score_steps=(7,), rest_current_a=0.02),
    Window(score_soc=(0.1, 1.0)),
]
SOC_SOURCES = (
    *("full end", "empty end", "full voltage", "counters", "rest elsewhere"),
    *("own full charge", "own span", "fitted", "given earlier"),
)
DIRECTION_SOURCES = (
    *("given", "load before", "full or empty", "better fit", "without effect", "assumed"),
)


def screen(result: Result) -> str:
    return without_blanks(screen_of(first_screen(result), width=80))


def changed(result: Result, **inputs) -> Result:
    """The result with other fields in its first input."""
    first, *rest = result.inputs
    return result.model_copy(update={"inputs": (first.model_copy(update=inputs), *rest)})


def test_a_stored_result_s_report_is_the_golden_one():
    text = to_markdown(identification_document(STORED).with_option_names(as_flags))
    require_golden(GOLDEN / "report.md", text)


def test_a_stored_result_s_first_screen_is_the_golden_one():
    require_golden(GOLDEN / "first_screen.txt", screen(STORED))


def best_and_optima(result: Result) -> tuple[str, ...]:
    optima = sentences("circuit.optima", result.constant)
    return wording("verdict.best_possible", View(result)), *optima


def test_every_other_verdict_is_the_golden_one():
    actual = STORED.constant.global_optimum
    own = STORED.metrics.identification
    better = STORED.metrics.model_copy(
        update={"identification": replace(own, rmse_v=0.9 * actual.rmse_v)}
    )
    unproved = {"status": "grid-verified"}
    cases = {
        "proved": {},
        "not proved": {**unproved, "lower_bound_v": 0.9800001 * actual.rmse_v},
        "not asked for": unproved,
        "no other optimum": {"optima": actual.optima[:1]},
    }
    told = []
    for name, update in cases.items():
        optimum = replace(actual, **update)
        told += [f"{name}:", *best_and_optima(with_constant(STORED, global_optimum=optimum))]
    wide = with_constant(STORED, global_optimum=None, source="seeds")
    told += ["too wide:", *best_and_optima(wide)]
    seeds = with_constant(STORED, source="seeds", metrics=better)
    told += ["seeds better:", wording("verdict.best_possible", View(seeds))]
    told.append(wording("verdict.weakest", View(seeds)))
    # The polynomial of this cell misses its points, which comes before all else.
    met = STORED.model_copy(update={"cell": replace(STORED.cell, errors={})})
    alone = STORED.metrics.model_copy(update={"validation": ()})
    identification = replace(STORED.metrics.identification, r2=-0.1)
    worse = STORED.metrics.model_copy(update={"identification": identification})
    # Circuits of the family were tried.
    chosen = met.model_copy(update={"tried": (None,)})
    both = tuple(AtBound(f"R{pair} [Ohm]", "upper") for pair in (1, 2))
    for result in (
        STORED,
        met,
        chosen,
        with_constant(chosen, assessment=None),
        with_constant(met, metrics=alone),
        with_constant(met, at_bound=both),
        with_constant(met, metrics=worse),
    ):
        told.append(f"next: {next_step(result)}")
    require_golden(GOLDEN / "verdicts.txt", "\n".join(told) + "\n")


@pytest.mark.parametrize("constant_v", [0.005, 0.00895, 0.02])
def test_constants_that_validate_better_than_tables_are_named(constant_v):
    result = make_table_result("1rc")

    def validated(rmse_v):
        part = metrics_of(record="v.csv", rmse_v=rmse_v)
        return result.metrics.model_copy(update={"validation": (part,)})

    constant = result.constant.model_copy(update={"metrics": validated(constant_v)})
    result = result.model_copy(update={"constant": constant, "metrics": validated(0.009)})
    surpassed = (
        "1rc, with constants, is better than the answer on v.csv: 5.00 mV, the answer 9.00 mV; "
        "`model='1rc'` takes it."
    )
    is_worse = constant_v < 0.008
    assert sentences("verdict.surpassed", View(result)) == ((surpassed,) if is_worse else ())
    assert not sentences("verdict.surpassed", View(STORED))
    assert next_step(result).options == ({"model": "1rc"} if is_worse else {"to": "pybamm"})


def test_records_identified_together_stand_one_by_one_and_as_a_whole():
    whole, (first, *others) = STORED.metrics.identification, STORED.inputs
    each = tuple(replace(whole, record=name) for name in (first.name, "again.csv"))
    metrics = STORED.metrics.model_copy(update={"jointly": each})
    inputs = first, first.model_copy(update={"name": "again.csv"}), *others
    joint = STORED.model_copy(update={"metrics": metrics, "inputs": inputs})
    document = identification_document(joint)
    (errors,) = (each for each in document.sections if each.title == "Errors")
    names = [row[0] for row in errors.blocks[0].rows]
    assert names == [first.name, "again.csv", whole.record, "validation.parquet"]
    assert record_roles(2, 1) == ["identification-1", "identification-2", "validation-1"]
    text = screen(joint)
    assert "again.csv" in text
    assert max(map(len, text.splitlines())) <= 80


def test_a_start_that_was_fitted_has_its_line_though_it_was_adjusted():
    """Where it was moved with the circuit, or by other records, it is still one that was fitted."""
    start = replace(STORED.start, soc=0.982, soc_source="registered", soc_sd=0.014)
    for source, line in (
        ("fitted", "fitted to the record with a standard error of 1.4 %; --initial-soc sets"),
        ("rest elsewhere", "from the rested voltage 4.1785 V at row 2, and the ampere-hours since"),
    ):
        ends = {"soc_low": 0.97, "soc_high": 0.99, "capacity_low_ah": 2.0, "capacity_high_ah": 2.0}
        by_fit = Registration(Window(), 0.992, 2.0, source, **ends, by="circuit", given_sd=0.014)
        window = Window(initial_soc=0.982, soc_source="registered", registration=by_fit)
        text = " ".join(screen(changed(STORED, start=start, window=window)).split())
        said = f"identification.parquet starts at 98 % SOC, adjusted from 99 %, {line}"
        assert said in text


def test_every_decision_is_worded_as_firmly_as_it_was_made():
    told = []
    for strength in ("strong", "weak", "assumed", "given"):
        sign = Decision("discharge-positive", strength, "because")
        hold = Decision("backward", strength, "the counters say so")
        told += sentences("decisions.decided", View(changed(STORED, sign=sign, hold=hold)))[:4]
        told += View(changed(STORED, hold=hold, resampled_share=0.954)).guesses[:1]
    for source in DIRECTION_SOURCES:
        for soc_source in ("given", "rested voltage"):
            start = replace(
                STORED.start, direction_source=source, soc_source=soc_source, other_rmse_v=0.02
            )
            result = changed(STORED, start=start)
            told += sentences("starts.start", result.inputs[0], False, True)
            told += View(result).guesses[1:]
    for soc_source in SOC_SOURCES:
        start = replace(STORED.start, soc_source=soc_source)
        told += sentences("starts.carried", View(changed(STORED, start=start)))
    for window in WINDOWS:
        told += sentences("decisions.window", window, ["a.csv", "b.csv"])
    cell = STORED.cell
    told += sentences("decisions.ocv", cell, None)
    bare = replace(cell, errors={}, hysteresis=SegmentedHysteresis.zero())
    told += sentences("decisions.ocv", bare, None)
    box = {"R0 [Ohm]": (0.1, 0.2), "R1 [Ohm]": (0.1, 0.2), "tau1 [s]": (1.0, 10.0)}
    free = SimpleNamespace(bounds=box, fixed={})
    held = SimpleNamespace(bounds=box, fixed={"C2 [F]": 500.0})
    boxes = search_boxes({"a": free, "b": free, "c": held})
    told += sentences("decisions.boxes", boxes)
    require_golden(GOLDEN / "decisions.txt", "\n".join(told) + "\n")
