"""What the data determine: collinear parameters, time constants out of sight, bounds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float

from ..search.refine import Refinement
from .covariance import WIDEST_FACTOR, Estimate, Uncertainty, direction_of, named_values
from .linearization import Linearization

MILLI = {"Ohm": "mOhm"}


def symbol(name: str) -> str:
    """`R1` of `R1 [Ohm]`."""
    return name.split(" [")[0]


def with_unit(name: str, value: float) -> str:
    """A value to three figures, resistances in mOhm.

    >>> with_unit("R1 [Ohm]", 0.0149)
    '14.9 mOhm'
    """
    unit = name.partition(" [")[2].rstrip("]")
    if unit in MILLI:
        value, unit = 1e3 * value, MILLI[unit]
    return f"{figures(value)} {unit}".rstrip()


def figures(value: float) -> str:
    """Three figures, without an exponent where it can be helped.

    >>> figures(0.1), figures(212403.8), figures(7.0), figures(9.994e12)
    ('0.1', '212000', '7', '9.99e+12')
    """
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if 1000 <= abs(rounded) < 1e9 else f"{rounded:g}"


def joined(words: list[str], last: str = "and") -> str:
    """`a, b and c`."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


# A combination is worth telling where its interval is this much narrower than its members'.
SHARPER = 1 / 3


def sum_of(
    names: Sequence[str],
    values: dict[str, float],
    linearization: Linearization,
    uncertainty: Uncertainty,
) -> Estimate:
    """Some resistances together in ohm, with the interval of the sum."""
    total = sum(values[name] for name in names)
    direction = sum(values[name] / total * direction_of(name, linearization)[0] for name in names)
    label = " + ".join(symbol(name) for name in names)
    return uncertainty.of(f"{label} [Ohm]", total, np.asarray(direction))


def is_sharper(total: Estimate, members: list[Estimate]) -> bool:
    """Whether the total is known far better than any of its members."""
    errors = [each.relative_error for each in members if each.relative_error is not None]
    if total.low is None or total.relative_error is None or len(errors) < len(members):
        return False
    return total.relative_error < SHARPER * min(errors)


def sharper_words(
    names: Sequence[str],
    values: dict[str, float],
    linearization: Linearization,
    uncertainty: Uncertainty,
) -> str:
    """What to append on a sum of resistances or a capacitance among `names` known far better."""
    found = []
    resistances = [name for name in names if name.startswith("R")]
    for size in range(2, len(resistances) + 1):
        for members in combinations(sorted(resistances), size):
            total = sum_of(members, values, linearization, uncertainty)
            if is_sharper(total, [uncertainty[name] for name in members]):
                found.append(total)
    for name in resistances:
        pair = name[1]
        members = [name, f"tau{pair} [s]"]
        if members[1] in names and is_sharper(
            uncertainty[f"C{pair} [F]"], [uncertainty[m] for m in members]
        ):
            found.append(uncertainty[f"C{pair} [F]"])
    if not found:
        return ""
    best = min(found, key=lambda each: each.relative_error)
    return f"; what they have in common, {symbol(best.name)}, is determined{value_words(best)}"


def value_words(estimate: Estimate) -> str:
    """The value with its interval, to append to a sentence."""
    value = with_unit(estimate.name, estimate.value)
    if estimate.low is None or estimate.high is None:
        return f" ({value})"
    low, high = (with_unit(estimate.name, end) for end in (estimate.low, estimate.high))
    return f" ({value}, between {low} and {high})"


# Brun, Reichert, Kuensch, Water Resources Research 37 (2001) 1015: above 10 to 15 parameters can
# hardly be told apart.
COLLINEAR = 15.0
# A parameter whose interval ends more than this factor away from its value is hardly determined.
LOOSE_FACTOR = 2.0
# A time constant at its bound, 0.1 % of the box's log width, is this close to it.
NEAR_LIMIT = 0.01
# Singular values under this share of the largest are rounding.
LEAST_SHARE = 1e-12
# What changes by less than this in a direction is not part of it.
PART_OF_DIRECTION = 0.1


@dataclass(frozen=True)
class Finding:
    """One thing the data do not determine, and the parameters it is about."""

    kind: str
    parameters: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class Identifiability:
    """How well the free parameters can be told apart.

    `collinearity_index` is Brun's gamma of all of them: a change of one of them by 1 can be made
    up by the others down to 1/gamma of its effect. `collinear_pairs` are the pairs whose own
    index is above `COLLINEAR`. `condition_number` is that of the columns scaled to length 1.
    """

    collinearity_index: float
    condition_number: float
    collinear_pairs: tuple[tuple[str, str, float], ...]
    findings: tuple[Finding, ...]

    @property
    def words(self) -> str:
        if not self.findings:
            return "The data determine every free parameter."
        return " ".join(finding.text for finding in self.findings)

    def to_dict(self) -> dict[str, Any]:
        return {
            "collinearity_index": self.collinearity_index,
            "condition_number": self.condition_number,
            "collinear_pairs": [list(pair) for pair in self.collinear_pairs],
            "findings": [
                {"kind": each.kind, "parameters": list(each.parameters), "text": each.text}
                for each in self.findings
            ],
        }


def identifiability(
    refinement: Refinement, linearization: Linearization, uncertainty: Uncertainty
) -> Identifiability:
    """What a refined answer's record determines and what it leaves open."""
    values = named_values(refinement.parameters)
    prepared_records = refinement.search.problem.prepared_records
    interval_s = min(prepared.median_interval_s for prepared in prepared_records)
    duration_s = max(prepared.scored_duration_s for prepared in prepared_records)
    pairs = range(1, refinement.parameters.pairs + 1)
    told: set[str] = set()
    findings: list[Finding] = []

    def add(found: Sequence[Finding]) -> None:
        for finding in found:
            findings.append(finding)
            told.update(finding.parameters)

    add(
        [
            each
            for k in pairs
            for each in _too_fast(k, values, linearization, uncertainty, interval_s)
        ]
    )
    add(
        [
            each
            for k in pairs
            for each in _too_slow(k, values, linearization, uncertainty, duration_s)
        ]
    )
    add([each for k in pairs[:-1] for each in _alike(k, values, linearization, uncertainty, told)])
    add(_at_bounds(linearization, values, told))
    add(_loose(uncertainty, told, interval_s, duration_s))
    add(_weak_directions(linearization, uncertainty, values))
    scaled = linearization.slope_v / np.linalg.norm(linearization.slope_v, axis=0)
    return Identifiability(
        collinearity_index=collinearity(scaled),
        condition_number=_condition(scaled),
        collinear_pairs=tuple(
            (linearization.names[i], linearization.names[j], index)
            for i, j in combinations(range(len(linearization.names)), 2)
            if (index := collinearity(scaled[:, [i, j]])) > COLLINEAR
        ),
        findings=tuple(findings),
    )


def collinearity(scaled: Float[np.ndarray, "samples columns"]) -> float:
    """Brun's collinearity index of columns of length 1 (2001, Eq. 11)."""
    return float(1 / np.maximum(_singular(scaled)[-1], LEAST_SHARE))


def _condition(scaled: Float[np.ndarray, "samples columns"]) -> float:
    singular = _singular(scaled)
    return float(singular[0] / max(singular[-1], LEAST_SHARE * singular[0]))


def _singular(scaled: np.ndarray) -> np.ndarray:
    """Singular values, a 1 where there are no columns: nothing is then collinear."""
    return np.linalg.svd(scaled, compute_uv=False) if scaled.size else np.ones(1)


def _too_fast(pair, values, linearization, uncertainty, interval_s) -> list[Finding]:
    """A pair that is over within a sampling interval: below half of it, as the default box.

    Where a current is held from its sample on, such a pair still answers one sample after R0, and
    a lively current tells the two apart; only its time constant is then hidden.
    """
    tau, resistance = f"tau{pair} [s]", f"R{pair} [Ohm]"
    if not values[tau] <= 0.5 * interval_s * (1 + NEAR_LIMIT):
        return []
    if not _is_tight(uncertainty[resistance]):
        members = ("R0 [Ohm]", resistance)
        total = sum_of(members, values, linearization, uncertainty)
        if not is_sharper(total, [uncertainty[name] for name in members]):
            return []
        text = (
            f"tau{pair} = {values[tau]:.2f} s cannot be told from a resistance at "
            f"{interval_s:.3g} s sampling: only R0 + R{pair} is determined"
        )
        return [Finding("too fast", (tau, *members[::-1]), f"{text}{value_words(total)}.")]
    if _is_tight(uncertainty[tau]) or linearization.held.get(tau) == "fixed":
        return []
    text = (
        f"tau{pair} = {values[tau]:.2f} s is shorter than {interval_s:.3g} s sampling can show: "
        f"R{pair} is determined{value_words(uncertainty[resistance])}, tau{pair} is not"
    )
    if tau in linearization.held:
        text += f" (it is {linearization.held[tau]}; a wider box would tell how short it may be)"
    return [Finding("too fast", (tau,), f"{text}.")]


def _too_slow(pair, values, linearization, uncertainty, duration_s) -> list[Finding]:
    """A pair that has no end within the record: to it, all that shows is its capacitance."""
    tau, resistance, capacitance = f"tau{pair} [s]", f"R{pair} [Ohm]", f"C{pair} [F]"
    if not values[tau] >= duration_s * (1 - 1e-3):
        return []
    is_open = uncertainty[capacitance].low is None
    certainty = "shows, itself with an open interval" if is_open else "is determined"
    text = (
        f"tau{pair} = {with_unit(tau, values[tau])} is as long as the record, "
        f"{with_unit(tau, duration_s)}, or longer: only R{pair}/tau{pair} {certainty}, which is "
        f"the capacitance C{pair}"
    )
    if tau in linearization.held:
        text += (
            f" ({with_unit(capacitance, values[capacitance])} with tau{pair} held there; a wider "
            "box would tell it better)"
        )
    else:
        text += value_words(uncertainty[capacitance])
    return [Finding("too slow", (tau, resistance), f"{text}.")]


def _alike(pair, values, linearization, uncertainty, told) -> list[Finding]:
    """Neighboring time constants whose ratio may as well be 1, where the sum is better known."""
    first, second = f"tau{pair} [s]", f"tau{pair + 1} [s]"
    if first in told or second in told:
        return []
    gap = math.log(values[second] / values[first])
    direction = _direction(second, linearization) - _direction(first, linearization)
    ratio = uncertainty.of("ratio", math.exp(gap), direction)
    if ratio.low is not None and ratio.high is not None and not ratio.low <= 1 <= ratio.high:
        return []
    resistances = (f"R{pair} [Ohm]", f"R{pair + 1} [Ohm]")
    total = sum_of(resistances, values, linearization, uncertainty)
    if not is_sharper(total, [uncertainty[name] for name in resistances]):
        return []
    text = (
        f"tau{pair} = {with_unit(first, values[first])} and tau{pair + 1} = "
        f"{with_unit(second, values[second])} cannot be told apart: of R{pair} and R{pair + 1} "
        "only the sum is determined"
    )
    return [Finding("alike", (first, second, *resistances), f"{text}{value_words(total)}.")]


def _at_bounds(
    linearization: Linearization, values: dict[str, float], told: set[str]
) -> list[Finding]:
    return [
        Finding(
            "at bound",
            (name,),
            f"{symbol(name)} = {with_unit(name, values[name])} is {reason}: the box decides, "
            "not the data.",
        )
        for name, reason in linearization.held.items()
        if reason != "fixed" and name not in told and name in values
    ]


def _loose(
    uncertainty: Uncertainty, told: set[str], interval_s: float, duration_s: float
) -> list[Finding]:
    findings = []
    for each in uncertainty.estimates:
        if each.name in told or each.name.startswith("C") or each.relative_error is None:
            continue
        if each.low is None or each.high is None:
            text = f"{symbol(each.name)} is not determined at all"
        elif not _is_tight(each):
            text = (
                f"{symbol(each.name)} is only known to lie between "
                f"{with_unit(each.name, each.low)} and {with_unit(each.name, each.high)}"
            )
        else:
            continue
        if each.name.startswith("tau") and each.low is not None and each.high is not None:
            if each.low < interval_s / 2:
                text += "; it may be faster than the sampling shows"
            if each.high > duration_s:
                text += "; it may be slower than the record shows"
        findings.append(Finding("loose", (each.name,), f"{text}."))
    return findings


def _weak_directions(
    linearization: Linearization, uncertainty: Uncertainty, values: dict[str, float]
) -> list[Finding]:
    """Changes of several parameters at once that the data do not notice."""
    variances, directions = np.linalg.eigh(uncertainty.covariance)
    findings = []
    for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True):
        if not math.log(LOOSE_FACTOR) < math.sqrt(max(variance, 0.0)):
            break
        step = direction * math.sqrt(variance)
        order = np.argsort(-np.abs(step))
        moving = [int(k) for k in order if abs(direction[k]) > PART_OF_DIRECTION]
        if len(moving) < 2:
            continue
        step = step * np.sign(step[moving[0]])
        moves = [f"{symbol(linearization.names[k])} {_times(step[k])}" for k in moving]
        text = f"{joined(moves)} at once is within one standard error"
        text += sharper_words(
            [linearization.names[k] for k in moving], values, linearization, uncertainty
        )
        findings.append(
            Finding("direction", tuple(linearization.names[k] for k in moving), f"{text}.")
        )
    return findings


def _times(step: float) -> str:
    """A change of a logarithm, in words; beyond `WIDEST_FACTOR` nothing is known of its size."""
    if abs(step) > math.log(WIDEST_FACTOR):
        return f"{WIDEST_FACTOR:g} times {'higher' if step > 0 else 'lower'} and beyond"
    return f"times {math.exp(step):.3g}"


def _is_tight(estimate: Estimate) -> bool:
    """Whether its interval ends within `LOOSE_FACTOR` of the value; not, where it has none."""
    return estimate.low is not None and estimate.value / estimate.low <= LOOSE_FACTOR


def _direction(name: str, linearization: Linearization) -> Float[np.ndarray, "free"]:
    return direction_of(name, linearization)[0]
