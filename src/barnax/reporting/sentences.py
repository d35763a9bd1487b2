"""Findings in words: each function reads a result's numbers and makes its sentences.

Options are named as in Python and stand in backticks, `initial_soc=0.9312`; nothing else does.
"""

import math
from collections.abc import Iterator, Sequence
from decimal import ROUND_CEILING, Context
from typing import TYPE_CHECKING, Literal

from ..cell.elements import alike
from ..global_optimum.search import FACTOR, optimality_gap
from ..search.refine import AtBound
from ..uncertainty.assessment import Band, Diagnostics
from ..uncertainty.covariance import WIDEST_FACTOR, Estimate, Held, Uncertainty
from ..uncertainty.identifiability import Identifiability, Undetermined
from .words import (
    between,
    extent,
    figures,
    interval,
    joined,
    percent,
    symbol,
    with_unit,
)

if TYPE_CHECKING:
    from ..global_optimum import GlobalOptimum
    from ..result_parts import GlobalPart

# Rounded up, since a claim may not say more than was proved.
ROUNDED_UP = Context(prec=1, rounding=ROUND_CEILING)
# Another optimum within this share of the best one is nearly as good.
HARDLY_ABOVE = 0.01
# A band is worth a sentence where its share of the squared error is this many times its samples'.
NOTABLE = 2.0
NOTABLE_SHARE = 0.2
NUMBERS = ("no", "one", "two", "three", "four")
# Possible causes of a drift over the whole record.
DRIFT = (
    "Such a drift often means a wrong `capacity` or `initial_soc`, or a part of the SOC range that "
    "`score_soc` can leave out"
)

BandQuantity = Literal["SOC", "current", "temperature"]


def optimum_words(optimum: "GlobalOptimum | GlobalPart") -> str:
    """The evidence that the circuit is the best one."""
    elements = optimum.parameters.elements
    kind = f"{NUMBERS[len(elements)]}-RC circuit"
    if alike(elements) < len(elements):
        kind = f"circuit of {joined(elements)}"
    which = f"no {kind} in the bounds is"
    # Rounded up, and without an exponent.
    better = f"{which} {better_than(optimum.proved_gap)}"
    if optimum.status == "certified":
        return f"proved, {better}"
    grid = "verified on a grid of time constants"
    if optimum.boxes is None:
        return f"{grid}, not proved"
    return f"{grid}; the proof stopped after {optimum.boxes:,} boxes: {better}"


def better_than(proved_gap: float) -> str:
    """The gain that no circuit exceeds, by the proof."""
    return f"more than {rounded_up(proved_gap)} better" if proved_gap > 0 else "better"


def rounded_up(proved_gap: float) -> str:
    """What was proved, in percent."""
    return f"{ROUNDED_UP.create_decimal(repr(100 * proved_gap)):f} %" if proved_gap else "0 %"


def local_optima_sentence(optimum: "GlobalOptimum | GlobalPart") -> str:
    """The other optima, the nearest in error with its time constants."""
    others, reach = optimum.local_optima, f"less than {percent(FACTOR - 1)} above the best one"
    if not others:
        return f"No other local optimum is {reach}."
    nearest = others[0].parameters
    ohms = joined([with_unit("R [Ohm]", ohm) for ohm in (nearest.r0, *nearest.r)])
    where = f"{_nearest_gap(optimum)} above at {_taus(nearest.tau_s)} (R0 and R: {ohms})"
    if nearly_as_good(optimum):
        where += ", a different circuit with nearly the same error"
    if len(others) == 1:
        return f"One other local optimum is {reach}: {where}."
    return f"{len(others)} other local optima are {reach}, the nearest {where}."


def nearly_as_good(optimum: "GlobalOptimum | GlobalPart") -> str:
    """A different circuit that has nearly the same error, empty where there is none."""
    others = optimum.local_optima
    if not others or others[0].rmse_v >= (1 + HARDLY_ABOVE) * optimum.rmse_v:
        return ""
    where = _taus(others[0].parameters.tau_s)
    return f"A different circuit, with {where}, is only {_nearest_gap(optimum)} worse."


def _nearest_gap(optimum: "GlobalOptimum | GlobalPart") -> str:
    return percent(optimality_gap(optimum.local_optima[0].rmse_v, optimum.rmse_v))


def _at_bounds(at_bound: Sequence[AtBound]) -> str:
    parts = []
    for side in ("lower", "upper"):
        names = [symbol(bound.name) for bound in at_bound if bound.side == side]
        if names:
            whose = f"their {side} bounds" if len(names) > 1 else f"its {side} bound"
            parts.append(f"{joined(names)} at {whose}")
    return joined(parts)


def held_words(held: Held) -> str:
    """Why a parameter was not free.

    >>> held_words("at upper bound")
    'at its upper bound'
    """
    if held == "unseen":
        return "no scored sample depends on it"
    return held.replace("at ", "at its ")


def uncertainty_sentence(uncertainty: Uncertainty) -> str:
    """The inflation of the intervals over those for independent residuals."""
    inflations = [
        estimate.inflation for estimate in uncertainty.estimates if estimate.inflation is not None
    ]
    if not inflations:
        return "No parameter was free, so none has an interval."
    factors = extent(inflations, form=".2g")
    return (
        f"The {100 * uncertainty.confidence:.0f} % intervals allow for correlated residuals: the "
        f"inflation factor over white-noise standard errors is {factors}."
    )


def identifiability_sentences(identifiability: Identifiability) -> tuple[str, ...]:
    """A sentence for everything that the data do not determine."""
    found = tuple(finding_sentence(finding) for finding in identifiability.findings)
    return found or ("The data determine every free parameter.",)


def finding_sentence(finding: Undetermined) -> str:
    """One thing that the data do not determine, and what they determine instead."""
    first, *others = finding.estimates
    name, value = symbol(first.name), with_unit(first.name, first.value)
    combined = "" if finding.combined is None else _with_interval(finding.combined)
    match finding.kind:
        case "too fast":
            return f"{_too_fast(finding, combined)}."
        case "too slow":
            return f"{_too_slow(finding)}."
        case "alike":
            return (
                f"{name} = {value} and {_equation(others[0])} cannot be distinguished: only "
                f"{combined} is determined."
            )
        case "at bound":
            if first.held == "unseen":
                return f"{name} is not determined: no scored sample depends on it."
            where = held_words(first.held or "fixed")
            is_open = first.low is not None or first.high is None
            most = "" if is_open else f"; it is {interval(first.name, None, first.high)}"
            return f"{name} = {value} is {where}: the bounds set it, not the data{most}."
        case "loose":
            return f"{_loose(finding)}."
        case "direction":
            moves = [
                f"{symbol(estimate.name)} {_times(step)}"
                for estimate, step in zip(finding.estimates, finding.log_steps, strict=True)
            ]
            text = f"{joined(moves)}, changed together, stay within one standard error"
            return f"{text}; {combined} is determined." if combined else f"{text}."


def _too_fast(finding: Undetermined, combined: str) -> str:
    tau, *others = finding.estimates
    pair = symbol(tau.name).removeprefix("tau")
    text = f"tau{pair} = {tau.value:.2g} s is too fast for {figures(finding.interval_s)} s sampling"
    if others:
        return f"{text}: R{pair} cannot be separated from R0, only {combined} is determined"
    text += f": {combined} is determined, tau{pair} is not"
    if tau.held == "at lower bound":
        text += "; it is at its lower bound, and wider `bounds` would show how fast it can be"
    return text


def _too_slow(finding: Undetermined) -> str:
    tau, resistance = finding.estimates
    capacitance = finding.combined
    text = f"{symbol(tau.name)} is as long as the record ({_seconds(finding.duration_s)}) or longer"
    if capacitance is None or capacitance.low is None:
        text += f", and not even {symbol(tau.name).replace('tau', 'C')} is determined"
    else:
        text += f": only {_with_interval(capacitance)} is determined"
    at_bound = [
        AtBound(estimate.name, "lower" if estimate.held == "at lower bound" else "upper")
        for estimate in (tau, resistance)
        if estimate.held in ("at lower bound", "at upper bound")
    ]
    if not at_bound:
        return text
    return f"{text}, with {_at_bounds(at_bound)}. {DRIFT}"


def _loose(finding: Undetermined) -> str:
    (estimate,) = finding.estimates
    name = symbol(estimate.name)
    if estimate.low is None or estimate.high is None:
        return f"{name} is {interval(estimate.name, estimate.low, estimate.high)}"
    text = f"{name} is only known to be {between(estimate.name, estimate.low, estimate.high)}"
    if name.startswith("tau") and estimate.low < finding.interval_s / 2:
        text += f"; it may be too fast for {figures(finding.interval_s)} s sampling"
    if name.startswith("tau") and estimate.high > finding.duration_s:
        text += f"; it may be longer than the record ({_seconds(finding.duration_s)})"
    return text


def diagnostics_sentences(diagnostics: Diagnostics) -> tuple[str, ...]:
    """The correlation time of the residuals, and the bands with most of the squared error."""
    count = f"{max(diagnostics.effective_samples, 1):,.0f}"
    independent = "a single independent one" if count == "1" else f"{count} independent ones"
    sentences = [
        f"Residual correlation time {_seconds(diagnostics.correlation_time_s)}: "
        f"{diagnostics.samples:,} samples carry as much information about a constant as "
        f"{independent}."
    ]
    kinds: tuple[tuple[BandQuantity, tuple[Band, ...] | None], ...] = (
        ("SOC", diagnostics.by_soc),
        ("current", diagnostics.by_current),
        ("temperature", diagnostics.by_temperature),
    )
    for quantity, bands in kinds:
        sentences += _notable(quantity, bands or ())
    return tuple(sentences)


def band_label(quantity: BandQuantity, band: Band) -> str:
    """A band of SOC, current or temperature in a table.

    >>> band_label("SOC", Band(0.1, 0.2, 1, 0.0, 0.0, 0.0))
    '10 to 20 %'
    >>> band_label("current", Band(-0.2, -0.05, 1, 0.0, 0.0, 0.0))
    'charge 0.05 to 0.2 C'
    >>> band_label("current", Band(-0.05, 0.05, 1, 0.0, 0.0, 0.0))
    'rest'
    """
    if quantity == "SOC":
        return f"{100 * (band.low or 0.0):.0f} to {100 * (band.high or 0.0):.0f} %"
    if quantity == "temperature":
        return f"{band.low:g} to {band.high:g} degC"
    if band.low is not None and band.high is not None and band.low < 0 < band.high:
        return "rest"
    ends = sorted(abs(end) for end in (band.low, band.high) if end is not None)
    way = "charge" if (band.high or 0.0) < 0 else "discharge"
    size = f"above {ends[0]:.2g}" if len(ends) == 1 else f"{ends[0]:.2g} to {ends[1]:.2g}"
    return f"{way} {size} C"


def _notable(quantity: BandQuantity, bands: Sequence[Band]) -> Iterator[str]:
    samples = sum(band.samples for band in bands)
    for band in bands:
        if band.share > NOTABLE_SHARE and band.share > NOTABLE * band.samples / samples:
            where = f"at {band_label(quantity, band)}"
            if quantity == "SOC":
                where = (
                    f"below {100 * (band.high or 0.0):.0f} % SOC"
                    if not band.low
                    else f"{where} SOC"
                )
            yield (
                f"{100 * band.share:.0f} % of the squared error is {where}, with "
                f"{percent(band.samples / samples)} of the samples (RMSE {_mv(band.rmse_v)}, mean "
                f"{1e3 * band.mean_v:+.3g} mV)."
            )


def _equation(estimate: Estimate) -> str:
    return f"{symbol(estimate.name)} = {with_unit(estimate.name, estimate.value)}"


def _with_interval(estimate: Estimate) -> str:
    if estimate.low is None and estimate.high is None:
        return _equation(estimate)
    return f"{_equation(estimate)} ({interval(estimate.name, estimate.low, estimate.high)})"


def _times(log_step: float) -> str:
    """A factor; beyond `WIDEST_FACTOR` nothing is known of its size."""
    if abs(log_step) > math.log(WIDEST_FACTOR):
        less = f"less than {1 / WIDEST_FACTOR:g}"
        return f"times {less if log_step < 0 else f'more than {WIDEST_FACTOR:g}'}"
    return f"times {math.exp(log_step):.2g}"


def _taus(tau_s: Sequence[float]) -> str:
    return f"tau {joined([_seconds(tau) for tau in tau_s])}"


def _seconds(time_s: float) -> str:
    return with_unit("time [s]", time_s)


def _mv(voltage_v: float) -> str:
    return f"{figures(1e3 * voltage_v)} mV"
