"""`barnax fleet`: many cells of a manifest, identified on processes or on Dask, a row each."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ..errors import InputError, as_keys
from ..files import changed_ns, located, replacing
from ..settings import Settings
from .options import (
    FIX,
    INPUT,
    OUTPUT,
    SEARCH,
    Files,
    Given,
    RecordOptions,
    Tables,
    argument,
    flag,
    group,
    option,
    options_of,
)
from .output import tell_unfinished
from .session import Session, as_flags, require_platform, shown

if TYPE_CHECKING:
    from ..fleet import FleetCell, Progress

ENGINE = "Engine"
# Problems of a manifest that a dry run lists one by one.
MAX_LISTED = 50


@group
class FleetSearch:
    """The circuit, and the search for that of each cell."""

    settings: Given = options_of(Settings(seeds=0), SEARCH, "model", "method", "seeds", "key")
    trust: Literal["none", "basic"] = option(
        SEARCH, "none|basic", "Compute intervals (basic) or not (none).", "basic"
    )
    bounds: Path | None = option(
        SEARCH, "FILE.toml", "Bounds of the cells without any in the manifest."
    )
    fix: list[str] | None = FIX
    cell: Path | None = option(
        INPUT, "RESULT", "result.json whose OCV and capacity all cells use, instead of --ocv."
    )


@group
class EngineOptions:
    """The engine, and the part of the fleet that it computes."""

    workers: int | None = option(ENGINE, "N", "Processes (default: as many as cores).", None, min=1)
    scheduler: str | None = option(
        ENGINE, "ADDRESS|local", "Dask scheduler instead of processes; local starts one."
    )
    shard: str | None = option(
        ENGINE, "K/N", "Only the K-th of N parts of the fleet, for an array of jobs."
    )
    retry: bool = flag(ENGINE, "--retry", "Repeat the cells that failed.")
    dry_run: bool = flag(
        ENGINE,
        "--dry-run",
        "List missing files and values that cannot be used, and compute nothing.",
    )


@group
class KeptFleet:
    """A fleet whose factors were kept, in place of a manifest, and how its rows are grouped."""

    fleet: str | None = typer.Option(
        None, "--from", metavar="FOLDER", rich_help_panel=INPUT,
        help="Instead of a manifest, a fleet that kept factors: fit them without its records.",
    )  # fmt: skip
    group: str = option(
        INPUT, "COLUMN,...", "With --from: rows that are alike in these columns are one cell.", "id"
    )


@group
class FleetOptions:
    """All that identifying a fleet can be told."""

    manifest: str | None = argument(
        "[MANIFEST]",
        "Table in CSV, Parquet or TOML with one row per cell: id, records, ocv and further "
        "options; other columns are copied to the dataset.",
        None,
    )
    kept: KeptFleet
    addresses: list[str] | None = option(
        INPUT,
        "ADDRESS",
        "What the manifest may read besides files: all below s3://bucket/folder; repeatable.",
    )
    files: Files
    of_records: RecordOptions
    search: FleetSearch
    tables: Tables
    engine: EngineOptions
    out: str = option(
        OUTPUT,
        "FOLDER",
        "Folder of the dataset, or its address; an interrupted run continues there.",
        "barnax-fleet",
    )
    keep_results: bool = flag(
        OUTPUT, "--keep-results", "Also write each cell's result.json, to results/ID."
    )
    keep_factors: Literal["tables", "constants"] | None = option(
        OUTPUT,
        "tables|constants",
        "Also keep what a fit of the records needs, to factors/ID: of tables over SOC, or of "
        "constant circuits alone.",
    )
    ageing: bool = flag(
        OUTPUT,
        "--ageing",
        "Also keep what each row's records tell of ageing, for barnax life: capacity, OCV shift, "
        "R0 and all resistances at 50 % SOC.",
    )
    quiet: bool = flag(OUTPUT, "--quiet -q", "Print nothing but warnings.")

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that hold for every cell."""
        search = self.search
        chosen: dict[str, Any] = {"seeds": 0, "trust": search.trust, **search.settings}
        if search.fix:
            from ..model.search_space import parse_fixed

            chosen["fix"] = parse_fixed(search.fix)
        keep: dict[str, Any] = {"keep_results": True} if self.keep_results else {}
        keep |= {"keep_factors": self.keep_factors} if self.keep_factors else {}
        keep |= {"ageing": True} if self.ageing else {}
        return chosen | self.tables.chosen() | keep

    @property
    def defaults(self) -> dict[str, Any]:
        """Values for what a row of the manifest leaves empty."""
        files = {"ocv": self.files.ocv, "validate": self.files.validate}
        given = {
            name: [path.absolute() for path in paths] for name, paths in files.items() if paths
        }
        given |= {name: values[-1] for name, values in self.of_records.given.items()}
        given |= {**self.files.cell, **self.files.read}
        for name in ("bounds", "cell"):
            if value := getattr(self.search, name):
                given[name] = value.absolute()
        return given


def fleet(given: FleetOptions) -> None:
    """Identify every cell of a fleet, into one Parquet dataset with one row per cell.

    If it is interrupted, the same command continues where it stopped. If a
    cell cannot be identified, its row says why. Options on files and records
    apply to cells whose row does not set them.
    """
    session = Session(is_quiet=given.quiet)
    from ..fleet.manifest import read_manifest
    from ..fleet.worker import prepare_process
    from ..reporting.fleet import closing_lines, problem_lines, progress_remark
    from ..reporting.words import counted

    engine, where = given.engine, given.manifest or given.kept.fleet
    if where is None or (given.manifest and given.kept.fleet):
        raise InputError("give a manifest, or the folder of a fleet with `from`")
    out, manifest = located(given.out), located(where)
    lines = list[str]()
    if given.manifest:
        problems = lines if engine.dry_run else None
        cells, carried = read_manifest(where, given.defaults, given.addresses or (), problems)
    elif manifest.resolve() == out.resolve():
        raise InputError(f"{out}: is the fleet that is regrouped; give `out` another folder")
    else:
        from ..fleet.regroup import regrouped

        columns = tuple(name.strip() for name in given.kept.group.split(","))
        cells, carried = regrouped(where, columns), columns
    session.note(_what_is_there(cells, carried))
    prepare_process()
    # Loads JAX, which no exception may stop.
    from ..fleet.rows import job_of

    settings = given.settings
    _ = job_of(settings)
    if engine.dry_run:
        lines = list(map(as_keys, lines)) + problem_lines(cells)
        session.show(map(shown, lines[:MAX_LISTED]))
        if lines:
            count = counted(len(lines), "problem")
            raise InputError(f"{manifest}: {count} to correct")
        return
    from ..fleet.dataset import dataset_path, parts_folder
    from ..fleet.engine import identify_fleet, parse_shard

    require_platform()
    page = out / "report.html"
    if page.exists() and not (dataset_path(out).exists() or parts_folder(out).exists()):
        raise InputError(f"{page}: is of no fleet; give `out` another folder")
    started_s = time.perf_counter()
    with session.counting("Identifying", len(cells)) as advance, _ended_from_within():

        def report(state: "Progress") -> None:
            advance(
                state.finished + state.skipped,
                progress_remark(state, time.perf_counter() - started_s),
            )

        state = identify_fleet(
            cells,
            out,
            settings=settings,
            workers=engine.workers,
            scheduler=engine.scheduler,
            shard=parse_shard(engine.shard) if engine.shard else None,
            retry=engine.retry,
            report=report,
        )
    # Parts, factors and results are folders in it.
    for folder in (out, *filter(Path.is_dir, out.iterdir())) if isinstance(out, Path) else ():
        tell_unfinished(session, folder)
    lines = closing_lines(state, out, session.elapsed_s, engine.shard)
    # Shards run beside each other: the command that takes them together writes the report.
    if not engine.shard:
        is_old = not page.exists() or changed_ns(page) < changed_ns(manifest)
        with session.watch("Writing the report"):
            lines[1] = _summed_up(cells, settings, out, write=is_old or state.finished > 0)
    session.show(shown(as_flags(line)) for line in lines)


@contextmanager
def _ended_from_within() -> Iterator[None]:
    """A block that a signal leaves by an exception, which ends the workers, before the process."""
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
    cells: "list[FleetCell]", settings: dict[str, Any], out: Path, *, write: bool
) -> str:
    """The report's sentence, and in the folder itself where something is new in it; fits that
    cannot be repeated are not drawn."""
    from ..fleet.rows import identified
    from ..fleet.summary import read_fleet, summarize
    from ..reporting.fleet import (
        failed_sentence,
        fleet_document,
        fleet_illustrations,
        fleet_sentence,
    )
    from ..reporting.render import to_html

    known = {cell.id: cell for cell in cells}
    rows = read_fleet(out, known)
    summary = summarize(rows)
    told = as_keys(fleet_sentence(summary) + failed_sentence(summary))
    if not write:
        return told
    worst = {}
    for name, _ in summary.worst:
        with suppress(InputError, KeyError):
            alone = replace(known[name], validate=())
            # All cells of a pack would be identified again.
            if "pack_cells" in alone.options:
                continue
            worst[name] = identified(alone, settings | {"trust": "none"})[0].run.identification[0]
    document = fleet_document(summary, fleet_illustrations(rows, worst))
    with replacing(out / "report.html") as file:
        file.write(to_html(document.with_option_names(as_keys)).encode())
    return told


def _what_is_there(cells: "list[FleetCell]", carried: tuple[str, ...]) -> str:
    from ..reporting.words import counted

    records = sum(len(cell.records) for cell in cells)
    text = f"{counted(len(cells), 'row')}, {counted(records, 'record')}"
    return f"{text}; copied to the dataset: {', '.join(carried)}" if carried else text
