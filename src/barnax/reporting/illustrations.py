"""The figures of a report: which there are, and of what."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .. import plots
from ..cell import CircuitParameters
from ..cell.model import SAME_DEGC
from ..cell.parameters import OCV
from ..errors import InputError
from ..plots.cell import plot_own_ocv
from ..plots.pictures import Illustration, illustrate, record_roles
from ..plots.style import ALONE
from ..plots.voltage import MAX_NUMBERS, live_record
from ..pulses import levels, pulses_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..cell import CellModel
    from ..comparison import Comparison, ComparisonResult
    from ..over_soc import TableFits
    from ..pulses import Pulse
    from ..replay import SocReplay
    from ..results import Result
    from ..search.evaluate import Evaluation

# The first {} is the record, the second says how many samples are drawn.
LIVE_WORDS = (
    "Measured and simulated voltage on {}, the errors (of one circuit, dashed: plus and minus the "
    "RMSE) and the current, on a common time axis. {} Drag to zoom, double-click to reset; the "
    "buttons do the same."
)
# Pulses of a rate that show how its resistances go over the state of charge.
FEWEST_OVER_SOC = 3
Drawn = list[Illustration]


def identification_illustrations(result: "Result", *, live: bool = False) -> Drawn:
    """The figures of an identification, each drawn when it is asked for.

    Where `live`, a record's voltage has an interactive form. Raises `InputError` for a result that
    was read from a file and whose records are not found.
    """
    answered, constant = result.evaluations, result.constant
    found = [_summary(result, answered.identification), *_of_cell(result.cell, result)]
    roles = record_roles(len(answered.identification), len(answered.validation))
    for role, evaluation in zip(
        roles, [*answered.identification, *answered.validation], strict=True
    ):
        found += _of_record(role, evaluation, live and len(roles))
    if result.tables is not None:
        found += _of_tables(result.tables, constant.parameters)
    for role, evaluation in zip(roles, answered.identification, strict=False):
        pulses, record = pulses_of(evaluation.prepared), evaluation.prepared.record.name
        if pulses:
            found.append(
                illustrate(f"{role}-pulses", record, plots.plot_pulses, evaluation, pulses)
            )
        if over_soc := _over_soc(pulses):
            drawn = plots.plot_pulse_resistances, over_soc, evaluation.prepared.capacity_ah
            found.append(illustrate(f"{role}-resistances", record, *drawn))
    if constant.search is not None:
        optimum_v = constant.global_optimum and constant.global_optimum.rmse_v
        of_seeds = constant.search, constant.refined, optimum_v
        found += [illustrate("convergence", "", plots.plot_convergence, *of_seeds)]
    return found


def figure_of(result: "Result", name: str) -> "Figure":
    """One figure of a result by its name, or the end of its name.

    Raises `InputError` where there is none of that name.
    """
    drawn = {
        illustration.name: illustration for illustration in identification_illustrations(result)
    }
    found = [title for title in drawn if title == name or title.rpartition("-")[2] == name]
    found += [title for title in drawn if title.startswith(name)]
    if not found:
        raise InputError(f"there is no figure {name!r}; there are {', '.join(drawn)}")
    return drawn[found[0]].figure


def stored_illustrations(result: "Result") -> Drawn:
    """The figures of a stored result that need none of its records."""
    if result.tables is None:
        return _of_cell(result.cell)
    constant = result.constant.parameters
    return [*_of_cell(result.cell, result), *_of_tables(result.fits, constant)]


def replay_illustration(replay: "SocReplay") -> Illustration:
    """The figure of a replay, which has to have its traces."""
    return illustrate("soc", replay.record, plots.plot_soc_replay, replay)


def comparison_illustrations(
    result: "ComparisonResult",
    comparison: "Comparison | None" = None,
    *,
    live: bool = False,
) -> Drawn:
    """Every figure of a comparison; those over time only with the comparison itself.

    A stored comparison holds no records, so from `result` alone come the figures of the cell and
    of the seeds. Where `live`, the voltages of a record have an interactive form.
    """
    found = _of_cell(result.cell_model)
    if comparison is not None and comparison.answered:
        online = {row.name: row for row in comparison.answered}
        roles = record_roles(1, len(comparison.answered[0].evaluations) - 1)
        for place, role in enumerate(roles):
            rows = {name: row.evaluations[place] for name, row in online.items()}
            found += _of_record(role, rows, live and len(roles))
    if any(row.seeds for row in result.rows):
        found += [
            illustrate("convergence", "", plots.plot_compared_convergence, result),
            illustrate("parameters", "", plots.plot_compared_parameters, result),
        ]
    return found


def _of_record(role: str, drawn: "Evaluation | Mapping[str, Evaluation]", live_of: int) -> Drawn:
    """The figures of a record, of one circuit or of many rows; its voltage has an interactive form
    where it is one of `live_of` that have."""
    rows, ending = (drawn, "s") if isinstance(drawn, Mapping) else ({ALONE: drawn}, "")
    prepared = next(iter(rows.values())).prepared
    record = prepared.record.name
    voltage = illustrate(f"{role}-voltage{ending}", record, plots.plot_voltage, drawn)
    return [
        _moving(voltage, record, rows, live_of) if live_of else voltage,
        illustrate(f"{role}-error{ending}", record, plots.plot_error, drawn),
    ]


def _of_cell(cell: "CellModel", result: "Result | None" = None) -> Drawn:
    """The figures of a cell; an OCV of the records' own with the intervals of the result."""
    found = [illustrate("ocv", "", plots.plot_ocv, cell)]
    if cell.is_of_records:
        nodes = () if result is None else result.fit.of_table(OCV)
        found = [illustrate("ocv", "", plot_own_ocv, cell, nodes)]
    return found


def _of_tables(found: "TableFits", constant: CircuitParameters) -> Drawn:
    """The tables over SOC, beside the constant circuit."""
    degc = found.reference_degc
    where = "" if degc is None else f" at {degc:.3g} degC"
    # One value at every SOC is that of the constant circuit.
    beside = constant if found.reference.is_over_soc else None
    tables = illustrate("tables", where, plots.plot_tables, found.reference, beside)
    if degc is None:
        return [tables]
    return [
        illustrate("tables-over-temperature", "", plots.plot_over_temperature, found),
        tables,
    ]


def _over_soc(pulses: "Sequence[Pulse]") -> "list[Pulse]":
    """The pulses of rates that were tried at several states of charge: those of a drive cycle,
    each of a rate of its own, show nothing over it."""
    return [pulse for level in levels(pulses) if len(level) >= FEWEST_OVER_SOC for pulse in level]


def _summary(result: "Result", evaluations: "Sequence[Evaluation]") -> Illustration:
    """The answer at a glance, on the first record, or the first at the tables' temperature."""
    first, degc = evaluations[0], result.fits.reference_degc
    if degc is not None:
        for evaluation in evaluations[::-1]:
            at_degc = evaluation.prepared.temperature_degc
            if at_degc is not None and abs(at_degc - degc) <= SAME_DEGC:
                first = evaluation
    record = first.prepared.record.name
    return illustrate("summary", record, plots.plot_summary, first, result.fit)


def _moving(
    still: Illustration, record: str, rows: "Mapping[str, Evaluation]", records: int
) -> Illustration:
    """A figure of one of so many records with its interactive form."""

    def live() -> tuple[dict[str, Any], str]:
        data = live_record(rows, MAX_NUMBERS // records)
        samples, held = data["samples"], data["held"]
        drawn = f"{held:,} of {samples:,} samples are drawn, including every peak."
        if held == samples:
            drawn = f"All {samples:,} samples are drawn."
        return data, LIVE_WORDS.format(record, drawn)

    return replace(still, live=live)
