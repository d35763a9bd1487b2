"""The first screen: how good the answer is, what it is, and whether to believe it."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table as Shown
from rich.text import Text

from ..inputs import NOT_SUITABLE
from .decisions import carried_sentences, guess_sentences
from .pulses import middle_heads, middle_pulses
from .soc_tables import (
    expectation,
    middle_of_tables,
    pay_sentence,
    prediction_sentences,
    unseen_errors,
)
from .terminal import BARE, bare_table, headed_line, indented, plain
from .words import (
    between,
    capitalized,
    degrees,
    duration,
    figures,
    with_unit,
)

if TYPE_CHECKING:
    from ..results import InputPart, MetricsPart, Result, TablesPart
    from ..uncertainty import Estimate
from .verdict import best_possible, weakest_point

LONGEST_NAME = 40
UNFIT = f": {NOT_SUITABLE} identification: "


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
