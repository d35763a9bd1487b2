"""The first screen: the answer, its errors, how far to believe it, and the next step."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from ..cell.circuits import Circuit, get_circuit
from ..cell.curves import MISS_TOLERANCE_V, PolynomialCurve
from ..cell.elements import alike
from ..cell.model import SAME_DEGC
from ..cell.soc_axis import ABOVE_SOC
from ..checks.roles import are_unfit
from ..plan.choosing import MAKE_RECORD
from ..settings import OVER_TEMPERATURE
from .document import Bullets, Column, Document, Lines, Table, rows_table, screen
from .pulses import middle_heads, middle_pulses
from .soc_tables import headline
from .view import View
from .wording import document, wording
from .words import aligned_millivolt, degrees, duration, joined, percent, symbol

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..over_soc.fits import OverTemperature
    from ..result_parts import InputPart, MetricsPart
    from ..results import Result

LONGEST_NAME = 26
# With more files than this, the rest are only counted.
MAX_FILES = 5
# The error above 10 % SOC is shown where it is lower than the whole by this share.
APART = 0.1


def first_screen(result: "Result") -> Document:
    """The answer's errors and parameters, how far to believe it, and the assumptions behind it."""
    view = View(result)
    tables = [_files_table(view), _errors_table(view), _parameters_table(view)]
    if pulses := middle_pulses(result):
        heads = middle_heads(result)
        tables.append(rows_table("", heads, pulses, heads[:1], is_bare=True))
    lines = [
        f"{section.title}: {text}"
        for section in document("screen", view=view, is_apart=is_apart).sections
        for block in section.blocks
        for text in (block.items if isinstance(block, Bullets) else ())
    ]
    return screen(*([table] for table in tables), [Lines(tuple(lines))])


def _files_table(view: View) -> Table:
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
    return rows_table("", [""] * (4 + has_degc), rows, [""], is_bare=True)


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


def _errors_table(view: View) -> Table:
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
        heads.append("held out")
    rows: list[list[str]] = []
    for candidate, held_v in zip(candidates, held, strict=True):
        errors_v = [candidate.identification.rmse_v, *candidate.validation_v, held_v]
        mark = "<- answer" if candidate.is_answer and len(candidates) > 1 else ""
        rows.append([candidate.name, *map(aligned_millivolt, errors_v[: len(heads) - 1]), mark])
        if candidate.is_answer and any(map(is_apart, above, whole)):
            errors_v = [*above, candidate.held_out.above_v if candidate.held_out else None]
            row = map(aligned_millivolt, errors_v[: len(heads) - 1])
            rows.append(["  above 10 % SOC", *row, ""])
    return rows_table("", [*heads, ""], rows, [""], is_bare=True)


def is_apart(above_v: float | None, all_v: float) -> bool:
    """True if the error above 10 % SOC is worth showing beside that of all samples."""
    return above_v is not None and above_v < (1 - APART) * all_v


def _errors_over_temperature(view: View, over: "OverTemperature") -> Table:
    """The answer's errors record by record, beside those of one constant circuit for all."""
    metrics, constant = view.result.metrics, view.result.constant.metrics
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
    shown = ([role, *row] for (role, _), row in zip(rows, cells, strict=True))
    heads = [view.result.model, *columns]
    return rows_table("", heads, shown, heads[:1], is_bare=True)


def _left_out_v(over: "OverTemperature", record: "InputPart | None") -> float | None:
    """The largest error of the temperatures left out that were predicted as a record's is; None
    where it has tables of its own."""
    degc = None if record is None else record.temperature_degc
    if degc is None or over.measured_near(degc) is not None:
        return None
    return max(left_out.errors.rmse_v for left_out in over.like(degc))


def _numbered(role: str, count: int) -> list[str]:
    return [role] if count == 1 else [f"{role} {number}" for number in range(1, count + 1)]


def _parameters_table(view: View) -> Table:
    """Resistances at the left, the time constants of their pairs at the right."""
    heads, rows = headline(view)
    if view.over_temperature is not None:
        return rows_table("", heads, rows, heads[:1], is_bare=True)
    # Names and intervals take turns with numbers.
    columns = (
        Column(head, role="number" if index % 2 else "text") for index, head in enumerate(heads)
    )
    return Table("", tuple(columns), tuple(rows), joined=frozenset({5, 6}), is_bare=True)


def _short(name: str, longest: int) -> str:
    half = longest // 2
    return name if len(name) <= longest else f"{name[: half - 2]}...{name[1 - half :]}"


# What was not used is predicted badly where its error exceeds this multiple of the fit's, and this
# size; and as well as can be where it is under that: no table left open matters then.
LOST, LOST_V, FOUND_V = 2.0, 0.01, 0.002
# A table needs a test where less than `FEW` of its nodes have a relative error under `WIDE`.
WIDE, FEW = 0.5, 1 / 3


@dataclass(frozen=True)
class Next:
    """The next step: options to run again with, a record to identify on `also`, an export of this
    result to a format, or a test designed from it."""

    advice: str
    options: Mapping[str, str] = field(default_factory=dict)
    also: str = ""
    exports: str = ""
    designs: bool = False


def next_step(result: "Result") -> Next:
    """The most useful next step.

    First what is plainly amiss: an OCV that misses its points, a circuit that cannot be the cell's,
    records that are not suitable, an OCV test that disagrees with them, records at other
    temperatures that are left over.
    Then the error on what was not used decides (`Unseen`):

    - over `LOST` times the error on what was fitted, and over `LOST_V`: more data;
    - known of no other record: validate on one;
    - over `FOUND_V`, and a resistance is left open at most nodes: a test that tells it;
    - else the circuit serves: export it to a format that holds its hysteresis.

    For a constant circuit there is more to try in place of the last two.
    """
    view = View(result)
    missed_v = _missed_by_the_polynomial_v(result.cell)
    if missed_v > MISS_TOLERANCE_V:
        return Next(wording("next.interpolate", missed_v), {"ocv_fit": "interpolated"})
    constant = result.constant
    upper = [bound.name for bound in constant.at_bound if bound.side == "upper"]
    at_bound = [symbol(name) for name in upper if name.endswith("[Ohm]")]
    if result.tables is None and (len(at_bound) > 1 or constant.metrics.identification.r2 < 0):
        return Next(wording("next.no_circuit", at_bound))
    names = {part.name for part in view.identified}
    disagrees = any(warning.code == "ocv-test.disagrees" for warning in result.warnings)
    if are_unfit(names, result.warnings, by_steps=disagrees):
        return Next(wording("next.unfit", MAKE_RECORD, sorted(names)))
    if disagrees:
        return Next("see what the records tell without the OCV test, which disagrees with them")
    others = _other_temperatures(result)
    if others and result.tables is not None:
        return Next(wording("next.other_temperatures", others), {"over": OVER_TEMPERATURE})
    unseen = Unseen.of(view)
    if unseen and unseen.error_v >= max(LOST * unseen.fitted_v, LOST_V):
        also = unseen.name if view.validation and not view.is_pulse_test else ""
        return Next(wording("next.more_data", view, unseen), also=also)
    held_out = result.fit.cross_validation
    if not (view.validation_errors or (held_out and held_out.by_record)):
        return Next("validate on another record of the cell, with `validate`")
    wide = _wide(view)
    if wide and unseen and unseen.error_v > FOUND_V:
        return Next(f"measure what is missing: {wide}", designs=True)
    circuit = get_circuit(result.model)
    if result.tables is not None:
        what, target = _export(circuit)
        return Next(wording("next.export", what, result.fits), exports=target)
    if not result.tried and alike(circuit.elements) < len(circuit.elements):
        return Next("try tables over SOC of this circuit too", {"over": "soc"})
    if not result.tried:
        return Next("try tables over SOC too, without `model`")
    if result.constant.assessment is None:
        return Next("compute intervals of the parameters", {"trust": "basic"})
    validated = joined([part.name for part in view.validation])
    return Next(f"compare circuits and methods with barnax compare; validated on {validated}")


class Unseen(NamedTuple):
    """What was not used: the worst record to validate on, else what was left out of the fit.

    `error_v` is its error, `fitted_v` that on what was fitted: both above 10 % SOC, for no circuit
    follows a discharge to its end, or both of all samples, with the start of the record moved to
    where that is less or where the other is not known. `where` says which.
    """

    error_v: float
    fitted_v: float
    name: str
    where: str

    @classmethod
    def of(cls, view: View) -> "Unseen | None":
        """None where there is neither."""

        def least(name: str, above_v: float | None, all_v: float, how: str = "") -> Unseen:
            whole = cls(all_v, view.errors.rmse_v, name, how)
            fitted_above_v = view.errors.rmse_above_10_soc_v
            if above_v is None or fitted_above_v is None:
                return whole
            return min(
                cls(above_v, fitted_above_v, name, f"above {percent(ABOVE_SOC)} SOC "), whole
            )

        others = []
        for part in view.validation_errors:
            moved_v = part.registered_v or part.rmse_v
            how = "with its start moved, " if moved_v < part.rmse_v else ""
            others.append(least(part.record, part.rmse_above_10_soc_v, moved_v, how))
        held_out = view.result.fit.cross_validation
        if held_out is not None and not others:
            name = "records left out" if held_out.by_record else "blocks held out"
            others.append(least(name, held_out.whole.above_v, held_out.whole.rmse_v))
        return max(others, default=None)


def _export(circuit: Circuit) -> tuple[str, str]:
    """A format that holds a circuit's hysteresis, in words and as `export` calls it."""
    if circuit.turning is not None:
        return "as a filter in C", "c-filter"
    return ("as CSV", "csv") if circuit.has_hysteresis else ("to PyBaMM", "pybamm")


def _wide(view: View) -> str:
    """A table that the data leave open nearly everywhere; empty where there is none."""
    if view.result.over in (None, OVER_TEMPERATURE):
        return ""
    for name in view.result.fit.tables.tables:
        nodes = view.result.fit.of_table(name)
        if not name.startswith("R") or not nodes:
            continue
        narrow = sum(n.low is not None and n.standard_error <= WIDE * n.value for n in nodes)
        if narrow < FEW * len(nodes):
            where = f"{narrow} of {len(nodes)} nodes"
            return f"the standard error of {symbol(name)} is under {percent(WIDE)} at {where}"
    return ""


def _other_temperatures(result: "Result") -> list[float]:
    """The temperatures of records in the folder that could be identified on too, and are not."""
    used = {file.temperature_degc for file in result.plan if file.role == "identification"}
    if len(used) != 1 or None in used:
        return []
    all_degc = [degc for degc in used if degc is not None]
    for file in result.plan:
        degc = file.temperature_degc
        is_left = file.role == "not used" and file.kind in ("drive cycle", "pulse test")
        if is_left and degc is not None and all(abs(degc - one) > SAME_DEGC for one in all_degc):
            all_degc.append(degc)
    return sorted(all_degc[1:])


def _missed_by_the_polynomial_v(cell: "CellModel") -> float:
    """The largest distance of polynomial OCV curves from their points."""
    branches = {"charge": cell.charge, "discharge": cell.discharge}
    curves = [name for name, curve in branches.items() if isinstance(curve, PolynomialCurve)]
    return max((cell.errors[name].max_v for name in curves if name in cell.errors), default=0.0)
