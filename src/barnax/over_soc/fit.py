"""Tables identified from prepared records, and all that is said of them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..blas import one_blas_thread
from ..cell import SocTables, get_circuit
from ..cell.elements import get_element, names_of
from ..cell.parameters import OHMIC, RATE
from ..cell.tables import LEAST_OHM
from ..display import Brief
from ..errors import InputError
from ..execution import in_float64
from ..global_optimum.proof import Proof
from ..model.prepared import PreparedRecord
from ..model.search_space import RATE_RANGE, Range
from ..notices import Notice, notice
from ..schema import Told
from ..search.refine import AtBound
from .certificate import certify
from .cross_validation import (
    CrossValidation,
    SocErrors,
    blocks_of,
    cross_validate,
    held_out_errors,
    with_spread,
)
from .intervals import NodeInterval, intervals_of
from .objective import Solution, TableObjective
from .reduced import Reduced, layout_of, reduce_records, together
from .search import find_best
from .settings import FASTEST_TAU_S, SLOWEST_SHARE, SLOWEST_TAU_S, TableSettings
from .simulate import error_blocks

# A constant is at a bound within this share of the logarithm of its range.
AT_BOUND = 1e-3
# This share of a record's samples is enough to tell a time constant of their interval.
DENSE_QUANTILE = 0.05
# A table of which more nodes than this were not visited is mostly extrapolated.
MOSTLY = 0.5
# Records that go less SOC than this without turning tell nothing of the branch of that direction.
BOTH_WAYS_SOC = 0.1
# Of a dynamic hysteresis that such records do not tell: it has turned after about 10 % SOC.
HELD_GAMMA = 20.0


@dataclass(frozen=True)
class OcvCompared:
    """An OCV of the records' own in place of an OCV test, fitted at the same time constants.

    Attributes:
        own_v: RMSE with it on the records.
        held_out: Its errors on what the cross-validation holds out.
        median_v: How far it is from the test's, the median from 10 to 90 % SOC where visited.
        largest_v: Own minus test, where that is largest.
        largest_soc: Where that is.
    """

    own_v: float
    held_out: SocErrors | None
    median_v: float
    largest_v: float
    largest_soc: float


@dataclass(frozen=True, repr=False)
class TableFit(Brief):
    """Tables over SOC, with their proof, intervals and errors.

    Attributes:
        tables: The tables.
        objective_v: sqrt(J), the penalties included.
        errors: Errors on each record, by scan.
        tau_ranges_s: The box of time constants.
        lower_bound_v: No tables with time constants in the box have a smaller sqrt(J).
        status: "certified" where that is within the share asked for, else "grid-verified".
        boxes: Boxes of time constants that the proof took.
        at_bound: Time constants at a bound.
        parameters: Number of values that samples visit and of searched constants.
        intervals: 95 % intervals of visited nodes, then of searched constants.
        cross_validation: Errors on blocks held out.
        warnings: What is doubtful, with what to do.
        own_ocv: What an OCV of the records' own gives, beside that of an OCV test.
    """

    tables: SocTables
    objective_v: float
    errors: tuple[SocErrors, ...]
    tau_ranges_s: tuple[tuple[float, float], ...]
    lower_bound_v: float
    status: Literal["certified", "grid-verified"]
    boxes: int
    at_bound: tuple[AtBound, ...]
    parameters: int
    intervals: tuple[NodeInterval, ...]
    cross_validation: CrossValidation | None
    warnings: tuple[Told, ...]
    own_ocv: OcvCompared | None = None

    @property
    def proved_gap(self) -> float:
        """The largest share of sqrt(J) that other tables could save."""
        return max(0.0, 1 - self.lower_bound_v / self.objective_v) if self.objective_v else 0.0

    def of_table(self, name: str) -> tuple[NodeInterval, ...]:
        """The intervals of one table, by rising SOC."""
        return tuple(each for each in self.intervals if each.name == name and each.soc is not None)


def fit_tables(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings | None = None
) -> TableFit:
    """The best tables over SOC for one or several prepared records of one cell and circuit.

    The time constants are searched; for each candidate, all tables are the exact optimum of a
    bounded least-squares problem. The source voltage is that of the circuit: the average OCV for
    `so-rc`, with switched hysteresis for `iso-rc`, and with dynamic hysteresis for `esc`, whose
    amplitude is half the hysteresis voltage unless it is fitted.

    Args:
        prepared_records: The records in their windows, such as those of a problem.
        settings: Nodes, weights, bounds, proof and cross-validation.

    Raises `InputError` if the box of time constants is empty or too wide, and for `half_hysteresis`
    without a dynamic hysteresis.
    """
    settings = settings or TableSettings()
    objective = reduced_objective(prepared_records, settings)
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        proof = certify(objective, find_best(objective))
    return fit_of(objective, proof)


def fit_of(
    objective: TableObjective,
    proof: Proof,
    prepared_records: Sequence[PreparedRecord] | None = None,
) -> TableFit:
    """All that is known of the tables of a proof; their errors are on other records than those of
    the objective where these have another OCV."""
    settings, best = objective.settings, proof.best
    with one_blas_thread():
        tables = objective.tables_at(best)
        intervals = with_spread(objective, best, intervals_of(objective, best))
        held_out = cross_validate(objective, best)
    at_bound = _at_bound(objective, best)
    taus_s = tuple(limits for name, limits in objective.ranges.items() if name != RATE)
    is_close = proof.lower_bound_v >= (1 - settings.proved_share) * best.rms_v
    return TableFit(
        tables=tables,
        objective_v=best.rms_v,
        errors=tuple(
            errors_on(each, tables) for each in prepared_records or objective.prepared_records
        ),
        tau_ranges_s=taus_s,
        lower_bound_v=proof.lower_bound_v,
        status="certified" if is_close else "grid-verified",
        boxes=proof.boxes,
        at_bound=at_bound,
        parameters=sum(int(np.sum(objective.visited_of(n))) for n in range(objective.tables))
        + sum(axis.high > axis.low for axis in objective.axes),
        intervals=intervals,
        cross_validation=held_out,
        warnings=_warnings(objective, tables, at_bound),
    )


def constant_held_out(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> SocErrors | None:
    """The errors of the constant circuit on the blocks that are held out of tables.

    Its time constants are those of all samples, as those of tables are. None where nothing is held
    out.
    """
    plain = replace(settings, ocv_correction=False, half_hysteresis=False, rising_ocv=False)
    return constant_with_ocv_held_out(prepared_records, plain)


def constant_with_ocv_held_out(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> SocErrors | None:
    """The same of a constant circuit with such a table of the OCV as the settings have."""
    objective = reduced_objective(prepared_records, replace(settings, nodes=(0.5,)))
    with one_blas_thread():
        return held_out_errors(objective, find_best(objective))


def reduced_objective(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    ranges: Mapping[str, Range] | None = None,
    seen: Callable[[PreparedRecord], PreparedRecord] = lambda prepared: prepared,
) -> TableObjective:
    """The objective over all records, as they are `seen`, in the ranges given or their own."""
    ranges = ranges or box_of(prepared_records, settings)
    layout = layout_of(
        settings.nodes,
        settings.ocv_nodes or settings.nodes,
        ranges,
        settings.ocv_correction,
        settings.half_hysteresis,
        get_circuit(prepared_records[0].circuit).elements,
        min(float(np.min(np.diff(each.time_s))) for each in prepared_records),
    )

    def reduced(records: Sequence[PreparedRecord]) -> list[Reduced]:
        return reduce_records(records, layout, *blocks_of(records, settings))

    own = [seen(each) for each in prepared_records]
    parts, told = reduced(own), []
    if (
        settings.folds
        and len(prepared_records) > 1
        and any(each.window.registration for each in prepared_records)
    ):
        told = reduced([seen(each.as_told) for each in prepared_records])
    with one_blas_thread():
        whole = together(parts)
    return TableObjective(own, settings, ranges, whole, parts, told)


def held_at(objective: TableObjective, log_scales: Sequence[float]) -> dict[str, Range]:
    """The ranges that hold the time constants and gamma at some scales: far less to reduce for."""
    scales = zip(objective.ranges, log_scales, strict=True)
    return {name: (math.exp(scale), math.exp(scale)) for name, scale in scales}


def errors_on(prepared: PreparedRecord, tables: SocTables) -> SocErrors:
    """The errors of tables on a record, by scan."""
    return pooled_errors([prepared], tables)


@in_float64
def pooled_errors(prepared_records: Sequence[PreparedRecord], tables: SocTables) -> SocErrors:
    """The same on several records together."""
    return SocErrors.of(
        (error_v[each.scored[here]], each.soc[here][each.scored[here]])
        for each in prepared_records
        for here, error_v in error_blocks(each, tables)
    )


def box_of(prepared_records: Sequence[PreparedRecord], settings: TableSettings) -> dict[str, Range]:
    """The ranges of every pair's time constant, and that of gamma where there is one, by name."""
    circuit, ranges = get_circuit(prepared_records[0].circuit), settings.ranges
    interval_s = min(each.median_interval_s for each in prepared_records)
    duration_s = max(each.scored_duration_s for each in prepared_records)
    slowest_s = min(SLOWEST_TAU_S, duration_s * (SLOWEST_SHARE if settings.ocv_correction else 1.0))
    # What is much faster than the sampling cannot be told from the ohmic resistance. A pulse test
    # logs its rests slowly and its pulses fast, which tell.
    dense_s = min(
        float(np.quantile(np.diff(each.time_s), DENSE_QUANTILE, overwrite_input=True))
        for each in prepared_records
    )
    fastest_s = min(max(min(FASTEST_TAU_S, 2 * interval_s), dense_s / 2), slowest_s)
    box, known = {}, {OHMIC, RATE}
    for names, element in zip(names_of(circuit.elements), circuit.elements, strict=True):
        # The box is of the slowest RC pair in it.
        ratio = get_element(element).ratios[0]
        box[names.tau] = ranges.get(names.tau, (fastest_s / ratio, slowest_s / ratio))
        known |= {names.tau, names.resistance}
    unknown = ranges.keys() - known
    if unknown or (RATE in ranges and not circuit.has_rate):
        raise InputError(
            f"the circuit {circuit.name} has no {', '.join(sorted(unknown)) or RATE} to bound or "
            "fix"
        )
    if settings.half_hysteresis and not circuit.has_rate:
        raise InputError(
            f"the circuit {circuit.name} has no dynamic hysteresis, so `half_hysteresis` has no "
            "amplitude to fit; choose the circuit esc"
        )
    if any(high < math.nextafter(low, 0) for low, high in box.values()):
        raise InputError("the bounds leave no range for the time constants; widen them")
    if circuit.has_rate:
        # Held where the records do not tell it, and nothing else is asked for.
        is_told = settings.half_hysteresis or least_travel_soc(prepared_records) >= BOTH_WAYS_SOC
        box[RATE] = ranges.get(RATE, RATE_RANGE if is_told else (HELD_GAMMA, HELD_GAMMA))
    return box


def least_travel_soc(prepared_records: Sequence[PreparedRecord]) -> float:
    """How far the SOC goes without turning back, in the direction in which it goes less far."""

    def furthest(soc: Float[np.ndarray, "samples"], extreme: np.ufunc) -> float:
        ends = extreme.accumulate(soc)
        np.subtract(soc, ends, out=ends)
        return float(max(ends.max(), -ends.min()))

    return min(
        max(furthest(each.soc, extreme) for each in prepared_records)
        for extreme in (np.minimum, np.maximum)
    )


def _at_bound(objective: TableObjective, best: Solution) -> tuple[AtBound, ...]:
    found = []
    for axis, scale in zip(objective.axes, best.log_scales, strict=True):
        near = AT_BOUND * (axis.high - axis.low)
        if near and scale - axis.low <= near:
            found.append(AtBound(axis.name, "lower"))
        elif near and axis.high - scale <= near:
            found.append(AtBound(axis.name, "upper"))
    return tuple(found)


def _warnings(
    objective: TableObjective, tables: SocTables, at_bound: Sequence[AtBound]
) -> tuple[Notice, ...]:
    found = [
        _bound_warning(each, tables.constants[each.name], objective.settings.ocv_correction)
        for each in at_bound
    ]
    unvisited = 1 - float(np.mean(objective.visited))
    if unvisited > MOSTLY:
        found.append(notice("tables.mostly-unvisited", share=unvisited))
    resistance_ohm = np.sum([tables.r0_ohm, *tables.r_ohm], axis=0)
    bare = np.array(tables.nodes)[objective.visited & (resistance_ohm < LEAST_OHM)]
    found += [notice("tables.no-resistance", soc=soc) for soc in bare.tolist()]
    floor_ohm = objective.least_r0_ohm
    held = np.array(tables.nodes)[objective.visited & (np.array(tables.r0_ohm) <= floor_ohm)]
    if floor_ohm and len(held):
        where = ", ".join(f"{100 * soc:g}" for soc in held)
        found.append(notice("tables.r0-at-floor", floor_ohm=floor_ohm, percent=where))
    moved, ranges = least_travel_soc(objective.prepared_records), objective.settings.ranges
    if moved < BOTH_WAYS_SOC and tables.half_hysteresis_v is not None:
        found.append(notice("tables.one-direction", moved_soc=moved))
    elif moved < BOTH_WAYS_SOC and tables.gamma is not None and RATE not in ranges:
        found.append(notice("tables.gamma-held", moved_soc=moved, gamma=HELD_GAMMA))
    return tuple(found)


def _bound_warning(bound: AtBound, value: float, has_correction: bool) -> Notice:
    """The notice of a constant that a bound sets."""
    if not bound.name.startswith("tau"):
        return notice("tables.at-bound", name=bound.name, value=value)
    if bound.side == "lower":
        return notice("tables.tau-at-lower-bound", name=bound.name, value_s=value)
    told = {"value_s": value, "correction": "true" if has_correction else None}
    return notice("tables.tau-at-upper-bound", name=bound.name, **told)
