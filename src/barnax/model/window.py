"""The part of a record that is simulated, and the samples at which errors count."""

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..records import Record
from ..settings import Window


def first_sample(record: Record, window: Window) -> int:
    """Index of the sample where the simulation starts. Raises `InputError` if there is none."""
    if window.start_time_s is not None:
        after = np.flatnonzero(record.time_s >= window.start_time_s)
        if not len(after) or window.start_time_s < record.time_s[0]:
            raise InputError(
                f"{record.name}: `start_time` {window.start_time_s} s lies outside the record, "
                f"whose clock runs from {record.time_s[0]:g} to {record.time_s[-1]:g} s"
            )
        return int(after[0])
    if window.start_after_step is not None:
        inside = np.flatnonzero(_steps(record, "start_after_step") == window.start_after_step)
        if not len(inside):
            raise InputError(_no_such_step(record, window.start_after_step))
        return int(inside[-1])
    return 0


def scored_samples(
    record: Record, window: Window, first: int, soc: Float[np.ndarray, "samples"]
) -> Bool[np.ndarray, "samples"]:
    """True where errors count, over the whole record. Raises `InputError` if nowhere."""
    scored = np.arange(record.samples) >= first
    if window.score_steps is not None:
        steps = _steps(record, "score_steps")
        for step in window.score_steps:
            if not np.any(steps == step):
                raise InputError(_no_such_step(record, step))
        scored &= np.isin(steps, window.score_steps)
    if window.score_from_s is not None:
        scored &= record.time_s >= window.score_from_s
    if window.score_to_s is not None:
        scored &= record.time_s <= window.score_to_s
    if window.score_soc is not None:
        low, high = window.score_soc
        scored &= (soc >= low) & (soc <= high)
    if not np.any(scored):
        raise InputError(
            f"{record.name}: no sample is left to score after the start at "
            f"{record.time_s[first]:g} s; widen `score_steps`, `score_from`, `score_to` or "
            "`score_soc`"
        )
    return scored


def _steps(record: Record, option: str) -> np.ndarray:
    if record.step is None:
        raise InputError(
            f"{record.name}: `{option}` needs a step column, and the file has none; use "
            "`start_time`, `score_from` and `score_to` instead"
        )
    return record.step


def _no_such_step(record: Record, step: int) -> str:
    present = ", ".join(str(number) for number in np.unique(_steps(record, "start_after_step")))
    return f"{record.name}: there is no step {step}; the file has steps {present}"
