"""The starts of simulations: their sources, their changes by other records, and the SOC axis."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..cell.parameters import HALF_HYSTERESIS
from ..settings import MAX_MOVED_SOC
from .words import extent, figures, joined, millivolt, percent

if TYPE_CHECKING:
    from ..model.start import Start
    from ..result_parts import InputPart, MetricsPart
    from ..results import Result

CAME_FROM = {1: "charged", -1: "discharged"}
ENDS = {1: "full", -1: "empty"}
# Sources of a start's SOC that another line tells, or that need no line.
TOLD = ("given", "rested voltage", "own full charge", "own span", "registered")
# So far beyond 0 and 100 % a whole percentage shows it.
SHOWN_SOC = 0.005
# With more records than this, they are counted, not named.
MAX_NAMES = 2
# Starts and capacities of records that are adjusted by less, as shares, change no answer.
HARDLY_MOVED = 1e-3
# A start that moves by less is told as moved by 0.00 %.
SHOWN_MOVED = 5e-5
# The code of a record that is counted over its own charge.
MOVES_MORE = "start.moves-more"
# That of rests whose current is not zero.
OFFSET = "rests.offset"
# That of an OCV test whose charge is taken for the capacity.
CAPACITY_ASSUMED = "ocv-test.capacity-assumed"


def axis_sentences(stored: "Result") -> Iterator[str]:
    """What 0 and 100 % SOC are where that is assumed, and the OCV where there is no test of it."""
    cell = stored.cell_model
    if not cell.is_of_records:
        for told in stored.warnings:
            if told.code == CAPACITY_ASSUMED:
                yield (
                    f"SOC is counted over {cell.capacity_ah:.4g} Ah, the {told.values['direction']}"
                    f" of {told.subject}; where the cell holds more, every SOC is off. `capacity` "
                    "sets another axis."
                )
        return
    parts = stored.of_role("identification")
    starts = {
        "own full charge": "100 % is where {it} was charged full",
        "own span": "100 % is {its} fullest point",
        "given": "the initial SOC is as given",
        "planned": "{it} starts at {soc:.3g} % SOC",
    }
    # The other records start by their rested voltage on this one's OCV.
    planned = {file.name for file in getattr(stored, "plan", ()) if file.plans_soc}
    are_several = len(parts) > 1
    start = next(
        starts["planned" if part.name in planned else source].format(
            it=part.name if are_several else "it",
            its=f"{part.name}'s" if are_several else "its",
            soc=100 * part.start.soc,
        )
        for part in parts
        if part.start is not None and (source := part.start_source) in starts
    )
    names = [part.name for part in parts]
    whole = joined(names) if len(names) <= MAX_NAMES else f"these {len(names)} records"
    slowest_s = max(high for _, high in stored.fit.tau_ranges_s)
    slower = f"what relaxes slower than {slowest_s:.0f} s"
    if HALF_HYSTERESIS in stored.fit.tables.tables:
        found = f"the OCV and the hysteresis were identified from {whole}; they include {slower}"
    else:
        found = (
            f"the OCV was identified from {whole}; it includes {slower} and, unless the current "
            "charges as much as it discharges, half of the hysteresis"
        )
    yield (
        f"SOC is counted over {cell.capacity_ah:.4g} Ah, {cell.capacity_origin}; {start}. "
        "`capacity` and `initial_soc` set another axis."
    )
    yield f"no OCV test: {found}."


def beyond_sentence(extents: Mapping[str, tuple[float, float]], whole: str) -> str:
    """By how much the SOC of records, lowest and highest by name, goes beyond 0 and 100 %, the ends
    of the `whole`; empty where that does not show."""
    beyond = {name: max(-low, high - 1) for name, (low, high) in extents.items()}
    beyond = {name: soc for name, soc in beyond.items() if soc > SHOWN_SOC}
    if not beyond:
        return ""
    goes = "goes" if len(beyond) == 1 else "go"
    farthest = percent(max(beyond.values()))
    return (
        f"0 and 100 % are the ends of {whole}; {joined([*beyond])} {goes} up to {farthest} beyond."
    )


def offset_sentence(stored: "Result") -> Iterator[str]:
    """The effect of a current offset: of one that the record's rests show, else of a common one,
    for the rest of a single record cannot show it."""
    effect = stored.fit.of_offset
    if not effect:
        return
    names = {part.name for part in stored.of_role("identification")}
    warned = (own for own in stored.warnings if own.code == OFFSET and own.subject in names)
    seen = next(warned, None)
    offset_a = effect.offset_a if seen is None else float(seen.values["offset_a"])
    # So small a change is in proportion to what makes it.
    times = abs(offset_a) / effect.offset_a
    r0, total = (_change(times * share) for share in (effect.r0, effect.total))
    size = f"{figures(1e3 * offset_a, 2)} mA"
    whose = "which one record cannot show"
    if seen is not None:
        whose = f"though the rests of {seen.subject} show one, which should be subtracted"
    yield (
        f"no current offset, {whose}: {size} would change R0 by {r0}, and the sum of all "
        f"resistances by {total}."
    )


def _change(ratio: float) -> str:
    """A change of a resistance, which is nothing below a tenth of a percent."""
    return percent(ratio) if ratio >= HARDLY_MOVED else f"under {percent(HARDLY_MOVED)}"


def registered_sentences(stored: "Result") -> Iterator[str]:
    """Starts and capacities that were adjusted: by a cell's records to each other, or by its OCV
    test."""
    known = [
        (part, part.start.soc, part.window.capacity_ah, own)
        for part in stored.of_role("identification")
        if part.start and part.window and (own := part.window.registration)
        and part.window.capacity_ah
    ]  # fmt: skip
    by_test = [entry for entry in known if entry[-1].origin.by == "OCV test"]
    if by_test:
        parts, soc, capacity_ah, own = zip(*by_test, strict=True)
        told = [
            (registration.origin.told_soc, registration.origin.told_capacity_ah)
            for registration in own
        ]
        told_soc, told_ah = zip(*told, strict=True)
        of = parts[0].name if len(parts) == 1 else f"{len(parts)} records"
        is_for_all = not any(registration.origin.told.capacity_ah for registration in own)
        is_for_all &= len(parts) == len(stored.of_role("identification"))
        others = " The other records use that capacity too." if is_for_all else ""
        moved = [
            f"{what} now {now} {unit} (was {was} {unit})"
            for what, now, was, unit in (
                (f"initial SOC of {of}", extent(soc, 100), extent(told_soc, 100), "%"),
                (f"capacity of {of}", extent(capacity_ah), extent(told_ah), "Ah"),
            )
            if now != was
        ]
        if moved:
            yield (
                f"{', '.join(moved)}, so that the rests lie on the OCV; `keep_starts` leaves both "
                f"as they were.{others}"
            )
    joint = [
        (soc - own.told_soc, capacity_ah / own.told_capacity_ah - 1)
        for _, soc, capacity_ah, own in known
        if own.by == "records"
    ]
    if not joint:
        return
    largest = (max(map(abs, own)) for own in zip(*joint, strict=True))
    moved = [
        f"{what} by up to {100 * most:.2g} %"
        for what, most in zip(("initial SOC", "capacities"), largest, strict=True)
        if most > HARDLY_MOVED
    ]
    if moved:
        yield (
            f"the records' {joined(moved)}, so that they agree; `keep_starts` leaves them as they "
            "were."
        )


def moved_start_sentence(found: "MetricsPart") -> str:
    """The gain of moving a validation record's start; empty where it is not moved."""
    moved, least_v = found.start_moved_soc, found.registered_v
    if moved is None or least_v is None or abs(moved) < SHOWN_MOVED:
        return ""
    where = "as far as is tried" if abs(moved) >= MAX_MOVED_SOC else "where it fits best"
    return (
        f"with the initial SOC of {found.record} moved by {100 * moved:+.2f} %, {where}, "
        f"{millivolt(least_v)} instead of {millivolt(found.rmse_v)}"
    )


def start_sentence(part: "InputPart", is_planned: bool = False, has_direction: bool = True) -> str:
    """The start of one record and its source; `is_planned` if the plan set its SOC. Without a
    hysteresis it has no direction."""
    name, start = part.name, part.start
    assert start is not None, "asked of simulated records"
    given = "as the folder's plan says" if is_planned else "given"
    known = {"given": given, **known_words(start)}[part.start_source]
    if part.window and (own := part.window.registration):
        by = {
            "OCV test": "the OCV test",
            "records": "all records, on their common axis",
            "circuit": "the fit of the circuit",
        }[own.by]
        known = (
            f"95 %: {own.soc_low:.3f} to {own.soc_high:.3f}, by {by}; alone "
            f"{own.origin.told_soc:.3f}, {known}"
        )
        if own.by != "circuit":
            capacity = f"{own.capacity_low_ah:.4g} to {own.capacity_high_ah:.4g}"
            known += (
                f". Its capacity is {part.window.capacity_ah:.4g} Ah, {capacity}; alone "
                f"{own.origin.told_capacity_ah:.4g}"
            )
    last = f"last {CAME_FROM[start.direction]}"
    direction = {
        "given": f"with the cell {last}, as given",
        "load before": f"with the cell {last}, as the load before it shows",
        "full or empty": f"where the cell is {ENDS[start.direction]}, so it was {last}",
        "better fit": f"with the cell {last}, which fits better",
        "without effect": f"with the cell {last}, which is assumed and makes no difference",
        "assumed": f"with the cell {last}, which is assumed",
    }[start.direction_source]
    end = f", {direction}" if has_direction else ""
    return (
        f"The simulation of {name} starts at a state of charge of {start.soc:.3f} ({known}){end}."
    )


def known_words(start: "Start") -> dict[str, str]:
    """The evidence for the state of charge at the start, by its source."""
    rested, row = f"from the rested voltage {start.voltage_v:.4f} V", f"row {start.row}"
    return {
        "rested voltage": f"{rested} at {row}",
        "full end": f"counted in ampere-hours from the charge to full that ends at {row}",
        "empty end": f"counted in ampere-hours from the discharge to empty that ends at {row}",
        "full voltage": f"from the voltage of a full cell, {start.voltage_v:.4f} V at {row}",
        "counters": "from the tester's counters, which began at full or empty; the voltage agrees",
        "rest elsewhere": f"{rested} at {row}, and the ampere-hours since",
        "own full charge": "counted in ampere-hours from the full charge in the record",
        "own span": "100 % being its highest charge",
        "fitted": f"fitted to the record with a standard error of {100 * start.soc_sd:.2g} %",
        "given earlier": "given for its first row, and the ampere-hours since",
    }


def carried_sentences(stored: "Result") -> Iterator[str]:
    """Starts whose state of charge comes from another place of the record."""
    moved = {one.subject: one.values for one in stored.warnings if one.code == MOVES_MORE}
    for part in stored.inputs:
        if part.start is not None and part.start.soc_source not in TOLD:
            known = known_words(part.start)[part.start.soc_source]
            own = moved.get(part.name)
            over = "" if own is None else f", over the {own['moved_ah']:.4g} Ah between the two"
            yield f"{part.name} starts at {percent(part.start.soc)} SOC, {known}{over}."
