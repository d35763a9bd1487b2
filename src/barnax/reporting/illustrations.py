"""The figures of a report: which there are, their subjects, and their words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from .. import plots
from ..cell.model import SAME_DEGC
from ..errors import InputError
from ..plots.cells import plot_distributions
from ..plots.style import ALONE
from ..plots.voltage import MAX_NUMBERS, live_record
from ..pulses import levels, pulses_of
from .document import Picture
from .wording import sentences, wording
from .words import numbered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..comparison import ComparisonResult
    from ..results import Result
    from ..search.evaluate import Evaluation

# Those with few points, whose smaller form is SVG.
SPARSE: Final = (
    *(plots.plot_ocv, plots.plot_tables, plots.plot_over_temperature),
    *(plots.plot_pulse_resistances, plot_distributions),
)
# Those that are written with a result even without a report: drawing all takes longer than the
# search. The first record's voltage and error, and the tables, are in the summary.
MAIN: Final = (
    *(plots.plot_summary, plots.plot_soc_replay, plots.plot_over_temperature),
    *(plots.plot_pulses, plots.plot_pulse_resistances),
)
# This many pulses at one rate show how its resistances change over the state of charge.
FEWEST_OVER_SOC = 3


Drawn = list[Picture]


def illustrate(
    name: str, subject: object, draw: "Callable[..., Figure]", *given: object
) -> Picture:
    """The figure that a function of `plots` draws, with its words from `figures.txt`."""
    caption, alt = sentences(f"figures.{draw.__name__}", subject)
    kind = draw not in SPARSE, draw in MAIN
    return Picture(name, partial(draw, *given), caption, alt, *kind)


def record_roles(identified: int, validated: int) -> list[str]:
    """Names of each record's files: identification, then validation.

    >>> record_roles(1, 2)
    ['identification', 'validation-1', 'validation-2']
    """
    first = (name.replace(" ", "-") for name in numbered("identification", identified))
    return [*first, *(f"validation-{number}" for number in range(1, validated + 1))]


def identification_illustrations(result: "Result", *, live: bool = False) -> Drawn:
    """The figures of an identification, each drawn on first use.

    With `live`, a record's voltage has an interactive form. Raises `InputError` for a stored result
    whose records are not found.
    """
    identified = result.evaluations.identification
    evaluations = [*identified, *result.evaluations.validation]
    roles = record_roles(len(identified), len(evaluations) - len(identified))
    drawn = [_summary(result, identified), _of_ocv(result)]
    for role, evaluation in zip(roles, evaluations, strict=True):
        drawn += _of_record(role, evaluation, live and len(roles))
    drawn += _of_tables(result)
    for role, evaluation in zip(roles, identified, strict=False):
        drawn += _of_pulses(role, evaluation)
    return drawn


def figure_of(result: "Result", name: str) -> "Figure":
    """One figure of a result by its name, or the end of its name.

    Raises `InputError` if there is none.
    """
    drawn = {each.name: each for each in identification_illustrations(result)}
    titles = [title for title in drawn if title == name or title.rpartition("-")[2] == name]
    titles += [title for title in drawn if title.startswith(name)]
    if not titles:
        raise InputError(f"there is no figure {name!r}; there are {', '.join(drawn)}")
    return drawn[titles[0]].figure


def stored_illustrations(result: "Result") -> Drawn:
    """The figures of a stored result that need none of its records."""
    return [_of_ocv(result), *_of_tables(result)]


def comparison_illustrations(result: "ComparisonResult", *, live: bool = False) -> Drawn:
    """Every figure of a comparison; a stored one has no records, and no figures over time.

    With `live`, the voltages of a record have an interactive form.
    """
    drawn = [illustrate("ocv", result.cell.ocv_is_fitted, plots.plot_ocv, result.cell)]
    evaluations = {row.name: row.evaluations for row in result.answered if row.evaluations}
    records = len(next(iter(evaluations.values()), ()))
    for index, role in enumerate(record_roles(1, records - 1) if records else ()):
        rows = {name: of_row[index] for name, of_row in evaluations.items()}
        drawn += _of_record(role, rows, live and records)
    return drawn


def _of_record(role: str, drawn: "Evaluation | Mapping[str, Evaluation]", live_of: int) -> Drawn:
    """The figures of a record, for one circuit or for many rows; its voltage has an interactive
    form if it is in `live_of`."""
    rows, ending = (drawn, "s") if isinstance(drawn, Mapping) else ({ALONE: drawn}, "")
    record = next(iter(rows.values())).prepared.record.name

    def live() -> tuple[dict[str, Any], str]:
        data = live_record(rows, MAX_NUMBERS // live_of)
        return data, wording("figures.live", record, data["held"], data["samples"])

    voltage = illustrate(f"{role}-voltage{ending}", record, plots.plot_voltage, drawn)
    error = illustrate(f"{role}-error{ending}", record, plots.plot_error, drawn)
    # There is no summary for many rows.
    is_main = isinstance(drawn, Mapping)
    voltage = replace(voltage, live=live if live_of else None, is_main=is_main)
    return [voltage, replace(error, is_main=is_main)]


def _of_ocv(result: "Result") -> Picture:
    return illustrate("ocv", result.cell.ocv_is_fitted, plots.plot_ocv, result)


def _of_tables(result: "Result") -> Drawn:
    """The tables over SOC, compared with the constant circuit; none if that is the answer."""
    if result.over is None:
        return []
    fits, degc = result.fits, result.fits.reference_degc
    where = "" if degc is None else f" at {degc:.3g} degC"
    # A single value at every SOC is that of the constant circuit.
    beside = result.constant.parameters if fits.reference.is_over_soc else None
    tables = illustrate("tables", where, plots.plot_tables, fits.reference, beside)
    if degc is None:
        return [tables]
    return [illustrate("tables-over-temperature", "", plots.plot_over_temperature, fits), tables]


def _of_pulses(role: str, evaluation: "Evaluation") -> Drawn:
    """The pulses of a test, and their resistances for rates that occur at several states of charge;
    those of a drive cycle each have their own rate, and show nothing over SOC."""
    prepared, drawn = evaluation.prepared, []
    pulses, record = pulses_of(prepared), prepared.record.name
    if pulses:
        drawn.append(illustrate(f"{role}-pulses", record, plots.plot_pulses, evaluation, pulses))
    many = [pulse for level in levels(pulses) if len(level) >= FEWEST_OVER_SOC for pulse in level]
    if many:
        over_soc = plots.plot_pulse_resistances, many, prepared.capacity_ah
        drawn.append(illustrate(f"{role}-resistances", record, *over_soc))
    return drawn


def _summary(result: "Result", evaluations: "Sequence[Evaluation]") -> Picture:
    """The answer at a glance, on the first record, or the first at the tables' temperature."""
    first, degc = evaluations[0], result.fits.reference_degc
    if degc is not None:
        for evaluation in evaluations[::-1]:
            at_degc = evaluation.prepared.temperature_degc
            if at_degc is not None and abs(at_degc - degc) <= SAME_DEGC:
                first = evaluation
    record = first.prepared.record.name
    return illustrate("summary", record, plots.plot_summary, first, result.fit)
