"""What was decided before the search, in words, each with its reason: `golden/decisions.txt`."""

from dataclasses import replace

from barnax.cell import SegmentedHysteresis
from barnax.model.window import Window
from barnax.records import Decision
from barnax.reporting.decisions import (
    box_sentences,
    carried_sentences,
    decision_sentences,
    files_table,
    guess_sentences,
    known_words,
    ocv_sentences,
    start_sentence,
    window_sentences,
)
from barnax.results import Result
from helpers.golden import GOLDEN, RESULT, require_golden

STORED = Result.from_json(RESULT)
WINDOWS = [
    Window(),
    Window(start_time_s=60.0, capacity_ah=1.9),
    Window(start_after_step=3, score_steps=(7, 8), score_to_s=9.0),
    Window(score_from_s=5.0, score_steps=(7,), rest_current_a=0.02),
    Window(score_soc=(0.1, 1.0)),
]


def with_inputs(**update) -> Result:
    """The stored result with other fields in the first of its inputs."""
    first, *rest = STORED.inputs
    return STORED.model_copy(update={"inputs": (first.model_copy(update=update), *rest)})


def test_every_decision_is_told_as_firmly_as_it_was_made():
    told = []
    for strength in ("strong", "weak", "assumed", "given"):
        sign = Decision("discharge-positive", strength, "because")
        hold = Decision("backward", strength, "the counters say so")
        told += list(decision_sentences(with_inputs(sign=sign, hold=hold)))[:4]
        told += list(guess_sentences(with_inputs(hold=hold)))[:1]
    for source in (
        "given",
        "load before",
        "full or empty",
        "better fit",
        "without effect",
        "assumed",
    ):
        for soc_source in ("given", "rested voltage"):
            start = replace(
                STORED.start, direction_source=source, soc_source=soc_source, other_rmse_v=0.02
            )
            result = with_inputs(start=start)
            told += [
                start_sentence(result.inputs[0].name, start),
                *list(guess_sentences(result))[1:],
            ]
    for soc_source in list(known_words(STORED.start))[1:]:
        start = replace(STORED.start, soc_source=soc_source)
        told += carried_sentences(with_inputs(start=start))
    for window in WINDOWS:
        told += window_sentences(window, ["a.csv", "b.csv"])
    cell = STORED.cell_model
    told += ocv_sentences(cell)
    told += ocv_sentences(replace(cell, errors={}, hysteresis=SegmentedHysteresis.zero()))
    box = {"R0 [Ohm]": (0.1, 0.2), "R1 [Ohm]": (0.1, 0.2), "tau1 [s]": (1.0, 10.0)}
    told += box_sentences({"a": (box, {}), "b": (box, {}), "c": (box, {"C2 [F]": 500.0})})
    require_golden(GOLDEN / "decisions.txt", "\n".join(told) + "\n")


def test_the_files_stand_with_the_beginning_of_their_hash():
    first = STORED.inputs[0]
    assert files_table(STORED).rows[0] == (
        first.name, "identification", "charge-positive", first.sha256[:16]
    )  # fmt: skip
