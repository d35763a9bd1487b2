"""The files that were read, the decisions about them with their reasons, and the command."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import TYPE_CHECKING

from ..cell import CellModel, PolynomialCurve
from ..cell.parameters import OHMIC
from ..notices import Notice, sentences_of
from .document import Bullets, Cells, Paragraph, Section, Table, make_table, pairs_table
from .starts import CAME_FROM, axis_sentences, offset_sentence, start_sentence
from .words import (
    NOTHING,
    gathered,
    joined,
    millivolt,
    significant,
    with_unit,
)

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..model.window import Window
    from ..records import Decision
    from ..result_parts import InputPart, PlannedFile
    from ..results import Result

    Stored = Result | ComparisonResult


# Firmness of a decision, put before its reason.
FIRMNESS = {
    "given": "",
    "strong": "strong evidence: ",
    "weak": "weak evidence: ",
    "assumed": "assumed: ",
}
FLOWS = {"forward": "until the next sample", "backward": "since the previous sample"}
FLOWS["centered"] = "for about half of the intervals on either side of it"
HASH_LETTERS = 16
# A curve this close to its points passes through them.
THROUGH_V = 1e-6
# A smaller relative change of R0 counts as none.
SAME_OHM = 1e-3


def files_table(stored: "Stored") -> Table:
    """Every file that was read."""
    cells: Cells[InputPart] = {
        "file": lambda part: part.name,
        "used for": lambda part: "OCV test" if part.role == "ocv" else part.role,
        "sign of current": lambda part: part.sign.value if part.sign else "a table",
        "hash": lambda part: part.sha256[:HASH_LETTERS],
    }
    caption = "The files that were read. The hash is the beginning of the file's SHA-256."
    return make_table(caption, stored.inputs, cells, cells)


def plan_blocks(stored: "Result") -> tuple[Table, ...]:
    """Every file of a folder, and why it serves or not; nothing where roles were given."""
    cells: Cells[PlannedFile] = {
        "file": lambda file: file.name,
        "used as": lambda file: file.role,
        "kind": lambda file: file.kind or NOTHING,
        "reason": lambda file: file.reason or NOTHING,
    }
    caption = "The plan: what the files are, and how they are used."
    return (make_table(caption, stored.plan, cells, cells),) if stored.plan else ()


def decision_sentences(stored: "Stored") -> Iterator[str]:
    """The decisions made before the search."""
    cell = stored.cell_model
    inputs = stored.inputs
    for sign, names in gathered((part.sign, part.name) for part in inputs if part.sign).items():
        yield f"The current is {sign.value} in {joined(names)} ({_reason(sign)})."
    for hold, names in gathered((part.hold, part.name) for part in inputs if part.hold).items():
        yield f"A sample's current flows {FLOWS[hold.value]} in {joined(names)} ({_reason(hold)})."
    yield f"The capacity is {cell.capacity_ah:.4f} Ah ({cell.capacity_origin})."
    yield from ocv_sentences(cell)
    for other in cell.elsewhere:
        points = other.charge_points + other.discharge_points
        tests = joined(list(dict.fromkeys(point.source for point in points)))
        yield (
            f"That is of {cell.temperature_degc:.3g} degC. Records at {other.temperature_degc:.3g} "
            f"degC have the OCV of {tests} and {other.capacity_ah:.4f} Ah, and what lies between "
            "is linear in temperature."
        )
    simulated = [part for part in stored.inputs if part.start is not None]
    planned = {file.name for file in getattr(stored, "plan", ()) if file.plans_soc}
    windows = (
        (own.origin.told if (own := part.window.registration) else part.window, part.name)
        for part in simulated
        if part.window
    )
    if cell.has_spanned_capacity:
        # It was not given, though the windows have it.
        windows = ((replace(window, capacity_ah=None), name) for window, name in windows)
    for window, names in gathered(windows).items():
        yield from window_sentences(window, names)
    has_direction = not cell.is_of_records or bool(cell.hysteresis.points)
    for part in simulated:
        if part.start is not None:
            yield start_sentence(part, part.name in planned, has_direction)


def guess_sentences(stored: "Result") -> Iterator[str]:
    """The decisions that were guesses and that the answer depends on, with how to settle them."""
    simulated = [part for part in stored.inputs if part.start is not None]
    yield from axis_sentences(stored)
    yield from offset_sentence(stored)
    guessed = [part for part in simulated if part.hold and part.hold.strength == "assumed"]
    if guessed:
        value = guessed[0].hold.value if guessed[0].hold else ""
        other = "backward" if value == "forward" else "forward"
        where = f" in {joined([part.name for part in guessed])}" if guessed != simulated else ""
        assumed = f"each sample's current flows {FLOWS[value]}{where}"
        change = _other_r0(stored)
        if change is None:
            yield f"{assumed}; if not, give `current_hold={other}`."
        else:
            yield f"{assumed}; with `current_hold={other}` {_would_be(*change)}."
    for part in simulated:
        start = part.start
        if start is None:
            continue
        if start.direction_source == "better fit" and start.other_rmse_v is not None:
            yield (
                f"the cell was last {CAME_FROM[start.direction]} before {part.name}. If it was "
                f"{CAME_FROM[-start.direction]} (`initial_direction={-start.direction:+d}`), the "
                f"RMSE would be {millivolt(start.other_rmse_v)}."
            )
        elif start.direction_source == "assumed" and stored.cell_model.hysteresis.points:
            yield (
                f"the cell was last {CAME_FROM[start.direction]} before {part.name}; "
                "`initial_direction` changes this."
            )


def _other_r0(stored: "Result") -> tuple[float, float] | None:
    """The answer's R0, of tables the median one, and by how much the other hold changes it."""
    ohm = stored.fit.tables.tables[OHMIC] if stored.tables else [stored.constant.parameters.r0]
    change_ohm = (stored.tables or stored.constant).hold_shift_ohm
    return None if change_ohm is None else (median(ohm), change_ohm)


def _would_be(own_ohm: float, change_ohm: float) -> str:
    """The change that another hold makes to R0, which jumps with the current."""
    if abs(change_ohm) < SAME_OHM * own_ohm:
        return "R0 would be the same"
    more = "more" if change_ohm > 0 else "less"
    return f"R0 would be {with_unit('R0 [Ohm]', abs(change_ohm))} {more}"


def ocv_sentences(cell: CellModel) -> Iterator[str]:
    """The curves of open-circuit and hysteresis voltage, and their errors."""
    if cell.is_of_records:
        yield (
            "The open-circuit voltage was identified with the circuit, from "
            f"{cell.discharge_points[0].source}: straight lines between its nodes, held constant "
            "beyond the samples. It is "
            + (
                "the mean of both directions."
                if cell.charge_points
                else "one curve for both directions, without hysteresis."
            )
        )
        return
    curve = cell.discharge
    kind = (
        f"a polynomial of degree {len(curve.coefficients) - 1}"
        if isinstance(curve, PolynomialCurve)
        else "a monotone interpolation (PCHIP)"
    )
    yield (
        f"The open-circuit voltage of each branch is {kind} through its points: "
        f"{len(cell.discharge_points)} from discharging, {len(cell.charge_points)} from charging."
    )
    missed = [
        f"{name} {millivolt(error.rms_v)} RMS, at most {millivolt(error.max_v)}"
        for name, error in cell.errors.items()
        if error.max_v > THROUGH_V
    ]
    if missed:
        yield f"Error of the curves at their points: {'; '.join(missed)}."
    else:
        yield "The curves pass through their points."
    if cell.sweep_ohm is not None:
        currents_a = [abs(p.current_a) for p in cell.charge_points + cell.discharge_points]
        drop_v = cell.sweep_ohm * median(filter(None, currents_a))
        yield (
            "What slow sweeps lost under load is given back, but not more than lies between the "
            f"branches: {millivolt(drop_v)}, their current times "
            f"{with_unit('R0 [Ohm]', cell.sweep_ohm)}, which the records show within 1,000 s."
        )
    elif cell.has_sweep_drop:
        yield (
            "The open-circuit voltage of slow sweeps holds what they lost under load: the bounds "
            "are too wide to tell how much."
        )
    if cell.hysteresis.points:
        is_fitted = isinstance(cell.charge, PolynomialCurve)
        taken = "" if is_fitted else "; esc and takacs take that as it was measured"
        yield (
            f"The hysteresis voltage is five {cell.hysteresis.kind} segments over the state of "
            f"charge, fitted to the difference between the branches{taken}."
        )
    else:
        yield "Only one branch was measured, so the hysteresis voltage is taken as zero."


def window_sentences(window: "Window", names: Sequence[str]) -> Iterator[str]:
    """The window of some records: where their simulation starts and which samples count."""
    where = joined(names)
    start = "the first sample"
    if window.start_time_s is not None:
        start = f"{window.start_time_s:g} s of its clock"
    elif window.start_after_step is not None:
        start = f"the end of step {window.start_after_step}"
    yield f"{where}: simulated from {start} on."
    limits = []
    if window.score_steps is not None:
        noun = "step" if len(window.score_steps) == 1 else "steps"
        limits.append(f"in {noun} {joined([str(step) for step in window.score_steps])}")
    if window.score_from_s is not None:
        limits.append(f"from {window.score_from_s:g} s")
    if window.score_to_s is not None:
        limits.append(f"up to {window.score_to_s:g} s")
    if window.score_soc is not None:
        low, high = window.score_soc
        limits.append(f"between {100 * low:g} and {100 * high:g} % state of charge")
    scored = (
        f"the samples {', '.join(limits)} are"
        if limits
        else "every simulated sample whose OCV is known is"
    )
    yield f"{where}: {scored} scored."
    for value, told in (
        (window.rest_current_a, lambda current_a: f"the rest current is {1e3 * current_a:.3g} mA"),
        (window.capacity_ah, "the capacity is {:.4g} Ah".format),
        (window.temperature_degc, "measured at {:g} degC".format),
    ):
        if value is not None:
            yield f"{where}: {told(value)}, as given."


def _reason(decision: "Decision") -> str:
    return FIRMNESS[decision.strength] + decision.reason


def box_sentences(
    boxes: Mapping[str, tuple[Mapping[str, tuple[float, float]], Mapping[str, float]]],
) -> Iterator[str]:
    """The search box of each model: its bounds and what is held, each box once."""
    told = gathered((_box(*limits), model) for model, limits in boxes.items())
    for box, models in told.items():
        yield f"The search box of {joined(models)}: {box}."


def _box(bounds: Mapping[str, tuple[float, float]], fixed: Mapping[str, float]) -> str:
    """Ranges and held values, names with the same range together."""
    ranges = gathered((limits, name) for name, limits in bounds.items())
    free = [
        f"{joined(names)} from {significant(low, 4)} to {significant(high, 4)}"
        for (low, high), names in ranges.items()
    ]
    held = [f"{name} held at {significant(value, 4)}" for name, value in fixed.items()]
    return "; ".join([*free, *held])


def reproduction_section(stored: "Stored") -> Section:
    """What has to be the same, and the versions that can change a digit."""
    versions = pairs_table(
        "Package versions that can change the numbers.", "package", "version", stored.versions
    )
    made = Paragraph(
        "The same files, options, key and versions on the same machine give the same numbers to "
        "the last bit. If there is a plan.toml beside the result, "
        "barnax identify plan.toml repeats the run."
    )
    return Section("How to repeat this", (made, versions))


def warnings_section(notices: Sequence[Notice]) -> list[Section]:
    """A section of warnings and one of notes, where there are any."""
    return [
        Section(title, (Bullets(tuple(sentences_of(told)), are_warnings=counts),))
        for title, counts in (("Warnings", True), ("Notes", False))
        if (told := [found for found in notices if found.counts is counts])
    ]
