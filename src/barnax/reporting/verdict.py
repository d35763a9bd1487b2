"""The one verdict of a result, and the first screen: how good it is, and what to do next."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table as Shown
from rich.text import Text

from ..cell.curves import MISS_TOLERANCE_V, PolynomialCurve
from ..inputs import NOT_SUITABLE, OVER_TEMPERATURE
from ..over_soc.accuracy import WORTHWHILE
from ..over_soc.temperature import SAME_DEGC
from ..pipeline import FITTING_AGAIN
from .decisions import carried_sentences, guess_sentences
from .pulses import middle_heads, middle_pulses
from .sentences import (
    WORTH_TELLING,
    diagnostics_sentences,
    local_optima_sentence,
    nearly_as_good,
    optimum_words,
    option,
)
from .soc_tables import (
    best_of,
    expectation,
    middle_of_tables,
    pay_sentence,
    prediction_sentences,
    tables_pay,
    unseen_errors,
)
from .terminal import BARE, bare_table, headed_line, indented, plain
from .words import (
    between,
    capitalized,
    counted,
    degrees,
    duration,
    figures,
    joined,
    millivolt,
    percent,
    symbol,
    with_unit,
)

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..results import InputPart, MetricsPart, Result, TablesPart
    from ..uncertainty import Estimate

# Most of the squared error of most cells is where they are nearly empty.
LOW_SOC = 0.1
MUCH = 0.5
# Tables over SOC that would save so much of the error come before any other step.
HALF = 0.5
LONGEST_NAME = 40
UNFIT = f": {NOT_SUITABLE} identification: "


def circuit_words(result: "Result") -> str:
    """Which circuit the answer is."""
    return result.model if result.tables is None else f"{result.model} with tables over SOC"


def best_possible(result: "Result") -> str:
    """Whether a better circuit exists in the bounds, and how many seeds found this one."""
    optimum, refined = result.global_optimum, result.refined
    seeds = 0 if refined is None else len(refined.seeds)
    if result.tables is not None:
        return best_of(result.tables)
    if optimum is None:
        reached = refined.optima[0].seeds if refined else 0
        return (
            "not known: the bounds are too wide to look for the global optimum; "
            f"{reached} of {counted(seeds, 'seed')} end in the best optimum found."
        )
    if result.answer_source == "seeds":
        gap = percent(optimum.rmse_v / result.metrics.identification.rmse_v - 1)
        return f"not proved: the seeds found a circuit {gap} better than the grid."
    found = f" ({optimum.seeds_there} of {counted(seeds, 'seed')} found it)" if seeds else ""
    return f"{optimum_words(optimum)}{found}. {nearly_as_good(optimum)}".rstrip()


def seeds_sentences(result: "Result") -> Iterator[str]:
    """How far the seeds stayed from the optimum, and where else there is one."""
    optimum, refined = result.global_optimum, result.refined
    if optimum is None:
        return
    if refined is None:
        yield local_optima_sentence(optimum)
        return
    seeds = len(refined.seeds)
    yield (
        f"Optimality gap (RMSE above that of the optimum): best seed {_gap(optimum.best_gap)}, "
        f"median seed {_gap(optimum.median_gap)}; after refinement {_gap(optimum.refined_gap)}. "
        f"{optimum.seeds_there} of {counted(seeds, 'seed')} reach the optimum after refinement."
    )
    yield local_optima_sentence(optimum)
    moving = sum(not seed.has_converged for seed in refined.seeds)
    if moving:
        yield f"{counted(moving, 'seed')} had not converged when refinement ended."


def weakest_point(result: "Result") -> str:
    """Where most of the error is, empty where it is nowhere in particular."""
    if result.tables is not None:
        bands = result.tables.by_soc
    elif result.assessment is not None:
        bands = result.assessment.diagnostics.by_soc
    else:
        return ""
    low = [band for band in bands if band.high is not None and band.high <= LOW_SOC + 1e-9]
    share = sum(band.share for band in low)
    if share > MUCH:
        samples = sum(band.samples for band in low) / sum(band.samples for band in bands)
        return (
            f"{percent(share)} of the squared error is below {percent(LOW_SOC)} SOC, in "
            f"{percent(samples)} of the samples."
        )
    if result.tables is not None or result.assessment is None:
        return ""
    _, *notable = diagnostics_sentences(result.assessment.diagnostics)
    return notable[0] if notable else ""


def tables_would_pay(result: "Result", share: float = WORTHWHILE) -> bool:
    """Whether tables over SOC, which were not asked for, would lower the error by that share."""
    expected_v, own_v = result.expected_tables_v, result.metrics.identification.rmse_v
    return expected_v is not None and expected_v < (1 - share) * own_v


def _no_circuit(result: "Result") -> str:
    """Why the answer cannot be the cell's, empty where it may be."""
    at_bound = [symbol(each.name) for each in result.at_bound if each.name.endswith("[Ohm]")]
    if len(at_bound) > 1:
        return f"{joined(at_bound)} end at their bounds"
    worse = result.metrics.identification.r2 < 0
    return "a constant voltage would fit as well" if worse else ""


def next_step(result: "Result") -> tuple[dict[str, str], str]:
    """Options to run again with, and why; no options where it takes something else."""
    missed_v = _missed_by_the_polynomial_v(result.cell)
    if missed_v > MISS_TOLERANCE_V:
        missed = millivolt(missed_v)
        what = f"interpolate the OCV; the polynomial misses its points by up to {missed}"
        return {"ocv_fit": "interpolated"}, what
    if result.tables is None and (reason := _no_circuit(result)):
        what = "check that the OCV test is of this cell, and `capacity` and the window right"
        return {}, f"{what}: {reason}"
    if not result.metrics.validation and not tables_would_pay(result, HALF):
        return {}, "validate on another record of the cell, with `validate`"
    others = _other_temperatures(result)
    if others and (result.tables is not None or tables_would_pay(result)):
        where = joined([f"{degc:.3g}" for degc in others])
        what = f"for tables over temperature too, with the records at {where} degC"
        return {"over": OVER_TEMPERATURE}, what
    if result.tables is not None and not tables_pay(result.tables.fit, unseen_errors(result)):
        return {}, "use the constant circuit: identify again without `over`"
    if result.tables is not None:
        return {}, "export the tables with barnax export"
    if tables_would_pay(result):
        expected = millivolt(result.expected_tables_v or 0.0)
        return {"over": "soc"}, f"fit tables over SOC, for an RMSE of about {expected}"
    found = result.assessment
    if found is None:
        return {"trust": "basic"}, "compute intervals of the parameters"
    has_failed = any(text.startswith(FITTING_AGAIN) for text in result.warnings)
    if found.examination is None and not has_failed:
        return {"trust": "full"}, "find out what would lower the error"
    rmse_v = result.metrics.identification.rmse_v
    suggested = () if found.examination is None else found.examination.suggestions
    for each in suggested:
        if option(each) and each.rmse_v < (1 - WORTH_TELLING) * rmse_v:
            options = option(each)
            names = [part.name for part in result.of_role("identification")]
            if "initial_soc" in options and len(names) == 1:
                # A start is one record's; the others keep theirs.
                options["initial_soc"] = f"{names[0]}={options['initial_soc']}"
            return options, f"lower the RMSE to {millivolt(each.rmse_v)}"
    names = [each.name for each in result.of_role("validation")]
    return {}, f"compare circuits and methods with barnax compare; validated on {joined(names)}"


def _other_temperatures(result: "Result") -> list[float]:
    """The temperatures of records in the folder that could be identified on too, and are not."""
    used = {each.temperature_degc for each in result.plan if each.role == "identification"}
    if len(used) != 1 or None in used:
        return []
    found: list[float] = []
    for each in result.plan:
        degc = each.temperature_degc
        is_left = each.role == "not used" and each.kind in ("drive cycle", "pulse test")
        known = [*used, *found]
        if (
            is_left
            and degc is not None
            and all(abs(degc - one) > SAME_DEGC for one in known if one is not None)
        ):
            found.append(degc)
    return sorted(found)


def _missed_by_the_polynomial_v(cell: "CellModel") -> float:
    """How far the OCV curves pass from their points where another kind of fit would not."""
    branches = {"charge": cell.charge, "discharge": cell.discharge}
    missed = [
        cell.errors[name].max_v
        for name, curve in branches.items()
        if isinstance(curve, PolynomialCurve) and name in cell.errors
    ]
    return max(missed, default=0.0)


def _gap(gap: float) -> str:
    return "none" if gap < 1e-7 else percent(gap)


def first_screen(result: "Result", spell: Callable[[str], str] = str) -> Iterator[RenderableType]:
    """How good the answer is, what it is, whether to believe it, and its weakest point.

    `spell` gives the texts as who reads them names the options.
    """
    yield Text()
    yield indented(_files_table(result))
    yield Text()
    yield indented(_errors_table(result))
    yield Text()
    yield indented(_parameters_table(result))
    yield Text()
    if pulses := middle_pulses(result):
        yield indented(bare_table(middle_heads(result), pulses))
        yield Text()
    unfit = [("Do not use", text) for text in result.warnings if UNFIT in text]
    lines = [*unfit, ("Best possible", best_possible(result))]
    lines += _table_lines(result)
    weakest = weakest_point(result)
    if weakest:
        lines.append(("Weakest point", weakest))
    lines += [("Start", text) for text in carried_sentences(result)]
    lines += [("Assumed", text) for text in guess_sentences(result)]
    for head, text in lines:
        yield indented(headed_line(head, spell(text)))


def _table_lines(result: "Result") -> Iterator[tuple[str, str]]:
    """What samples, or temperatures, that were left out say of the tables."""
    if result.tables is None:
        return
    over = result.tables.over_temperature
    if over is not None:
        yield "Temperatures", f"where none was measured, {expectation(over)}"
        for told in prediction_sentences(result):
            yield "", told
    elif pays := pay_sentence(result.tables.fit, unseen_errors(result)):
        yield "Benefit", capitalized(pays)


def _files_table(result: "Result") -> Shown:
    has_degc = result.tables is not None and result.tables.over_temperature is not None
    table = Shown(show_header=False, **BARE)
    for _ in range(4 + has_degc):
        table.add_column(no_wrap=True)
    for each in (*result.of_role("identification"), *result.of_role("validation")):
        degc = each.temperature_degc
        at = [] if not has_degc else ["" if degc is None else degrees(degc)]
        table.add_row(plain(_short(each.name, LONGEST_NAME - 9 * has_degc)), *at, *_extent(each))
    return table


def _extent(part: "InputPart") -> tuple[str, str, str]:
    low, high = part.soc_range or (math.nan, math.nan)
    first = part.start.soc if part.start else high
    ends = (high, low) if abs(first - high) <= abs(first - low) else (low, high)
    return (
        duration(part.duration_s or 0.0),
        f"{part.samples or 0:,} samples",
        f"SOC {100 * ends[0] + 0.0:.0f} to {100 * ends[1] + 0.0:.0f} %".replace("-0 ", "0 "),
    )


def _errors_table(result: "Result") -> Shown:
    metrics, constant = result.answer_metrics, result.metrics
    several, others = metrics.jointly, metrics.validation
    rows: list[tuple[str, MetricsPart]] = []
    rows += zip(_numbered("identification", len(several)), several, strict=True)
    rows.append(("together" if several else "identification", metrics.identification))
    rows += zip(_numbered("validation", len(others)), others, strict=True)
    columns = {
        "RMSE": [each.rmse_v for _, each in rows],
        "above 10 % SOC": [each.rmse_above_10_soc_v for _, each in rows],
        "max": [each.max_v for _, each in rows],
    }
    if result.tables is not None:
        before = (*constant.jointly, constant.identification, *constant.validation)
        columns["constant circuit"] = [each.rmse_v for each in before]
        parts = {each.name: each for each in result.of_role("validation")}
        left = [_left_out_v(result.tables, parts.get(each.record)) for _, each in rows]
        if any(value is not None for value in left):
            columns["left out"] = left
    cells = zip(*columns.values(), strict=True)
    told = (["" if each is None else _millivolt(each) for each in row] for row in cells)
    return bare_table(
        [result.model, *columns], ([role, *row] for (role, _), row in zip(rows, told, strict=True))
    )


def _left_out_v(part: "TablesPart", record: "InputPart | None") -> float | None:
    """The largest error of the temperatures left out that were predicted as a record's is; None
    where it has tables of its own."""
    over, degc = part.over_temperature, None if record is None else record.temperature_degc
    if over is None or degc is None or over.measured_near(degc) is not None:
        return None
    return max(each.errors.rmse_v for each in over.like(degc))


def _numbered(role: str, count: int) -> list[str]:
    return [role] if count == 1 else [f"{role} {number}" for number in range(1, count + 1)]


def _parameters_table(result: "Result") -> Shown:
    """Resistances at the left, the time constants of their pairs at the right."""
    if result.tables is not None:
        heads, rows = middle_of_tables(result.tables)
        if result.tables.over_temperature is not None:
            return bare_table(heads, rows)
        return bare_table(heads, rows, [head.startswith("at") for head in heads])
    estimates: dict[str, Estimate] = {}
    if result.assessment is not None:
        estimates = {each.name: each for each in result.assessment.uncertainty.estimates}
    circuit = result.circuit_parameters
    bounds = {each.name: each.side for each in result.at_bound}
    longest_s = max(each.duration_s or 0.0 for each in result.of_role("identification"))
    table = Shown(show_header=False, **BARE)
    for justify in ("left", "right", "left", "left", "right", "left"):
        table.add_column(justify=justify, no_wrap=True)
    resistances = (circuit.r0, *circuit.r)
    for pair, r_ohm in enumerate(resistances):
        name = f"R{pair} [Ohm]"
        left = (f"R{pair}", with_unit(name, r_ohm), _interval(name, estimates, bounds))
        right = ("", "", "")
        if pair:
            name, tau_s = f"tau{pair} [s]", circuit.tau_s[pair - 1]
            right = (f"tau{pair}", with_unit(name, tau_s), _interval(name, estimates, bounds))
            if bounds.get(name) == "upper" and tau_s >= longest_s * (1 - 1e-3):
                right = (f"tau{pair}", f"> {duration(longest_s)}", "longer than the record")
        table.add_row(*left, *right)
    if circuit.gamma is not None:
        value = f"{figures(circuit.gamma)} /SOC"
        table.add_row("gamma", value, _interval("gamma", estimates, bounds), "", "", "")
    return table


def _interval(name: str, estimates: "dict[str, Estimate]", bounds: dict[str, str]) -> str:
    if name in bounds:
        return f"at its {bounds[name]} bound"
    each = estimates.get(name)
    if each is None or each.held is not None:
        return "" if each is None else "held"
    if each.low is None or each.high is None:
        return "not determined"
    return between(name, each.low, each.high)


def _millivolt(value_v: float) -> str:
    """Three figures, zeros too, so that errors line up."""
    value_mv = 1e3 * value_v
    return f"{value_mv:.0f} mV" if value_mv >= 999.5 else f"{value_mv:#.3g}".rstrip(".") + " mV"


def _short(name: str, longest: int) -> str:
    half = longest // 2
    return name if len(name) <= longest else f"{name[: half - 2]}...{name[1 - half :]}"
