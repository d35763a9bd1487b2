"""Answers of the voltage to a step of the current, in the sample of the step and those after it."""

import numpy as np
from jaxtyping import Float

from ..records import Record

# The answers to a step are looked at in so many samples, of so many places where the current moves
# by more than this share of the largest.
_ANSWERS, _FEWEST_STEPS, _STEP_SHARE = 5, 50, 0.05
# The answers to so many steps tell as much as those to all.
_ENOUGH_STEPS = 15_000
# A pair answers in the sample after a step at most so often what it does in the next one, unless it
# is over within two samples. More than this share of the whole, at so many deviations, is late.
LASTING, _LATE_SHARE, LATE_SURE = 2.0, 0.03, 4.0
Known = tuple[Float[np.ndarray, "answers"], Float[np.ndarray, "answers answers"]]


def answers_ohm(record: Record) -> Known | None:
    """The answers of the voltage to a step of the current in the samples from it on, with their
    covariance; None where too few steps are on an even clock.

    They are least squares on the differences between samples: R0 and what follows at once in the
    first, in the others what the RC pairs add, which falls off with their time constants.
    """
    interval_s, moved_a = record.interval_s, np.diff(record.current_a)
    least_a = _STEP_SHARE * float(np.max(np.abs(record.current_a)))
    steps = np.flatnonzero(np.abs(moved_a) > least_a)[:_ENOUGH_STEPS]
    is_after = np.zeros(len(moved_a) + _ANSWERS, bool)
    is_after[steps[:, None] + np.arange(_ANSWERS)] = True
    places = np.flatnonzero(is_after[: len(moved_a)])
    places = places[places >= _ANSWERS - 1]
    window = places[:, None] - np.arange(_ANSWERS)
    usual_s = float(np.median(interval_s))
    is_even = np.all(np.abs(interval_s[window] - usual_s) < 0.1 * usual_s, axis=1)
    places, window = places[is_even], window[is_even]
    if len(places) < _FEWEST_STEPS:
        return None
    # The current before the steps and a constant stand for all that is slow.
    before_a = record.current_a[window[:, -1]]
    design = np.column_stack([moved_a[window], before_a, np.ones(len(places))])
    moved_v = np.diff(record.voltage_v)[places]
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    inverse = np.linalg.inv(design.T @ design)
    answers = -inverse @ (design.T @ moved_v)
    error_v = moved_v + design @ answers
    variance_v2 = float(error_v @ error_v) / (len(moved_v) - len(answers))
    return answers[:_ANSWERS], variance_v2 * inverse[:_ANSWERS, :_ANSWERS]


def late_answers_ohm(record: Record) -> tuple[float, float, float] | None:
    """The answers of the voltage to a step of the current at once, one sample later and after that.

    None where nothing is late. A second answer far above what the third leaves it is late.
    """
    return late_of(answers_ohm(record))


def late_of(known: Known | None) -> tuple[float, float, float] | None:
    """The first three answers, if the second is late."""
    if known is None:
        return None
    answers, covariance = known
    late = np.zeros(len(answers))
    late[1:3] = 1, -LASTING
    ohm, whole = float(late @ answers), float(answers[0] + answers[1])
    error_ohm = np.sqrt(late @ covariance @ late)
    if not ohm > max(_LATE_SHARE * whole, LATE_SURE * error_ohm) or np.min(answers[:2]) <= 0:
        return None
    first, second, third = answers[:3].tolist()
    return first, second, third
