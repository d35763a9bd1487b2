"""What was decided before the search, in words, each with its reason."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import CellModel, InterpolatedCurve, OcvPoint, SegmentedHysteresis
from barnax.model.inputs import Window
from barnax.reporting.decisions import (
    box_sentences,
    decision_sentences,
    files_table,
    ocv_sentences,
    window_sentences,
)
from barnax.results import DecisionPart
from sample_comparisons import bundled_cell, make_comparison, make_row

SOC = np.linspace(0.0, 1.0, 11)


def discharged_cell() -> CellModel:
    curve = InterpolatedCurve.fit(SOC, 3.0 + SOC)
    points = tuple(OcvPoint(soc, 3.0 + soc, "made", 2, 7200.0) for soc in SOC)
    return CellModel(2.0, "given", curve, curve, SegmentedHysteresis.zero(), (), points, {})


@pytest.mark.parametrize(
    ("strength", "said"),
    [
        ("strong", "(strong evidence: because)"),
        ("weak", "(weak evidence: because)"),
        ("assumed", "(assumed: because)"),
        ("given", "(because)"),
    ],
)
def test_a_decision_is_told_as_firmly_as_it_was_made(strength, said):
    result = make_comparison([make_row("lm so-rc", 1.0)])
    decision = DecisionPart(value="charge-positive", strength=strength, reason="because")
    inputs = tuple(each.model_copy(update={"sign": decision}) for each in result.inputs)
    told = list(decision_sentences(result.model_copy(update={"inputs": inputs}), []))
    assert told[0] == f"The current is charge-positive in drive.csv, city.csv and ocv.csv {said}."


def test_files_of_which_something_else_is_true_are_told_apart():
    result = make_comparison([make_row("lm so-rc", 1.0)])
    other = DecisionPart(value="discharge-positive", strength="weak", reason="it seems so")
    first, *rest = result.inputs
    inputs = (first.model_copy(update={"sign": other}), *rest)
    told = list(decision_sentences(result.model_copy(update={"inputs": inputs}), []))
    assert told[0].startswith("The current is discharge-positive in drive.csv (weak")
    assert told[1].startswith("The current is charge-positive in city.csv and ocv.csv (strong")


@pytest.mark.parametrize(
    ("hold", "said"),
    [("forward", "until the next sample"), ("backward", "since the sample before")],
)
def test_the_hold_is_told_in_words(hold, said):
    result = make_comparison([make_row("lm so-rc", 1.0)])
    decision = DecisionPart(value=hold, strength="strong", reason="the counters say so")
    inputs = tuple(each.model_copy(update={"hold": decision}) for each in result.inputs)
    told = decision_sentences(result.model_copy(update={"inputs": inputs}), [])
    assert any(f"A sample's current flows {said} in" in sentence for sentence in told)


def test_every_start_is_told_with_its_reason():
    result = make_comparison([make_row("lm so-rc", 1.0)])
    starts = [("a.csv", 0.5, "given"), ("b.csv", 1.0, "from the rested voltage")]
    told = list(decision_sentences(result, starts))
    assert told[-2:] == [
        "The simulation of a.csv starts at a state of charge of 0.500 (given).",
        "The simulation of b.csv starts at a state of charge of 1.000 (from the rested voltage).",
    ]


def test_a_polynomial_is_told_with_its_degree_and_its_errors():
    told = " ".join(ocv_sentences(bundled_cell()))
    assert "is a polynomial of degree 7 through its points: 22 from discharging, 21 from" in told
    error = bundled_cell().errors["discharge"]
    assert (
        f"discharge {1e3 * error.rms_v:.2f} mV rms and {1e3 * error.max_v:.2f} mV at most" in told
    )
    assert "five continuous segments" in told


def test_a_cell_measured_one_way_has_no_hysteresis():
    told = list(ocv_sentences(discharged_cell()))
    assert "a monotone interpolation (PCHIP)" in told[0]
    assert told[1] == "The fits pass through their points."
    assert told[2] == "One branch only was measured, so the hysteresis voltage is zero."


@pytest.mark.parametrize(
    ("window", "said"),
    [
        (Window(), "from its first sample on. Errors count at every simulated sample."),
        (Window(start_time_s=60.0), "from 60 s of its clock on."),
        (Window(start_after_step=3), "from the end of its step 3 on."),
        (Window(score_steps=(7,)), "Errors count at the samples in step 7."),
        (Window(score_steps=(7, 8), score_to_s=9.0), "at the samples in steps 7 and 8, up to 9 s."),
        (Window(score_from_s=5.0), "Errors count at the samples from 5 s."),
        (Window(rest_current_a=0.02), "resting below 20 mA, as you said."),
    ],
)
def test_the_window_is_told_as_it_was_chosen(window, said):
    assert said in " ".join(window_sentences(window))


def test_models_with_one_box_are_told_together_and_held_values_with_them():
    box = {"R0 [Ohm]": (0.1, 0.2), "R1 [Ohm]": (0.1, 0.2), "tau1 [s]": (1.0, 10.0)}
    told = list(box_sentences({"a": (box, {}), "b": (box, {}), "c": (box, {"C2 [F]": 500.0})}))
    assert told == [
        "The search box of a and b: R0 [Ohm] and R1 [Ohm] from 0.1 to 0.2; tau1 [s] from 1 to 10.",
        "The search box of c: R0 [Ohm] and R1 [Ohm] from 0.1 to 0.2; tau1 [s] from 1 to 10; "
        "C2 [F] held at 500.",
    ]


def test_the_files_stand_with_the_beginning_of_their_hash():
    table = files_table(make_comparison([make_row("lm so-rc", 1.0)]))
    assert table.rows[0] == ("drive.csv", "identification", "charge-positive", "0123456789abcdef")


def test_a_fit_that_passes_within_rounding_is_no_miss():
    cell = replace(bundled_cell(), errors={})
    assert "The fits pass through their points." in list(ocv_sentences(cell))
