"""The tables and sentences of the page."""

from collections.abc import Iterator, Sequence

import numpy as np

from barnax.comparison_statistics import Resampled, compare_over_time
from barnax.evaluate import Evaluation

from .cases import EXACT, MODELS, Ran

RECORDS = ("identification", "validation")


def summary_table(runs: Sequence[Ran]) -> Iterator[str]:
    """The best circuit of every model on every cell."""
    heads = [f"{model} {record} [mV]" for record in RECORDS for model in MODELS]
    yield f"| cell | {' | '.join(heads)} |"
    yield "|---" * (1 + len(heads)) + "|"
    for ran in runs:
        cells = [
            f"{1e3 * each[f'{EXACT} {model}'].metrics.rmse_v:.2f}"
            for each in (ran.identification, ran.validation)
            for model in MODELS
        ]
        yield f"| {ran.case.name} | {' | '.join(cells)} |"


def differences_table(runs: Sequence[Ran]) -> Iterator[str]:
    """What each hysteresis brings over the plain circuit, and the dynamic one over the switch."""
    pairs = (("iso-rc", "so-rc"), ("esc", "so-rc"), ("esc", "iso-rc"))
    heads = [f"{first} minus {second} [mV]" for first, second in pairs]
    yield f"| cell | record | {' | '.join(heads)} |"
    yield "|---|---|---|---|---|"
    for ran in runs:
        for place, record in enumerate(RECORDS):
            cells = [_difference(difference(ran, record, *pair)) for pair in pairs]
            yield f"| {'' if place else ran.case.name} | {record} | {' | '.join(cells)} |"


def difference(ran: Ran, record: str, first: str, second: str) -> Resampled:
    """How the best circuits of two models differ on one record."""
    evaluations = ran.identification if record == "identification" else ran.validation
    errors = [_scored(evaluations[f"{EXACT} {model}"]) for model in (first, second)]
    return compare_over_time(*errors)


def conditions_table(runs: Sequence[Ran]) -> Iterator[str]:
    """What each record does to the hysteresis."""
    yield (
        "| cell | record | half the gap, rms [mV] | charged / discharged | switches of Sig an hour "
        "| SOC between switches, median [%] | 1 / gamma of esc [% SOC] |"
    )
    yield "|---|---|---|---|---|---|---|"
    for ran in runs:
        gamma = ran.exact("esc").median.parameters.gamma or np.nan
        for place, (record, condition) in enumerate(zip(RECORDS, ran.conditions, strict=True)):
            cells = (
                "" if place else ran.case.name,
                record,
                f"{1e3 * condition.half_gap_v:.1f}",
                f"{condition.charging_share:.2f}",
                f"{condition.switches_per_hour:.0f}",
                f"{100 * condition.soc_between_switches:.3f}",
                "" if place else f"{100 / gamma:.2g}",
            )
            yield f"| {' | '.join(cells)} |"


def rows_table(ran: Ran) -> Iterator[str]:
    """Every row on one cell."""
    yield (
        "| row | median [mV] | best | worst | refined | regret [%] | 0-10 % SOC | 10-20 % "
        "| 20-100 % | max | validation [mV] | at a bound, notes |"
    )
    yield "|---" * 12 + "|"
    for row in ran.comparison.rows:
        if row.failure is not None or row.refined is None:
            yield f"| {row.name} | {' | '.join('-' * 10)} | {row.failure} |"
            continue
        errors_v = row.errors_v
        spread = ("-", "-") if row.is_deterministic else _millivolts(errors_v.min(), errors_v.max())
        regret = 0.0 if row.regret is None or abs(row.regret) < 1e-9 else 100 * row.regret
        cells = [
            row.name,
            *_millivolts(row.median.rmse_v),
            *spread,
            *_millivolts(row.refined.rmse_v),
            f"{regret:.2g}",
            *_millivolts(*(band.rmse_v for band in row.bands[0])),
            *_millivolts(row.evaluations[0].metrics.max_v),
            *_millivolts(ran.validation[row.name].metrics.rmse_v),
            "; ".join([*row.at_bound, *row.notes]) or "-",
        ]
        yield f"| {' | '.join(cells)} |"


def verdict_sentences(ran: Ran) -> Iterator[str]:
    """Where hysteresis helps on one cell, and why, from the numbers."""
    for model, what in (("iso-rc", "The switched hysteresis"), ("esc", "The dynamic hysteresis")):
        yield f"- {what} {' and '.join(_change(ran, record, model) for record in RECORDS)}."
    condition, _ = ran.conditions
    plain_v = ran.identification[f"{EXACT} so-rc"].metrics.rmse_v
    yield (
        f"- Half the gap is {1e3 * condition.half_gap_v:.1f} mV rms where the error of so-rc is "
        f"{1e3 * plain_v:.1f} mV. No hysteresis of that size, however it moves, can change the "
        "RMSE of one circuit by more than that."
    )
    parameters = ran.exact("esc").median.parameters
    if parameters.gamma is not None:
        turn, between = 1 / parameters.gamma, condition.soc_between_switches
        relation = (
            "so Sig, which turns at once, is ahead of the cell most of the time"
            if turn > 2 * between
            else "so a switch is no bad picture of it"
        )
        yield (
            f"- The direction switches {condition.switches_per_hour:.0f} times an hour, after "
            f"{100 * between:.2g} % SOC in the median; the dynamic hysteresis that fits best turns "
            f"within about 1 / gamma = {100 * turn:.2g} % SOC, {relation}."
        )
    above = [_above(ran.identification[f"{EXACT} {model}"]) for model in MODELS]
    shown = ", ".join(
        f"{model} {1e3 * value:.1f} mV" for model, value in zip(MODELS, above, strict=True)
    )
    yield f"- Above 10 % SOC, of the same circuits: {shown}."


def _change(ran: Ran, record: str, model: str) -> str:
    found = difference(ran, record, model, "so-rc")
    verb = "raises" if found.difference_v > 0 else "lowers"
    sure = "" if found.is_real else " (no more than chance)"
    return f"{verb} the {record} error by {1e3 * abs(found.difference_v):.2f} mV{sure}"


def _difference(found: Resampled) -> str:
    mark = "" if found.is_real else " (n.s.)"
    low, high = 1e3 * found.low_v, 1e3 * found.high_v
    return f"{1e3 * found.difference_v:+.2f} [{low:+.2f}, {high:+.2f}]{mark}"


def _above(evaluation: Evaluation, soc: float = 0.1) -> float:
    course = evaluation.course
    counted = course.scored & (course.soc >= soc)
    return float(np.sqrt(np.mean(evaluation.error_v[counted] ** 2)))


def _scored(evaluation: Evaluation) -> np.ndarray:
    return evaluation.error_v[evaluation.course.scored]


def _millivolts(*values_v: float | None) -> list[str]:
    return ["-" if value_v is None else f"{1e3 * value_v:.2f}" for value_v in values_v]
