"""A cell's row: all that a fleet keeps of an identification, flat, or the reason why it failed."""

import functools
import hashlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cell import CellModel, OcvTable, characterize, read_ocv_test
from ..cell.parameters import ANYWHERE
from ..checks import check_file
from ..checks.against_cell import compare_temperatures
from ..errors import InputError, attempt, reason_of
from ..files import fetched, is_address, is_factor_file
from ..fit.factor_file import factors_to_bytes, read_factors
from ..fit.record_factors import Grid, factors_of, factors_of_cells, fit_factors
from ..fit.settings import table_name
from ..fit.table_fit import TableFit
from ..identification.pipeline import identify, identify_problem
from ..identification.setup import bounded_tables
from ..inputs import RecordTemperatures, file_names, input_warnings, read_inputs, source_of
from ..job import Job
from ..life.rows import ageing_row
from ..metrics import Metrics
from ..model.window import Window
from ..notices import Notice
from ..pack import Pack, identify_pack
from ..plan import plan_of, planned
from ..records import Record, Source, read_source
from ..records.logger import Loggers
from ..records.table import LARGEST_FILE
from ..result_parts import bands_by_soc
from ..results import Result
from ..search.evaluate import pooled
from ..settings import CellSettings, Reading, Settings
from .dataset import factors_path, keep_file, result_path
from .manifest import FleetCell, Options, short_name, stamp

# Settings of a fleet that are not arguments of `identify`.
OF_FLEET = ("keep_results", "keep_factors", "pack_cells", "ageing", "loggers")
CELLS_KEPT = 16
# SOC at which tables are stored in a row.
MIDDLE_SOC = 0.5
Row = dict[str, Any]


def identify_rows(cell: FleetCell, settings: Options, out: Path | None = None) -> list[Row]:
    """The row of a cell, with the reason in one sentence if it cannot be identified; for a pack
    that of its mean cell, then one for each cell.

    `out` is the fleet's folder, where its `result.json` and factors are kept if requested.
    """
    start_s = time.perf_counter()
    row: Row = {"id": cell.id, "error": None, "error code": None, **cell.carried}
    of_pack: list[Row] = []
    try:
        grid = grid_of(cell, settings)
        if cell.records and all(map(is_factor_file, cell.records)):
            row |= _refitted(cell, settings)
        else:
            pack = None
            if "pack_cells" in cell.options:
                pack = _identified_pack(cell, settings)
                result, warnings = pack.result, pack.result.warnings
            else:
                result, warnings = identified(cell, settings)
            constant = result.without_tables().evaluations
            used, aged = [evaluation.prepared for evaluation in constant.identification], {}
            if settings.get("ageing"):
                aged, reported = ageing_row(used, is_fitted_ocv=not cell.ocv and cell.cell is None)
                warnings = (*warnings, *reported)
            row |= row_of(result, warnings) | aged
            if pack is not None:
                of_pack += [{**each, **cell.carried} for each in pack_rows(pack, cell.id)]
            if out is not None and settings.get("keep_results"):
                keep_file(out, result_path(out, cell.id), result.to_json().encode())
            if out is not None and grid is not None:
                factors = [[factors_of(prepared, grid) for prepared in used]]
                if pack is not None:
                    names = [cell.name for cell in pack.fit.cells]
                    factors += [
                        [each]
                        for each in factors_of_cells(used[0], grid, pack.voltage_offsets_v, names)
                    ]
                for each, records in zip([row, *of_pack], factors, strict=True):
                    content = factors_to_bytes(records)
                    each["factor bytes"] = keep_file(out, factors_path(out, each["id"]), content)
    except InputError as problem:
        # One sentence; reports on the individual files of a folder go to the warnings.
        row["error"], *row["warnings"] = str(problem).splitlines()
        row["error code"] = problem.code
    except Exception as problem:
        # Any problem of one cell costs that cell its row and no other.
        row["error"] = f"{type(problem).__name__}: {reason_of(problem)}"
    row["seconds"] = time.perf_counter() - start_s
    return [row, *of_pack]


def grid_of(cell: FleetCell, settings: Options) -> Grid | None:
    """The grid on which a cell's factors are kept; None if they are not.

    Raises `InputError` for a circuit whose factors cannot be kept.
    """
    kind = settings.get("keep_factors")
    circuit = cell.options.get("model") or settings.get("model") or Grid.circuit
    nodes = ANYWHERE if kind == "constants" else Grid.nodes
    return Grid(circuit=circuit, nodes=nodes) if kind else None


def identified(cell: FleetCell, settings: Options) -> tuple[Result, tuple[Notice, ...]]:
    """The result of a cell and all warnings. Raises `InputError` if an input cannot be used."""
    if cell.problem is not None:
        job = job_of(settings)
        result = identify_problem(cell.problem, job.part(Settings), trust=job.trust)
        return result, result.warnings
    job = _job_on_files(cell, settings)
    if not cell.ocv and cell.cell is None:
        # The roles say how each file is used. Tables, like a refit from kept factors.
        result = identify(job if job.model or job.over else job.changed(over="soc"))
        return result, result.warnings
    window = Window(**cell.window)
    cell_model, tests, of_tests, tests_degc = _cell_of_tests(
        cell.cell and (cell.cell, stamp(cell.cell)),
        tuple((path, stamp(path)) for path in cell.ocv),
        window.capacity_ah, window.rest_current_a, job.part(Reading), job.part(CellSettings),
    )  # fmt: skip
    result = identify(job.changed(ocv=tests, cell=cell_model))
    evaluations = result.evaluations
    used = [one.prepared for one in (*evaluations.identification, *evaluations.validation)]
    measured = [(prepared.record.name, prepared.temperature_degc) for prepared in used]
    more = compare_temperatures(measured, tests_degc)
    return result, tuple(dict.fromkeys((*result.warnings, *of_tests, *more)))


def _job_of_cell(cell: FleetCell, settings: Options) -> Job:
    """The job of a cell without its records. Raises `InputError` if a file is missing."""
    if cell.missing:
        raise InputError(f"{'; '.join(cell.missing)}: correct the name in the manifest")
    return job_of(settings).changed(**cell.options, bounds=cell.bounds)


def _job_on_files(cell: FleetCell, settings: Options) -> Job:
    """The job on the records of a cell."""
    job = _job_of_cell(cell, settings).changed(window=_windows(cell))
    paths, loggers = (*cell.records, *cell.validate), settings.get("loggers")
    # Files whose roles have yet to be determined stay files.
    if loggers and (cell.ocv or cell.cell is not None):
        read = sources_of(paths, job, loggers)
    else:
        read = [_given(path, job) for path in paths]
    return job.changed(records=read[: len(cell.records)], validate=read[len(cell.records) :])


def _identified_pack(cell: FleetCell, settings: Options) -> Pack:
    """The pack in the single record of a cell."""
    if cell.missing or len(cell.records) != 1:
        why = "; ".join(cell.missing) or "a pack is one file with all its cells"
        raise InputError(f"{why}: correct the manifest")
    job = job_of({**settings, **cell.options, "over": "soc"})
    job = job.changed(window=_windows(cell), bounds=cell.bounds)
    asked = str(cell.options["pack_cells"])
    chosen: Row = {**job.chosen, "records": cell.records, "ocv": cell.ocv}
    return identify_pack(**chosen, cells=None if asked == "auto" else asked)


def pack_rows(pack: Pack, name: str) -> list[Row]:
    """The rows of a pack's cells, as a fleet's dataset has them."""
    rows = []
    first: Row = {"error": None, "error code": None, "circuit": pack.result.model, "pack": name}
    first["samples"] = pack.result.metrics.identification.samples
    last: Row = {"answer": "tables over SOC", "certified": False, "at bound": ""}
    for cell_row, fitted in zip(pack.rows(), pack.fit.cells, strict=True):
        plain = str(cell_row.pop("cell")).replace("/", "-").replace("\\", "-")
        values = {**cell_row, **fitted.tables.constants}
        row: Row = {"id": f"{name} {plain}", **first, **values, **last, **_warning_columns([])}
        rows.append(row)
    return rows


def _refitted(cell: FleetCell, settings: Options) -> Row:
    """The row for records of which only factors were kept, without their origin."""
    job = _job_of_cell(cell, settings)
    factors = [record for path in cell.records for record in read_factors(path)]
    if job.model not in (None, factors[0].circuit):
        raise InputError(
            f"the factors are of {factors[0].circuit}, and {job.model} was asked for; identify the "
            f"records with `model` {job.model}, and keep their factors again"
        )
    if job.model is not None and job.over is None:
        # As the records themselves would be fitted.
        factors = [record.constant() for record in factors]
    fit = fit_factors(factors, bounded_tables(job, but="[F]"))
    counts = [record.scored for record in factors]
    whole_v = float(np.sqrt(np.average([e.rmse_v**2 for e in fit.errors], weights=counts)))
    grid, circuit = factors[0].grid, factors[0].circuit
    # A constant circuit with a fitted OCV is stored like tables, as from its records.
    is_constant = grid.is_constant and grid.ocv != "own"
    over = "ocv" if grid.is_constant else "soc"
    return {
        "circuit": circuit,
        "records": f"{len(factors)} kept",
        "samples": sum(counts),
        "duration [s]": sum(record.scored_duration_s for record in factors),
        "capacity [A.h]": factors[0].capacity_ah,
        "RMSE [V]": whole_v,
        **_middle_of(fit, "" if is_constant else "tables "),
        **fit.tables.constants,
        "answer": "constants" if is_constant else table_name(circuit, over),
        "certified": False,
        "proved gap": None,
        "at bound": "; ".join(f"{hit.name} {hit.side}" for hit in fit.at_bound),
        **_warning_columns(fit.warnings),
        "held-out RMSE [V]": fit.cross_validation and fit.cross_validation.tables.rmse_v,
    }


def job_of(settings: Options) -> Job:
    """The job requested by the settings of a fleet, or the options of a row."""
    return Job(**{name: value for name, value in settings.items() if name not in OF_FLEET})


def reasons_against(cell: FleetCell, settings: Options) -> Iterator[str]:
    """Problems of a cell's row and, if there are none, the reason why its files cannot be used."""
    reasons = [*cell.missing]
    answers = attempt(_windows, cell), attempt(job_of, cell.options)
    reasons += [str(answer) for answer in answers if isinstance(answer, InputError)]
    yield from reasons
    has_samples = not all(map(is_factor_file, cell.records)) and "pack_cells" not in cell.options
    if reasons or not has_samples:
        return
    try:
        job = _job_on_files(cell, settings)
        tests = [_given(path, job) for path in cell.ocv]
        job = job.changed(ocv=tests, cell=Result.from_json(cell.cell).cell if cell.cell else None)
        plan = plan_of(job)
        job = job if plan is None else planned(plan, job)
        if job.ocv or job.cell is not None:
            read_inputs(job)
    except InputError as problem:
        # Followed by the reason for each file of a folder: the first shows the kind.
        yield "; ".join(str(problem).splitlines()[:2])


def _windows(cell: FleetCell) -> Window | dict[str, Window]:
    """One window for all records, or also separate ones for validation."""
    common = Window(**cell.window)
    if not cell.validate_window:
        return common
    windows = replace(common, **cell.validate_window)
    names = file_names([path for path in (*cell.records, *cell.validate) if not is_address(path)])
    called = (short_name(path) if is_address(path) else names[Path(path)] for path in cell.validate)
    return {"": common, **dict.fromkeys(called, windows)}


@functools.lru_cache(maxsize=CELLS_KEPT)
def _cell_of_tests(
    earlier: tuple[str, Any] | None,
    ocv: tuple[tuple[str, Any], ...],
    capacity_ah: float | None,
    rest_current_a: float | None,
    reading: Reading,
    fits: CellSettings,
) -> tuple[CellModel, list[Record | OcvTable], list[Notice], RecordTemperatures]:
    """The cell from OCV tests or an earlier result, with these tests, their warnings and their
    temperatures. Tests shared by many cells of a fleet are read and fitted once; a changed file
    counts as another one."""
    if earlier is not None:
        return Result.from_json(earlier[0]).cell, [], [], []
    tests, warnings, temperatures_degc = [], [], []
    for path, _ in ocv:
        source = source_of(_given(path, reading), {}, reading)
        tests.append(read_ocv_test(source, **reading.of_record(source.name, "OCV test")))
        if isinstance(tests[-1], OcvTable):
            continue
        checked = check_file(source, capacity_ah=capacity_ah)
        warnings += input_warnings(checked, "OCV test")
        if checked.traits is not None:
            temperatures_degc.append((checked.file, checked.traits.temperature_degc))
    model = characterize(
        tests, capacity_ah=capacity_ah, rest_current_a=rest_current_a, **fits.of_curves
    )
    return model, tests, warnings, temperatures_degc


def sources_of(paths: Sequence[str], reading: Reading, loggers: Loggers) -> list[Source]:
    """Files as sources, each with its logger's properties."""
    names = file_names([path for path in paths if not is_address(path)])
    read = [source_of(_given(path, reading), names, reading) for path in paths]
    return [source.logged_by(loggers) for source in read]


def _given(path: str, reading: Reading) -> Any:
    """A file as `identify` takes it; one in a store is fetched."""
    if not is_address(path):
        return path
    content = fetched(path, LARGEST_FILE)
    return read_source(short_name(path), **reading.of_tables, content=content)


def row_of(result: Result, warnings: Sequence[Notice]) -> Row:
    """A result, flat: parameters under PyBaMM's names with their intervals, errors, certificate."""
    alone = result.without_tables()
    evaluations, errors = alone.evaluations, alone.metrics.identification
    first = result.of_role("identification")[0]
    row: Row = {
        "circuit": alone.model,
        "records": result.name,
        "samples": errors.samples,
        "duration [s]": first.duration_s,
        "capacity [A.h]": first.capacity_ah,
        "temperature [degC]": evaluations.identification[0].prepared.temperature_degc,
        "initial SOC": result.initial_soc,
        "sampling": first.hold and first.hold.value,
        "sampling evidence": first.hold and first.hold.reason,
    }
    for fact in alone.fit.constant_facts:
        row[fact.name] = fact.value
        if alone.fit.intervals:
            row[f"{fact.name} low"], row[f"{fact.name} high"] = fact.low, fact.high
    validated = evaluations.validation
    validation = pooled(validated, "validation") if validated else None
    row |= _errors_of("", errors) | _errors_of("validation ", validation)
    if result.over is not None:
        row["tables RMSE [V]"] = result.metrics.identification.rmse_v
        row |= _middle_of(result.fit)
    bands = bands_by_soc(evaluations.identification)
    rmse_v = {round(10 * (band.low or 0.0)): band.rmse_v for band in bands}
    for tenth in range(10):
        row[f"RMSE SOC {10 * tenth} to {10 * tenth + 10} % [V]"] = rmse_v.get(tenth)
    gap = result.fits.proved_gap
    hashes = [part.sha256 for part in result.inputs]
    return row | {
        "answer": result.answer if result.over else result.constant.source,
        "certified": gap is not None and gap <= result.fits.settings.proved_share,
        "proved gap": gap,
        "at bound": "; ".join(f"{hit.name} {hit.side}" for hit in alone.at_bound),
        **_warning_columns([warning for warning in warnings if warning.counts]),
        "inputs sha256": hashlib.sha256(" ".join(hashes).encode()).hexdigest(),
    }


def _warning_columns(warnings: Sequence[Notice]) -> dict[str, list[str]]:
    codes = [warning.code for warning in warnings]
    return {"warnings": [str(warning) for warning in warnings], "warning codes": codes}


def _middle_of(fit: TableFit, whose: str = "tables ") -> dict[str, float | None]:
    """The resistances of tables at the node nearest to 50 % SOC that samples visit."""
    soc = min(fit.visited_nodes or fit.tables.nodes, key=lambda node: abs(node - MIDDLE_SOC))
    row: dict[str, float | None] = {"tables at SOC": soc}
    for fact in fit.facts:
        if fact.name in fit.tables.resistances and not fact.is_mean and fact.soc in (soc, None):
            row |= {f"{whose}{fact.name}": fact.value, f"{whose}{fact.name} low": fact.low}
            row[f"{whose}{fact.name} high"] = fact.high
    return row


def _errors_of(whose: str, metrics: Metrics | None) -> dict[str, float | None]:
    return {
        f"{whose}{name}": None if metrics is None else getattr(metrics, field)
        for name, field in (
            ("RMSE [V]", "rmse_v"),
            ("RMSE above 10 % SOC [V]", "rmse_above_10_soc_v"),
            ("max error [V]", "max_v"),
        )
    }
