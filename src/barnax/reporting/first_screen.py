"""The first screen: the answer, its errors, and how far to believe it."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.text import Text

from .document import Bullets
from .pulses import middle_heads, middle_pulses
from .soc_tables import headline
from .terminal import Whole, bare_table, headed_line, indented
from .view import View
from .wording import document
from .words import aligned_millivolt, degrees, duration

if TYPE_CHECKING:
    from ..over_soc import OverTemperature
    from ..result_parts import InputPart, MetricsPart
    from ..results import Result

LONGEST_NAME = 26
# With more files than this, the rest are only counted.
MAX_FILES = 5
# The error above 10 % SOC is shown where it is lower than the whole by this share.
APART = 0.1


def first_screen(
    result: "Result", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """The answer's errors and parameters, how far to believe it, and the assumptions behind it.

    `with_cli_options` turns the options named in texts into those of the reader's interface.
    """
    view = View(result)
    tables = [_files_table(view), _errors_table(view), _parameters_table(view)]
    if pulses := middle_pulses(result):
        tables.append(bare_table(middle_heads(result), pulses))
    for table in tables:
        yield Text()
        yield indented(table)
    yield Text()
    for section in document("screen", view=view, is_apart=is_apart).sections:
        for block in section.blocks:
            for text in block.items if isinstance(block, Bullets) else ():
                yield indented(headed_line(section.title, with_cli_options(text)))


def _files_table(view: View) -> Whole:
    has_degc = view.over_temperature is not None
    rows = []
    parts = (*view.identified, *view.validation)
    shown = parts if len(parts) <= MAX_FILES else parts[: MAX_FILES - 1]
    for part in shown:
        degc = part.temperature_degc
        at = [] if not has_degc else ["" if degc is None else degrees(degc)]
        rows.append([_short(part.name, LONGEST_NAME - 9 * has_degc), *at, *_extent(part)])
    if len(shown) < len(parts):
        rows.append([f"and {len(parts) - len(shown)} more", *[""] * (3 + has_degc)])
    return bare_table((), rows, [False] * (4 + has_degc))


def _extent(part: "InputPart") -> tuple[str, str, str]:
    low, high = part.soc_range or (math.nan, math.nan)
    first = part.start.soc if part.start else high
    ends = (high, low) if abs(first - high) <= abs(first - low) else (low, high)
    of = "" if part.capacity_ah is None else f" of {part.capacity_ah:.4g} Ah"
    return (
        duration(part.duration_s or 0.0),
        f"{part.samples or 0:,} samples",
        f"SOC {100 * ends[0] + 0.0:.0f} to {100 * ends[1] + 0.0:.0f} %{of}".replace("-0 ", "0 "),
    )


def _errors_table(view: View) -> Whole:
    """The answer and the constant circuit with their errors on all records."""
    if view.over_temperature is not None:
        return _errors_over_temperature(view, view.over_temperature)
    metrics = (view.errors, *view.validation_errors)
    heads = ["", "identification", *_numbered("validation", len(metrics) - 1)]
    above = [part.rmse_above_10_soc_v for part in metrics]
    whole = [part.rmse_v for part in metrics]
    candidates = view.candidates
    held = [c.held_out.rmse_v if c.held_out else None for c in candidates]
    if any(value is not None for value in held):
        heads.append("left out")
    rows: list[list[str]] = []
    for candidate, held_v in zip(candidates, held, strict=True):
        errors_v = [candidate.identification.rmse_v, *candidate.validation_v, held_v]
        mark = "<- answer" if candidate.is_answer and len(candidates) > 1 else ""
        rows.append([candidate.name, *map(aligned_millivolt, errors_v[: len(heads) - 1]), mark])
        if candidate.is_answer and any(map(is_apart, above, whole)):
            errors_v = [*above, candidate.held_out.above_v if candidate.held_out else None]
            row = map(aligned_millivolt, errors_v[: len(heads) - 1])
            rows.append(["  above 10 % SOC", *row, ""])
    are_numbers = [False, *(True for _ in heads[1:]), False]
    return bare_table([*heads, ""], rows, are_numbers)


def is_apart(above_v: float | None, all_v: float) -> bool:
    """True if the error above 10 % SOC is worth showing beside that of all samples."""
    return above_v is not None and above_v < (1 - APART) * all_v


def _errors_over_temperature(view: View, over: "OverTemperature") -> Whole:
    """The answer's errors record by record, beside those of one constant circuit for all."""
    metrics, constant = view.result.metrics, view.constant.metrics
    several, others = metrics.jointly, metrics.validation
    rows: list[tuple[str, MetricsPart]] = []
    rows += zip(_numbered("identification", len(several)), several, strict=True)
    rows.append(("together" if several else "identification", metrics.identification))
    rows += zip(_numbered("validation", len(others)), others, strict=True)
    before = (*constant.jointly, constant.identification, *constant.validation)
    columns = {
        "RMSE": [part.rmse_v for _, part in rows],
        "above 10 % SOC": [part.rmse_above_10_soc_v for _, part in rows],
        "constant circuit": [part.rmse_v for part in before],
    }
    parts = {part.name: part for part in view.validation}
    left = [_left_out_v(over, parts.get(part.record)) for _, part in rows]
    if any(value is not None for value in left):
        columns["left out"] = left
    cells = (map(aligned_millivolt, row) for row in zip(*columns.values(), strict=True))
    return bare_table(
        [view.model, *columns], ([role, *row] for (role, _), row in zip(rows, cells, strict=True))
    )


def _left_out_v(over: "OverTemperature", record: "InputPart | None") -> float | None:
    """The largest error of the temperatures left out that were predicted as a record's is; None
    where it has tables of its own."""
    degc = None if record is None else record.temperature_degc
    if degc is None or over.measured_near(degc) is not None:
        return None
    return max(left_out.errors.rmse_v for left_out in over.like(degc))


def _numbered(role: str, count: int) -> list[str]:
    return [role] if count == 1 else [f"{role} {number}" for number in range(1, count + 1)]


def _parameters_table(view: View) -> Whole:
    """Resistances at the left, the time constants of their pairs at the right."""
    heads, rows = headline(view)
    if view.over_temperature is not None:
        return bare_table(heads, rows)
    return bare_table(heads, rows, [column in (1, 3, 5) for column in range(7)], (5, 6))


def _short(name: str, longest: int) -> str:
    half = longest // 2
    return name if len(name) <= longest else f"{name[: half - 2]}...{name[1 - half :]}"
