"""Cells without an OCV test: the circuit of the family that their records support, with an OCV of
their own."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from .blas import one_blas_thread
from .cell import get_circuit
from .execution import in_float64
from .inputs import window_of
from .job import Job
from .model.prepared import PreparedRecord
from .model.search_space import ranges_of
from .notices import Notice, notice
from .over_soc import OwnOcv, OwnRecords, TableSettings, fit_own_temperatures, prove_own
from .over_soc.own_starts import Starts
from .over_soc.problem import find_best, reduced_objective
from .records import Record
from .select import Choice, Fitted, Policy, choose, limits_of
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


@in_float64
def own_ocv_of(job: Job, records: Sequence[Record]) -> OwnOcv:
    """The cell of records that have no OCV test, with their tables, or one value at every SOC.

    Raises `InputError` where what is asked for needs a test.
    """
    model = job.model and get_circuit(job.model)
    asked = {
        f"the hysteresis of {job.model}": model and model.has_hysteresis and not model.has_rate,
        "an OCV polynomial": job.ocv_fit == "polynomial",
    }
    for what, is_asked in asked.items():
        if is_asked:
            raise notice("ocv-test.missing", asked=what).error()
    windows = {record.name: window_of(job.window, record.name).as_told for record in records}
    is_over = job.over == OVER_TEMPERATURE
    tables = bounded_tables(job)
    own = OwnRecords.of(records, windows, tables, job.capacity, is_over)
    if is_over:
        return fit_own_temperatures(own, job.model or "so-rc")
    over_soc = None if job.model is None and job.over is None else job.over is not None
    limits = limits_of(own.level, tables, job.model, over_soc, has_ocv=True)
    starts: dict[str, Starts] = {}

    def prepare(circuit: str) -> list[PreparedRecord]:
        starts[circuit] = own.starts(circuit, next(iter(starts.values()), None))
        return own.prepared(circuit, starts[circuit].windows)

    choice = choose(prepare, tables, limits)
    chosen, point = choice.chosen, choice.chosen.point
    if len(records) > 1 and point.circuit not in starts:
        # The others' starts are those at which this circuit fits best.
        prepared = [one.following(point.law) for one in prepare(point.circuit)]
        objective = reduced_objective(prepared, chosen.objective.settings)
        with one_blas_thread():
            chosen = Fitted(point, objective, find_best(objective), chosen.loss)
    begun = starts.get(point.circuit) or starts[_alike(starts, point.circuit)]
    found = prove_own(own, chosen.objective, chosen.best, begun)
    return replace(
        found,
        tried=choice.tried,
        warnings=(*found.warnings, *_left_out(choice)),
    )


def _alike(starts: dict[str, Starts], circuit: str) -> str:
    """The circuit whose starts those of another with such a hysteresis are."""
    rate = get_circuit(circuit).has_rate
    return next(known for known in starts if get_circuit(known).has_rate == rate)


def _left_out(choice: Choice) -> Iterator[Notice]:
    """The warnings where what was asked for leaves out what the records show."""
    left_out = {own.ladder: own for own in choice.tried if own.outcome == "not asked for"}
    if "hysteresis" in left_out:
        given = choice.chosen.point.circuit, left_out["hysteresis"].circuit
        yield notice("tables.hysteresis-left-out", circuit=given[0], instead=given[1])
    if "law" in left_out:
        yield notice("tables.direction-left-out")
    for own in choice.tried:
        if own.ladder == "hysteresis" and own.outcome == "not determined":
            turned_soc = 3 / Policy.fastest_rate
            yield notice("tables.turns-at-once", turned_soc=turned_soc, instead=own.circuit)
            return
