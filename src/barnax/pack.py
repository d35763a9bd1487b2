"""A pack: one current and many cell voltages, every cell from one reduction.

The mean of the cell voltages is identified like a single cell, with its OCV test or without; this
gives the axis of SOC, the time constants and the resistance law. The cells are reported relative to
it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from .display import Brief
from .errors import InputError
from .fit.pack import CAPACITY, LOADED, R0, SHIFT, TOTAL, PackFit, Value, fit_pack
from .fit.temperature_fits import TableFits
from .identification.pipeline import identify
from .inputs import listed, source_of
from .job import Job, takes_options
from .metrics import NORMAL_95, robust_deviations
from .model.prepared import PreparedRecord
from .notices import Notice
from .records.lag import Scan
from .records.read import PackRecord, read_pack
from .results import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A cell this many robust deviations from the median of the cells is an outlier, if there are enough
# cells.
ODD, FEWEST = 6.0, 8
# Quantities that are tested for outliers.
LOOKED_AT = (R0, TOTAL, SHIFT, CAPACITY)
LAG = "voltage lag [s]"


@dataclass(frozen=True)
class Odd:
    """A quantity in which a cell is an outlier.

    Attributes:
        cell: Name of the cell.
        quantity: The quantity.
        deviations: Distance from the median of the cells in robust standard deviations.
    """

    cell: str
    quantity: str
    deviations: float


@dataclass(frozen=True, eq=False, repr=False)
class Pack(Brief):
    """A pack identified.

    Attributes:
        result: Result for the mean cell.
        fit: Every cell's tables, values and intervals.
        odd: Outlying cells, the farthest first.
        weakest: The cell with the lowest voltage under load at low SOC.
        left_out: Cells whose voltages could not be used, each with the reason.
        voltage_offsets_v: Voltage of every cell above the mean, at the simulated samples.
    """

    result: Result
    fit: PackFit
    odd: tuple[Odd, ...]
    weakest: str
    left_out: Mapping[str, str]
    voltage_offsets_v: Float[np.ndarray, "simulated cells"]

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.result.name

    def rows(self) -> list[dict[str, str | float | None]]:
        """A row for each cell: its values with the ends of their intervals, and its outlying
        quantities."""
        rows = []
        for cell in self.fit.cells:
            row: dict[str, str | float | None] = {"cell": cell.name, "RMSE [V]": cell.rmse_v}
            for name in (*LOOKED_AT, LOADED, *([LAG] if LAG in cell.values else ())):
                value = cell.values.get(name)
                for end in ("value", "low", "high"):
                    row[name if end == "value" else f"{name} {end}"] = getattr(value, end, None)
            odd = [outlier.quantity for outlier in self.odd if outlier.cell == cell.name]
            rows.append(row | {"odd": "; ".join(odd), "weakest": cell.name == self.weakest})
        return rows

    def figure(self) -> "Figure":
        """Every cell's values with their intervals, as a matplotlib `Figure`."""
        from .plots import plot_pack

        odd = {(outlier.cell, outlier.quantity) for outlier in self.odd}
        return plot_pack(self.fit, odd, self.weakest)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PackJob(Job):
    """A job on the cells of one file, each with tables over SOC."""

    over: Literal["soc"] | None = "soc"
    cells: str | None = None
    separate_time_constants: bool = False


@takes_options(PackJob)
def identify_pack(job: PackJob) -> Pack:
    """Every cell of a pack, from a file or data frame with one current and many cell voltages.

    All other options are those of `identify`, such as `ocv`, `capacity` and `window`; the circuit
    is `so-rc` with tables over SOC unless `model` is another one without dynamic hysteresis.

    Args:
        records: The file, or a data frame.
        cells: Names of the columns of cell voltages, as patterns such as "V*"; None detects them.
        separate_time_constants: Give every cell its own time constants; otherwise all have the mean
            cell's.

    Raises `InputError` if the columns are ambiguous, and in the cases of `identify`.

    >>> import numpy as np
    >>> import polars as pl
    >>> from barnax import bundled_file, identify_pack
    >>> table = pl.read_parquet(bundled_file("identification")).head(1500)
    >>> cells = {f"V{k}": pl.col("Voltage / V") + 1e-3 * k for k in range(1, 4)}
    >>> pack = identify_pack(
    ...     table.with_columns(**cells).drop("Voltage / V"),
    ...     ocv=[bundled_file("ocv_charge"), bundled_file("ocv_discharge")],
    ... )
    >>> pack.weakest
    'V1'
    """
    records = listed(job.records)
    if len(records) != 1:
        raise InputError(f"a pack is one file with all its cells, but {len(records)} were given")
    source = source_of(records[0], {}, job)
    read = read_pack(source, job.cells, **job.of_record(source.name))
    chosen: dict[str, Any] = {"seeds": 0, "trust": "none", "model": "so-rc", **job.chosen}
    chosen |= {"records": [read.source], "over": "soc"}
    if read.scan is not None:
        chosen["voltage_lag"] = read.record.voltage_lag_s
    result = identify(PackJob(**chosen))
    tables = result.fits
    if result.over is None:
        raise InputError(f"{read.record.name}: has no tables over SOC, so no cells are told")
    prepared = result.evaluations.identification[0].prepared
    if prepared.hysteresis_amplitude_v is not None:
        raise InputError("the circuit of a pack has no dynamic hysteresis; use so-rc or iso-rc")
    rows = np.searchsorted(read.record.row, prepared.record.row[prepared.span])
    voltage_offsets_v = read.voltage_offsets_v[rows]
    how = tables.settings, job.separate_time_constants
    fit = fit_pack(prepared, result.circuit_parameters, voltage_offsets_v, read.cells, *how)
    if read.scan is not None:
        fit = _with_lags(fit, read, read.scan)
        ends = {"least_s": float(read.scan.lag_s.min()), "most_s": float(read.scan.lag_s.max())}
        scanned = Notice("late-voltage.scanned", ends, read.record.name)
        result = result.model_copy(update={"warnings": (*result.warnings, scanned)})
    fit = _spanning(fit, prepared, tables)
    weakest = min(fit.cells, key=lambda cell: cell.values[LOADED].value).name
    return Pack(result, fit, tuple(odd_ones(fit)), weakest, read.left_out, voltage_offsets_v)


def _spanning(fit: PackFit, prepared: PreparedRecord, tables: TableFits) -> PackFit:
    """The fit with intervals extended to other possible values of its resistances: with a pair in
    R0 that the samples cannot resolve, and with the other sampling of the current, if that is
    undetermined, by the same amounts as for the mean cell."""
    shares, ohm = tables.least_r0_shares([prepared]), tables.named_ohm
    shifts = {R0: [share * tables.mean_ohm(name) for name, share in shares.items()]}
    other = tables.other_sampling([prepared])
    if other is not None:
        total_ohm = other.most_ohm + sum(share * ohm[name] for name, share in other.shares.items())
        shifts[R0].append(other.most_ohm)
        shifts |= {TOTAL: [total_ohm], LOADED: [-prepared.capacity_ah * total_ohm]}

    cells = []
    for cell in fit.cells:
        values = {name: one.spanning(shifts.get(name, ())) for name, one in cell.values.items()}
        cells.append(replace(cell, values=values))
    return replace(fit, cells=tuple(cells))


def _with_lags(fit: PackFit, read: PackRecord, scan: Scan) -> PackFit:
    """The fit with every cell's lag, whose error is included in the interval of R0."""
    cells, reaches_ohm = [], scan.reach_ohm(read.record)
    lags = np.column_stack([scan.lag_s, NORMAL_95 * scan.error_s, reaches_ohm]).tolist()
    for cell, (lag_s, error_s, ohm) in zip(fit.cells, lags, strict=True):
        widened = {name: cell.values[name].widened(ohm) for name in (R0, TOTAL)}
        lag = {LAG: Value(lag_s, lag_s - error_s, lag_s + error_s)}
        cells.append(replace(cell, values={**cell.values, **widened, **lag}))
    return replace(fit, cells=tuple(cells))


def odd_ones(fit: PackFit) -> list[Odd]:
    """The cells far from the others in some quantity."""
    outliers = []
    for name in LOOKED_AT:
        values = [(cell.name, cell.values[name].value) for cell in fit.cells if name in cell.values]
        if len(values) < FEWEST:
            continue
        deviations = robust_deviations(np.array([value for _, value in values]))
        outliers += [
            Odd(cell, name, float(apart))
            for (cell, _), apart in zip(values, deviations, strict=True)
            if abs(apart) > ODD
        ]
    return sorted(outliers, key=lambda outlier: -abs(outlier.deviations))
