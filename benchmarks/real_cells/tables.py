"""The tables and sentences of the page."""

from collections.abc import Iterator, Sequence

import numpy as np

from barnax.baselines import METHODS
from barnax.comparison.statistics import Resampled, compare_over_time
from barnax.reporting.words import symbol
from barnax.search.evaluate import Evaluation

from .cases import EXACT, MODELS, Ran

ROLES = ("identification", "validation")
PAIRS = (("iso-rc", "so-rc"), ("esc", "so-rc"), ("esc", "iso-rc"))


def summary_table(runs: Sequence[Ran]) -> Iterator[str]:
    """The best circuit of every model on every cell."""
    heads = [f"{model} {role} [mV]" for role in ROLES for model in MODELS]
    yield f"| cell | {' | '.join(heads)} |"
    yield "|---" * (1 + len(heads)) + "|"
    for ran in runs:
        cells = [
            f"{1e3 * ran.records[role][f'{EXACT} {model}'].metrics.rmse_v:.2f}"
            if role in ran.records
            else "-"
            for role in ROLES
            for model in MODELS
        ]
        yield f"| {ran.name} | {' | '.join(cells)} |"


def differences_table(runs: Sequence[Ran]) -> Iterator[str]:
    """What each hysteresis brings over the plain circuit, and the dynamic one over the switch."""
    heads = [f"{first} minus {second} [mV]" for first, second in PAIRS]
    yield f"| cell | record | {' | '.join(heads)} |"
    yield "|---|---|---|---|---|"
    for ran in runs:
        for place, role in enumerate(ran.records):
            cells = [_shown(difference(ran, role, *pair)) for pair in PAIRS]
            yield f"| {'' if place else ran.name} | {role} | {' | '.join(cells)} |"


def count_sentences(runs: Sequence[Ran]) -> Iterator[str]:
    """On how many records each model is better than another by more than chance."""
    for first, second in PAIRS:
        found = [difference(ran, role, first, second) for ran in runs for role in ran.records]
        better = sum(each.interval_v[1] < 0 for each in found)
        worse = sum(each.interval_v[0] > 0 for each in found)
        yield (
            f"- {first} against {second}: better by more than chance on {better} of {len(found)} "
            f"records, worse on {worse}; the median difference is "
            f"{1e3 * np.median([each.difference_v for each in found]):+.2f} mV."
        )


def difference(ran: Ran, role: str, first: str, second: str) -> Resampled:
    """How the best circuits of two models differ on one record."""
    one, other = (ran.records[role][f"{EXACT} {model}"] for model in (first, second))
    return compare_over_time(_scored(one), _scored(other))


def conditions_table(runs: Sequence[Ran]) -> Iterator[str]:
    """What each record does to the hysteresis."""
    yield (
        "| cell | record | half the gap, rms [mV] | charged / discharged | switches of Sig an hour "
        "| SOC between switches, median [%] | 1 / gamma of esc [% SOC] |"
    )
    yield "|---|---|---|---|---|---|---|"
    for ran in runs:
        gamma = ran.exact("esc").median.parameters.gamma or np.nan
        for place, role in enumerate(ran.records):
            condition = ran.condition(role)
            cells = (
                "" if place else ran.name,
                role,
                f"{1e3 * condition.half_gap_v:.1f}",
                f"{condition.charging_share:.2f}",
                f"{condition.switches_per_hour:.0f}",
                f"{100 * condition.soc_between_switches:.3f}",
                "" if place else f"{100 / gamma:.3g}",
            )
            yield f"| {' | '.join(cells)} |"


def rows_table(ran: Ran) -> Iterator[str]:
    """Every row on one cell."""
    yield (
        "| row | median [mV] | best | worst | refined | optimality gap [%] | 0-10 % SOC | 10-20 % "
        "| 20-100 % | max | validation [mV] | at a bound, notes |"
    )
    yield "|---" * 12 + "|"
    for row in ran.comparison.rows:
        if row.failure is not None or row.refined is None:
            yield f"| {row.name} | {' | '.join('-' * 10)} | {row.failure} |"
            continue
        errors_v = row.errors_v
        spread = ("-", "-")
        if not METHODS[row.method].is_deterministic:
            spread = _millivolts(errors_v.min(), errors_v.max())
        bands = row.errors[0].bands
        at_bounds = [f"{symbol(each.name)} at its {each.side} bound" for each in row.at_bound]
        optimality_gap = (
            0.0
            if row.optimality_gap is None or abs(row.optimality_gap) < 1e-9
            else 100 * row.optimality_gap
        )
        cells = [
            row.name,
            *_millivolts(row.median.rmse_v),
            *spread,
            *_millivolts(row.refined.rmse_v),
            f"{optimality_gap:.2g}",
            *_millivolts(*(band.rmse_v for band in bands)),
            *_millivolts(row.evaluations[0].metrics.max_v),
            *_millivolts(ran.validation[row.name].metrics.rmse_v if ran.validation else None),
            "; ".join([*at_bounds, *row.median.notes]) or "-",
        ]
        yield f"| {' | '.join(cells)} |"


def verdict_sentences(ran: Ran) -> Iterator[str]:
    """Where hysteresis helps on one cell, and why, from the numbers."""
    for model, what in (("iso-rc", "The switched hysteresis"), ("esc", "The dynamic hysteresis")):
        yield f"- {what} {' and '.join(_change(ran, role, model) for role in ran.records)}."
    condition = ran.condition("identification")
    plain_v = ran.identification[f"{EXACT} so-rc"].metrics.rmse_v
    yield (
        f"- Half the gap is {1e3 * condition.half_gap_v:.1f} mV rms where the error of so-rc is "
        f"{1e3 * plain_v:.1f} mV. No hysteresis of that size, however it moves, can change the "
        "RMSE of one circuit by more than that."
    )
    yield _turning(ran)
    above = [_above(ran.identification[f"{EXACT} {model}"]) for model in MODELS]
    shown = ", ".join(
        f"{model} {1e3 * value:.1f} mV" for model, value in zip(MODELS, above, strict=True)
    )
    yield f"- Above 10 % SOC, of the same circuits: {shown}."


def _turning(ran: Ran) -> str:
    """How fast the hysteresis turns, and how often it is asked to."""
    condition, exact = ran.condition("identification"), ran.exact("esc")
    turn = 1 / (exact.median.parameters.gamma or np.nan)
    between = condition.soc_between_switches
    if any(each.name == "gamma" for each in exact.at_bound):
        relation = "and that is the box's end: these data do not want the hysteresis to turn"
    elif turn > 2 * between:
        relation = "so Sig, which turns at once, is ahead of the cell most of the time"
    else:
        relation = "so a switch is no bad picture of it"
    return (
        f"- The direction switches {condition.switches_per_hour:.0f} times an hour, after "
        f"{100 * between:.2g} % SOC in the median; the dynamic hysteresis that fits best turns "
        f"within about 1 / gamma = {100 * turn:.3g} % SOC, {relation}."
    )


def _change(ran: Ran, role: str, model: str) -> str:
    found = difference(ran, role, model, "so-rc")
    verb = "raises" if found.difference_v > 0 else "lowers"
    sure = "" if found.is_real else " (no more than chance)"
    return f"{verb} the {role} error by {1e3 * abs(found.difference_v):.2f} mV{sure}"


def _shown(found: Resampled) -> str:
    mark = "" if found.is_real else " (n.s.)"
    low, high = (1e3 * end for end in found.interval_v)
    return f"{1e3 * found.difference_v:+.2f} [{low:+.2f}, {high:+.2f}]{mark}"


def _above(evaluation: Evaluation, soc: float = 0.1) -> float:
    prepared = evaluation.prepared
    counted = prepared.scored & (prepared.soc >= soc)
    return float(np.sqrt(np.mean(evaluation.error_v[counted] ** 2)))


def _scored(evaluation: Evaluation) -> np.ndarray:
    return evaluation.error_v[evaluation.prepared.scored]


def _millivolts(*values_v: float | None) -> list[str]:
    return ["-" if value_v is None else f"{1e3 * value_v:.2f}" for value_v in values_v]
