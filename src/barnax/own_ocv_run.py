"""Cells without an OCV test: the OCV of their records, with tables or one value at every SOC."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from .candidates import FOLLOWING, FURTHER, WEIGHED, spans_enough
from .cell import get_circuit
from .cell.parameters import ANYWHERE, OHMIC
from .inputs import ranges_of, window_of
from .job import Job
from .notices import Notice, notice
from .over_soc import (
    NodeInterval,
    OwnOcv,
    TableFit,
    TableSettings,
    is_supported,
    proved,
    search_with_ocv,
    shows_more,
    with_own_ocv,
)
from .over_soc.dependence import with_dependence
from .records import Record
from .settings import OVER_TEMPERATURE


def bounded_tables(job: Job, but: str | None = None) -> TableSettings:
    """Settings of tables, with the bounds and fixed values of the circuit, but those in a unit
    that tables do not have."""
    ranges, tables = ranges_of(job.bounds)[1], job.table_settings
    bounds, fixed = (
        {name: value for name, value in (given or {}).items() if but is None or but not in name}
        for given in (ranges, job.fix)
    )
    return replace(tables, bounds={**bounds, **tables.bounds}, fixed={**fixed, **tables.fixed})


def own_ocv_of(job: Job, records: Sequence[Record]) -> OwnOcv:
    """The cell of records that have no OCV test, and their tables. Raises `InputError` where what
    is asked for needs one."""
    circuit = get_circuit(job.model or WEIGHED[0])
    asked = {
        f"the hysteresis of {circuit.name}": circuit.has_hysteresis and not circuit.has_rate,
        "an OCV polynomial": job.ocv_fit == "polynomial",
    }
    for what, is_asked in asked.items():
        if is_asked:
            raise notice("ocv-test.missing", asked=what).error()
    windows = {record.name: window_of(job.window, record.name).as_told for record in records}
    is_over = job.over == OVER_TEMPERATURE
    is_open = job.model is None and not (is_over or job.bounds or job.fix)

    def fitted(tables: TableSettings) -> OwnOcv:
        given = windows, tables, job.capacity, is_over
        found = search_with_ocv(records, circuit.name, *given, FURTHER if is_open else None)
        return replace(found, warnings=(*found.warnings, *_shown_direction(found)))

    tables = bounded_tables(job)
    # The same at every SOC: a constant circuit with an OCV.
    alike = replace(tables, nodes=ANYWHERE)
    if job.model is not None and job.over is None:
        found = fitted(alike)
        return proved(replace(found, warnings=(*found.warnings, *_shown_hysteresis(found, alike))))
    found = fitted(tables)
    if job.model is not None:
        found = replace(found, warnings=(*found.warnings, *_shown_hysteresis(found, tables)))
    crossed = found.fit.cross_validation
    is_chosen = job.over is not None or tables.nodes != TableSettings.nodes
    if is_chosen or crossed is None:
        return proved(found)
    is_narrow = not spans_enough(found.fit)
    if not is_narrow and not crossed.constant.is_no_worse(crossed.tables):
        return proved(found)
    constant = fitted(alike)
    fits_as_well = all(
        constant_errors.is_close_to(errors)
        for constant_errors, errors in zip(constant.fit.errors, found.fit.errors, strict=True)
    )
    # What both predict badly tells them apart too little, as a flat OCV's ends, or an OCV that a
    # record alone visits: then what they leave of all records does.
    is_worth = crossed.constant.is_worth(crossed.tables) and not (
        found.unproved
        and constant.unproved
        and is_supported(found.unproved, crossed.tables, constant.unproved, crossed.constant)
    )
    if not (is_narrow or fits_as_well or is_worth):
        return proved(found)
    constant = proved(constant)
    held = constant.fit.cross_validation
    fit = replace(
        constant.fit,
        cross_validation=held and replace(held, over_soc=crossed.tables),
        intervals=tuple(_with_r0_over_soc(constant.fit, found.fit)),
    )
    return replace(constant, found=replace(constant.found, fits=(fit,)))


def _shown_hysteresis(found: OwnOcv, tables: TableSettings) -> Iterator[Notice]:
    """The warning where a circuit that was asked for leaves out a hysteresis that records show."""
    circuit, following = get_circuit(found.circuit), get_circuit(FOLLOWING)
    further = circuit.elements[following.pairs :]
    instead = "+".join((FOLLOWING, *further))
    if found.unproved is None or circuit.has_rate:
        return
    if circuit.elements != (*following.elements, *further):
        return
    if shows_more(instead, found.unproved, with_own_ocv(tables, instead)):
        yield notice("tables.hysteresis-left-out", circuit=circuit.name, instead=instead)


def _shown_direction(found: OwnOcv) -> Iterator[Notice]:
    """The warning where resistances were told to follow nothing beside SOC, and records show that
    they differ between charge and discharge: the OCV takes that up."""
    if found.settings.resistances_follow != "none" or found.unproved is None:
        return
    objective, best, _ = found.unproved
    settings = replace(objective.settings, resistances_follow="auto")
    following, _ = with_dependence(replace(objective, settings=settings), best)
    known = following.prepared_records[0].dependence
    if known is not None and known.charge_ratio is not None:
        yield notice("tables.direction-left-out", ratio=known.charge_ratio)


def _with_r0_over_soc(constant: TableFit, tables: TableFit) -> Iterator[NodeInterval]:
    """The intervals of one value, R0 reaching to the nodes of tables whose own leave it out."""
    (r0_ohm,) = constant.tables.tables[OHMIC]
    apart_ohm = [
        node.value - r0_ohm
        for node in tables.of_table(OHMIC)
        if node.low is not None and not node.low <= r0_ohm <= (node.high or math.inf)
    ]
    for node in constant.intervals:
        yield node.spanning(apart_ohm) if node.name == OHMIC and apart_ohm else node
