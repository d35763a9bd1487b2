"""The figures of a report, with their captions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from .. import plots
from ..cell import CircuitParameters
from ..cell.model import SAME_DEGC
from ..errors import InputError
from ..plots.live import MOST_NUMBERS, live_record
from ..plots.pictures import Illustration, record_roles
from ..plots.search import has_landscape
from ..pulses import pulses_of
from ..storing import describe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..cell import CellModel
    from ..comparison import Comparison, ComparisonResult
    from ..global_optimum import GlobalOptimum
    from ..over_soc import TableFits
    from ..replay import SocReplay
    from ..results import Result
    from ..run import Run
    from ..search.evaluate import Evaluation
    from ..table_run import TableRun


# What every kind of figure shows, and words for who cannot see it; {} is a record or a circuit.
WORDS = {
    "summary": (
        "The answer on {}: measured and simulated voltage, the error, and the resistances over the "
        "state of charge with their 95 % intervals.",
        "Voltage and error over time, and resistances over the state of charge",
    ),
    "ocv": (
        "Open-circuit voltage: the measured points, the curve of each branch and their average. "
        "Below, the error of each curve at its points.",
        "Open-circuit voltage over the state of charge, with residuals of the fit",
    ),
    "hysteresis": (
        "Hysteresis voltage, the charge branch minus the discharge branch, and the segments fitted "
        "to it.",
        "Hysteresis voltage over the state of charge, with its five segments",
    ),
    "condition": (
        "Current, measured voltage and state of charge of {}.",
        "Current, voltage and state of charge over time",
    ),
    "landscape": (
        "The lowest RMSE that {} can reach at every pair of time constants, with the answer of "
        "every seed.",
        "The error over both time constants, with every seed's answer and the optimum",
    ),
    "voltage": (
        "Measured and simulated voltage on {}, and the current. On the right, the framed part "
        "with the largest error.",
        "Measured and simulated voltage over time, above the current",
    ),
    "error": (
        "Measured minus simulated voltage on {}, over time and over the state of charge. Dashed: "
        "plus and minus the RMSE.",
        "Error over time and over the state of charge",
    ),
    "tables": (
        "The tables over the state of charge{} with the intervals of their nodes, and the constant "
        "circuit behind. Hollow: nodes without samples near them, whose values follow from those "
        "of their neighbors.",
        "Resistances and OCV correction over the state of charge, with intervals",
    ),
    "by temperature": (
        "The tables of each temperature over the state of charge, with their 95 % intervals.",
        "Resistances and OCV correction over the state of charge, one line per temperature",
    ),
    "over temperature": (
        "Resistances over temperature at several states of charge. Markers with 95 % intervals: "
        "measured temperatures; lines: the interpolation between them.",
        "Resistances over temperature, one line per state of charge",
    ),
    "map": (
        "RMSE by state of charge and current, over all scored samples of the {} records.",
        "RMSE in cells of state of charge and current",
    ),
    "pulses": (
        "The pulses of {}, overlaid: the change of voltage divided by the change of current since "
        "the pulse began. Color: state of charge. Solid: measured; dashed: simulated.",
        "Resistance over the time into a pulse, one line per pulse",
    ),
    "resistances": (
        "The standard pulse resistances of {} over the state of charge.",
        "Pulse resistances over the state of charge, by direction and rate",
    ),
    "convergence": (
        "How the best RMSE of every seed fell during the search, and how far each stayed above "
        "the lowest RMSE known.",
        "Best RMSE of every seed over evaluations",
    ),
    "voltages": (
        "Measured and simulated voltage on {}. Below, the framed part, where the row "
        "with the lowest RMSE has its largest error.",
        "Measured voltage and the simulations of the rows over time, with a magnified part",
    ),
    "errors": (
        "Measured minus simulated voltage on {}, over time and over the state of charge, all on "
        "the same scale. Dashed: plus and minus the RMSE; steps: the RMSE in each 5 % of the state "
        "of charge.",
        "Errors of the rows over time and over the state of charge",
    ),
    "trajectories": (
        "The circuit as the online methods estimated it: medians in each percent of the state of "
        "charge. Dashes on the right: their answers.",
        "Resistances and time constants of online methods over the state of charge",
    ),
    "convergence of rows": (
        "How the best RMSE of each row fell: the median of its seeds, and a band from the tenth "
        "to the ninetieth percentile. A row without a history is a single marker.",
        "Best RMSE of the rows over evaluations, with the spread of the seeds",
    ),
    "soc": (
        "State of charge of {}: counted, and estimated by the filter in every scenario. Below, the "
        "errors of the filter.",
        "State of charge over time by counting and by the filter, with its errors",
    ),
    "parameters": (
        "The answer of every seed, before refinement. Bar: the median seed; diamond: the "
        "same after refinement; dotted: a bound.",
        "Parameters of every seed of every row",
    ),
}
# The same of the interactive forms, where there are some; the second {} says what is drawn.
DRAG = "Drag to zoom, double-click to reset; the buttons do the same."
LIVE_WORDS = {
    "voltage": "Measured and simulated voltage on {}, the error (dashed: plus and minus the RMSE) "
    "and the current, on a common time axis. {} " + DRAG,
    "voltages": "Measured and simulated voltages on {}, the errors of the rows and the current, "
    "on a common time axis. {} " + DRAG,
}
# All others hold so many points that PNG is the smaller form.
SPARSE = {
    "ocv",
    "hysteresis",
    "landscape",
    "parameters",
    "tables",
    "resistances",
    "by temperature",
    "over temperature",
}
# What is written beside a result even where no report is; drawing takes longer than the search.
ALWAYS = ("summary", "voltage", "error", "tables", "pulses", "resistances", "temperature")


@dataclass(frozen=True)
class Figures:
    """How to draw each figure of a report, by its name; `add` says what the words are about.

    Records get an interactive form too where `is_live`.
    """

    is_live: bool = False
    drawings: dict[str, Callable[[], Illustration]] = field(default_factory=dict)

    def add(
        self,
        kind: str,
        name: str,
        subject: str,
        draw: "Callable[[], Figure]",
        live: Callable[[], dict[str, Any]] | None = None,
    ) -> None:
        caption, alt = WORDS[kind]
        moving = None
        if live is not None and self.is_live:
            moving = partial(_live, live, LIVE_WORDS[kind], subject)

        def drawn() -> Illustration:
            is_dense = kind not in SPARSE
            return Illustration(name, draw(), caption.format(subject), alt, is_dense, moving)

        self.drawings[name] = drawn

    def add_cell(self, cell: "CellModel") -> None:
        self.add("ocv", "ocv", "", partial(plots.plot_ocv, cell))
        if cell.hysteresis.points:
            self.add("hysteresis", "hysteresis", "", partial(plots.plot_hysteresis, cell))

    def add_condition(self, role: str, evaluation: "Evaluation") -> None:
        prepared = evaluation.prepared
        draw = partial(plots.plot_condition, prepared)
        self.add("condition", f"{role}-condition", prepared.record.name, draw)

    def add_tables(self, found: "TableFits", constant: CircuitParameters) -> None:
        """The tables over SOC, beside the constant circuit."""
        over, where = found.over_temperature, ""
        if over is not None:
            where = f" at {over.temperatures_degc[found.fits.index(found.reference)]:.3g} degC"
            draw_all = partial(plots.plot_tables_by_temperature, found)
            self.add("by temperature", "tables-by-temperature", "", draw_all)
            draw_over = partial(plots.plot_over_temperature, found)
            self.add("over temperature", "tables-over-temperature", "", draw_over)
        draw = partial(plots.plot_tables, found.reference, constant)
        self.add("tables", "tables", where, draw)

    def add_maps(self, run: "Run", tables: "TableRun") -> None:
        """Where the tables and the constant circuit err."""
        own = {"constant circuit": run.identification, "tables": tables.identification}
        self.add("map", "tables-map", "identification", partial(plots.plot_error_map, own))
        if run.validation:
            others = {"constant circuit": run.validation, "tables": tables.validation}
            draw = partial(plots.plot_error_map, others)
            self.add("map", "tables-validation-map", "validation", draw)

    def add_summary(self, result: "Result", evaluations: "Sequence[Evaluation]") -> None:
        """The answer at a glance, on the first record, or the first at the tables' temperature."""
        own, tables, first = result.constant, result.tables, evaluations[0]
        found: Any = own.circuit_parameters if tables is None else tables.fit
        if tables is not None and (over := tables.over_temperature) is not None:
            degc = over.temperatures_degc[tables.fits.index(tables.fit)]
            known = [(each.prepared.temperature_degc, each) for each in evaluations]
            near = [each for at, each in known if at is not None and abs(at - degc) <= SAME_DEGC]
            first = [*near, first][0]
        known = () if own.assessment is None else own.assessment.uncertainty.estimates
        intervals = {each.name: each for each in known}
        draw = partial(plots.plot_summary, first, found, intervals)
        self.add("summary", "summary", first.prepared.record.name, draw)

    def add_pulses(self, roles: "Sequence[str]", evaluations: "Sequence[Evaluation]") -> None:
        """The pulses of each record that is a pulse test."""
        for role, each in zip(roles, evaluations, strict=False):
            pulses = pulses_of(each.prepared)
            if not pulses:
                continue
            record, capacity_ah = each.prepared.record.name, each.prepared.capacity_ah
            self.add("pulses", f"{role}-pulses", record, partial(plots.plot_pulses, each, pulses))
            draw = partial(plots.plot_pulse_resistances, pulses, capacity_ah)
            self.add("resistances", f"{role}-resistances", record, draw)

    def add_landscape(
        self,
        model: str,
        found: "GlobalOptimum",
        answers: Mapping[str, Sequence[CircuitParameters]],
        refined: Sequence[CircuitParameters],
    ) -> None:
        """The landscape of one model, where it has two time constants to be drawn over."""
        if has_landscape(found.landscape):
            others = [each.parameters for each in found.local_optima]
            draw = partial(
                plots.plot_landscape, found.landscape,
                answers=answers, refined=refined, optimum=found.parameters, others=others,
            )  # fmt: skip
            self.add("landscape", f"landscape-{model}", model, draw)


def _live(
    numbers: Callable[[], dict[str, Any]], words: str, subject: str
) -> tuple[dict[str, Any], str]:
    """What an interactive figure is drawn from, and its caption."""
    data = numbers()
    samples, held = data["samples"], data["held"]
    if held == samples:
        drawn = f"All {samples:,} samples are drawn."
    else:
        drawn = f"{held:,} of {samples:,} samples are drawn, including every peak."
    return data, words.format(subject, drawn)


def identification_illustrations(
    result: "Result", wanted: Callable[[str], bool] = lambda name: True, *, live: bool = False
) -> list[Illustration]:
    """The figures of an identification whose names are wanted; each is drawn only then.

    Where `live`, a record's voltage has an interactive form. Raises `InputError` for a result that
    was read from a file and whose records are not found.
    """
    drawings = _identification_figures(result, live).drawings
    return [drawn() for name, drawn in drawings.items() if wanted(name)]


def is_always(name: str) -> bool:
    """Whether a figure is written beside every result."""
    return name.rpartition("-")[2] in ALWAYS


def figure_of(result: "Result", name: str) -> "Figure":
    """One figure of a result by its name, or the end of its name.

    Raises `InputError` where there is none of that name.
    """
    drawings = _identification_figures(result).drawings
    found = [each for each in drawings if each == name or each.rpartition("-")[2] == name]
    found += [each for each in drawings if each.startswith(name)]
    if not found:
        raise InputError(f"there is no figure {name!r}; there are {', '.join(drawings)}")
    return drawings[found[0]]().figure


def stored_illustrations(result: "Result") -> list[Illustration]:
    """The figures of a stored result that need none of its records."""
    figures = Figures()
    figures.add_cell(result.cell)
    if result.tables is not None:
        figures.add_tables(result.tables.found, result.constant.circuit_parameters)
    return [drawn() for drawn in figures.drawings.values()]


def _identification_figures(result: "Result", live: bool = False) -> Figures:
    figures, run = Figures(live), result.run
    answered = run if run.tables is None else run.tables
    figures.add_summary(result, answered.identification)
    figures.add_cell(run.problem.cell)
    roles = record_roles(len(run.identification), len(run.validation))
    for role, each in zip(roles, [*answered.identification, *answered.validation], strict=True):
        record = each.prepared.record.name
        figures.add_condition(role, each)
        moving = partial(live_record, {"simulated": each}, MOST_NUMBERS // len(roles))
        draw = partial(plots.plot_voltage, each)
        figures.add("voltage", f"{role}-voltage", record, draw, moving)
        figures.add("error", f"{role}-error", record, partial(plots.plot_error, each))
    if run.tables is not None:
        figures.add_tables(run.tables.found, run.answer.parameters)
        figures.add_maps(run, run.tables)
    figures.add_pulses(roles, answered.identification)
    answers = {}
    if run.search is not None:
        optimum_v = None if run.optimum is None else run.optimum.rmse_v
        draw = partial(plots.plot_convergence, run.search, run.refinement, optimum_v)
        figures.add("convergence", "convergence", "", draw)
        method, _ = describe(run.search.optimizer)
        answers[method] = [seed.parameters for seed in run.search.seeds]
    if run.optimum is not None:
        figures.add_landscape(run.problem.circuit, run.optimum, answers, [run.answer.parameters])
    return figures


def replay_illustration(replay: "SocReplay") -> Illustration:
    """The figure of a replay, which has to have its traces."""
    caption, alt = WORDS["soc"]
    return Illustration("soc", plots.plot_soc_replay(replay), caption.format(replay.record), alt)


def comparison_illustrations(
    result: "ComparisonResult",
    comparison: "Comparison | None" = None,
    optima: "Mapping[str, GlobalOptimum] | None" = None,
    *,
    live: bool = False,
) -> list[Illustration]:
    """Every figure of a comparison; those over time only with the comparison itself.

    A stored comparison holds no records, so from `result` alone come the figures of the cell and
    of the seeds. `optima` are the global optima by model, for the landscapes. Where `live`, the
    voltages of a record have an interactive form.
    """
    figures = Figures(live)
    figures.add_cell(result.cell_model)
    if comparison is not None and comparison.answered:
        first = comparison.answered[0].evaluations
        roles = record_roles(1, len(first) - 1)
        for place, (role, each) in enumerate(zip(roles, first, strict=True)):
            figures.add_condition(role, each)
            rows = {row.name: row.evaluations[place] for row in comparison.answered}
            record = each.prepared.record.name
            draw = partial(plots.plot_compared_voltages, rows)
            moving = partial(live_record, rows, MOST_NUMBERS // len(roles))
            figures.add("voltages", f"{role}-voltages", record, draw, moving)
            figures.add(
                "errors", f"{role}-errors", record, partial(plots.plot_compared_errors, rows)
            )
        online = {row.name: row for row in comparison.answered}
        if any(row.median.trajectory is not None for row in online.values()):
            figures.add(
                "trajectories", "trajectories", "", partial(plots.plot_trajectories, online)
            )
    if any(row.seeds for row in result.rows):
        draw = partial(plots.plot_compared_convergence, result)
        figures.add("convergence of rows", "convergence", "", draw)
        figures.add("parameters", "parameters", "", partial(plots.plot_compared_parameters, result))
    for model, found in (optima or {}).items():
        # The rows of other models are there without an answer, so that all keep their looks.
        answers = {
            row.name: [
                CircuitParameters.from_dict(seed.parameters)
                for seed in row.seeds
                if row.model == model
            ]
            for row in result.rows
            if row.seeds
        }
        refined = [
            CircuitParameters.from_dict(row.refined_parameters)
            for row in result.rows
            if row.model == model and row.refined_parameters is not None
        ]
        figures.add_landscape(model, found, answers, refined)
    return [drawn() for drawn in figures.drawings.values()]
