"""`barnax fleet`: many cells of a manifest, identified by processes or on Dask, one row each; and
`barnax life`: the cells' ageing from such rows."""

import io
import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import barnax

from .. import reporting
from ..errors import InputError, as_keys, counted
from ..files import changed_ns, is_address, located, replacing
from .options import Given, options_of, options_of_job
from .output import Output, drawn_files, page_of, report_unfinished
from .session import Session, as_flags, require_platform, shown

if TYPE_CHECKING:
    from ..fleet import FleetCell, Progress
    from ..life import Life

# Problems of a manifest that a dry run lists individually.
MAX_LISTED = 50
# Outliers have a page each; of many, the most extreme ones.
MOST_PAGES = 20


def fleet(
    *,
    manifest: str | None = None,
    fleet: str | None = None,
    group: str = "id",
    addresses: list[str] | None = None,
    files: Annotated[Given, options_of("files")],
    of_records: Annotated[Given, options_of("records")],
    search: Annotated[Given, options_of("model", "method", "seeds", "key", "fix", "tables")],
    trust: Literal["none", "basic"] = "basic",
    bounds: Path | None = None,
    cell: Path | None = None,
    workers: Annotated[int | None, {"min": 1}] = None,
    scheduler: str | None = None,
    shard: str | None = None,
    retry: bool = False,
    dry_run: bool = False,
    out: str = "barnax-fleet",
    keep_results: bool = False,
    keep_factors: Literal["tables", "constants"] | None = None,
    ageing: bool = False,
    quiet: bool = False,
) -> None:
    """Identify many cells, into one dataset with a row per cell.

    If it is interrupted, the same command continues where it stopped. If a
    cell cannot be identified, its row says why. Options on files and records
    apply to cells whose row does not set them.

    Arguments:
        manifest ([MANIFEST]): Table in CSV, Parquet or TOML with one row per cell: id, records, ocv
            and further options; other columns are copied to the dataset.

    Files:
        fleet (--from FOLDER): Fit the factors that a fleet kept; instead of a manifest, and
            without its records.
        group (COLUMN,...): With --from: rows that agree in these columns are one cell.
        addresses (ADDRESS): Address that the manifest may read from besides files, such as
            s3://bucket/folder; repeatable.
        cell (RESULT): Result whose OCV and capacity all cells use; instead of --ocv.

    Search:
        trust (none|basic): Compute intervals (basic) or not (none).
        bounds (FILE.toml): Bounds of cells without any in the manifest.

    Engine:
        workers (N): Processes (default: as many as cores).
        scheduler (ADDRESS|local): Dask scheduler instead of processes; local starts one.
        shard (K/N): Only the K-th of N parts of the fleet, for an array of jobs.
        retry: Repeat the cells that failed.
        dry_run: Only check the manifest and its files; list the problems.

    Output:
        out (FOLDER): Folder of the dataset, or its address; an interrupted run continues there.
        keep_results: Also write each cell's result.json (to results/ID).
        keep_factors (tables|constants): Also keep what a later fit needs (to factors/ID), without
            the records: a fit of tables over SOC, or of constant circuits alone.
        ageing: Also store what barnax life needs: each row's capacity, OCV shift, R0 and total
            resistance at 50 % SOC.
        quiet (--quiet -q): Print nothing but warnings.
    """
    session, folder, origin = (
        Session(is_quiet=quiet),
        located(out),
        located(manifest or fleet or ""),
    )
    if bool(manifest) == bool(fleet):
        raise InputError("give a manifest, or the folder of a fleet with `from`")
    problems = list[str]()
    if manifest:
        from ..fleet.manifest import read_manifest

        # Defaults of empty values; paths in a manifest are relative to it.
        defaults = {**files, **{name: values[-1] for name, values in of_records.items()}}
        for name in {"ocv", "validate"} & files.keys():
            defaults[name] = [path.absolute() for path in files[name]]
        defaults |= {"bounds": bounds and bounds.absolute(), "cell": cell and cell.absolute()}
        listed = problems if dry_run else None
        cells, carried = read_manifest(manifest, defaults, addresses or (), listed)
    elif origin.resolve() == folder.resolve():
        raise InputError(f"{folder}: is the fleet that is regrouped; give `out` another folder")
    else:
        from ..fleet.dataset import regrouped

        carried = tuple(name.strip() for name in group.split(","))
        cells = regrouped(origin, carried)
    records = counted(sum(len(one.records) for one in cells), "record")
    copied = f"; copied to the dataset: {', '.join(carried)}" if carried else ""
    session.note(f"{counted(len(cells), 'row')}, {records}{copied}")
    stored = {"keep_results": keep_results, "keep_factors": keep_factors, "ageing": ageing}
    settings = {"seeds": 0, "trust": trust, **options_of_job(search)}
    settings |= {name: value for name, value in stored.items() if value}
    from ..fleet.engine import identify_fleet, prepare_process

    prepare_process()
    # Loads JAX, which must not be stopped by an exception.
    from ..fleet.dataset import FACTORS, RESULTS, parse_shard
    from ..fleet.rows import job_of

    _ = job_of(settings)
    if dry_run:
        return _print_problems(session, cells, settings, problems, origin)
    require_platform()
    # Files of a shard have its number in their names.
    if not (any(folder.glob("cells*.parquet")) or any(folder.glob("parts*"))):
        for name in ("report.html", RESULTS * keep_results, FACTORS * bool(keep_factors)):
            if name and (folder / name).exists():
                raise InputError(f"{folder / name}: is of no fleet; give `out` another folder")
    begun_s, wording = time.perf_counter(), reporting.wording.wording
    with session.watch("Identifying", len(cells)) as update, _ended_from_within():

        def report(state: "Progress") -> None:
            remark = wording("fleet.progress", state, time.perf_counter() - begun_s)
            update(completed=state.finished + state.skipped, remark=shown(remark))

        part = parse_shard(shard) if shard else None
        engine: dict[str, Any] = {"workers": workers, "scheduler": scheduler, "retry": retry}
        state = identify_fleet(
            cells, folder, settings=settings, shard=part, report=report, **engine
        )
    # Parts, factors and results are subfolders.
    if isinstance(folder, Path):
        for inside in (folder, *filter(Path.is_dir, folder.iterdir())):
            report_unfinished(session, inside)
    lines = [wording("fleet.done", state, session.elapsed_s)]
    # Shards run at the same time: the command that joins them writes the report.
    if shard:
        lines += [wording("fleet.of_shard", shard), str(folder)]
    else:
        with session.watch("Writing the report"):
            lines.append(_summed_up(cells, settings, folder, origin, is_new=state.finished > 0))
        lines.append(f"{folder}/report.html   cells.parquet")
    session.show(shown(as_flags(line)) for line in lines)


def _print_problems(
    session: Session,
    cells: "Sequence[FleetCell]",
    settings: dict[str, Any],
    problems: list[str],
    origin: Path,
) -> None:
    """Print the mistakes in a manifest and in its files. Raises `InputError` if there are any."""
    from ..fleet.rows import reasons_against

    with session.watch("Checking", len(cells)) as advance:
        for cell in cells:
            problems += [f"{cell.id}: {reason}" for reason in reasons_against(cell, settings)]
            advance(1)
    session.show(shown(as_keys(line)) for line in problems[:MAX_LISTED])
    if problems:
        raise InputError(f"{origin}: {counted(len(problems), 'problem')} to correct")


@contextmanager
def _ended_from_within() -> Iterator[None]:
    """A block that a signal leaves by an exception, which ends the workers before the process."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.default_int_handler) for number in numbers]
    heard = []
    try:
        yield
    except KeyboardInterrupt:
        heard = [signal.SIGINT]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
    for number in heard:
        signal.raise_signal(number)


def _summed_up(
    cells: "Sequence[FleetCell]", settings: dict[str, Any], out: Path, origin: Path, is_new: bool
) -> str:
    """The sentence of the report, which is also written to the folder if its rows or origin are
    new; fits that cannot be repeated are not drawn."""
    from ..fleet.rows import identified
    from ..fleet.summary import read_fleet, summarize

    by_id, page = {cell.id: cell for cell in cells}, out / "report.html"
    rows = read_fleet(out, by_id)
    summary = summarize(rows)
    if is_new or not page.exists() or changed_ns(page) < changed_ns(origin):
        worst = {}
        # All cells of a pack would be identified again.
        for alone in (by_id[name] for name, _ in summary.worst if name in by_id):
            if "pack_cells" not in alone.options:
                with suppress(InputError):
                    cell = replace(alone, validate=())
                    result, _ = identified(cell, settings | {"trust": "none"})
                    evaluations = result.without_tables().evaluations
                    worst[alone.id] = evaluations.identification[0]
        drawn = reporting.fleet.fleet_illustrations(rows, worst)
        document = reporting.fleet.fleet_document(summary, drawn)
        with replacing(page) as file:
            file.write(reporting.render.to_html(document.with_option_names(as_keys)).encode())
    return as_keys(reporting.wording.wording("fleet.closing", summary))


def life(
    *,
    dataset: str,
    by: str | None = None,
    age: str | None = None,
    throughput: str | None = None,
    false_alarms: float = 0.005,
    cell: list[str] | None = None,
    key: int = 0,
    output: Output,
) -> None:
    """Show how a fleet's cells age, and flag outliers.

    Trends of capacity, resistances and OCV are smooth in age, pooled over the
    fleet, and have 95 % intervals. What the records do not determine is reported
    as such.

    Arguments:
        dataset (DATASET): Folder that barnax fleet --ageing wrote, or its address.

    Ageing:
        by (COLUMN): Column that names the cell of a row (default: specimen, cell_name, name or
            serial).
        age (COLUMN): Column of dates, or of ages in days, weeks, months, years, cycles or
            ampere-hours as its name says (default: the first such column).
        throughput (COLUMN): Column of ampere-hours since new, for equivalent full cycles.
        false_alarms (RATE): Accepted false alarms per cell and year, or per cell and 365 cycles.
        cell (NAME): Also write a page for this cell; repeatable (default: the outliers).
        key (N): Random key of the simulated fleets without faults.
    """
    inputs = [] if is_address(dataset) else [Path(dataset)]
    run = output.begun("barnax-life", *inputs, with_jax=False)
    with run.watch("Fitting trends"):
        from ..fleet.summary import read_fleet
        from ..life import life_of

        if not 0 < false_alarms < 1:
            raise InputError(f"`false_alarms` {false_alarms:g}: give a rate such as 0.005")
        trends = life_of(read_fleet(dataset), age, by, throughput, false_alarms, key)
    unknown = [name for name in cell or () if name not in trends.cells]
    if unknown:
        raise InputError(f"`cell` {unknown[0]!r}: no cell of {dataset} is called so")
    odd = list(dict.fromkeys(fault.cell for fault in trends.faults))[:MOST_PAGES]
    pages = dict.fromkeys([*(cell or ()), *odd])

    def files() -> dict[str, bytes]:
        table = io.BytesIO()
        reporting.life.life_frame(trends).write_parquet(table)
        return {"trends.parquet": table.getvalue(), **_pages(trends, pages)}

    run.show(shown(as_flags(line)) for line in reporting.life.life_lines(trends))
    run.deliver({"life.json": reporting.life.life_json(trends)}, files)
    names = ["report.html", "trends.parquet", "life.json"]
    of_cells = f"{counted(len(pages), 'page')} in cells" if names[0] in run.written else ""
    run.show_written(names, of_cells)


def _pages(trends: "Life", cells: Iterable[str]) -> dict[str, bytes]:
    plots, illustrate = barnax.plots, reporting.illustrations.illustrate
    drawn = [illustrate("life", "all cells", plots.plot_fleet_life, trends)]
    document_of = partial(reporting.life.life_document, trends)
    files = drawn_files(lambda: drawn, document_of, report=True, paper=False)
    for number, cell in enumerate(cells, 1):
        pictures = [illustrate(f"cell-{number}", cell, plots.plot_cell_life, trends, cell)]
        page = reporting.life.cell_document(trends, cell, pictures)
        files[f"cells/{number}-{_file_name(cell)}.html"] = page_of(page)
        files[f"figures/cell-{number}.png"] = pictures[0].png
    return files


def _file_name(cell: str) -> str:
    """A valid file name in its folder."""
    kept = "".join(letter if letter.isalnum() or letter in "-_ " else "-" for letter in cell)
    return kept[:100] or "cell"
