"""What a fleet costs: `python -m benchmarks.fleet [TINY CELLS]` writes results/fleet.md.

Simulates cells with scattered parameters on the bundled cell's current and identifies them with
every engine, each in a process of its own. Times are CPU seconds wherever other work on the machine
would decide wall time; ratios are of runs in turn. `TINY CELLS` says how many of 300 samples stand
for the 10,000 that are aimed at; a quarter of them are run as well.
"""

import argparse
import json
import logging
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results" / "fleet.md"
CELLS, ONE_BY_ONE, WITH_TABLES, TINY = 24, 4, 12, 300
LENGTHS = (3_000, 30_000)
NIGHT_CELLS, NIGHT_S, FINISHED = 10**7, 8 * 3600, 2000
ENGINES = (
    ("serial", "pool", 1, "one process"),
    ("pool", "pool", 2, "two processes"),
    ("dask", "dask", 2, "Dask, two local workers"),
)
# What is measured unless the page says otherwise: one circuit with constants, and no search.
ONE_CIRCUIT: dict[str, Any] = {"seeds": 0, "model": "iso-rc"}
# What a fleet does unless told otherwise: three circuits and tables, compared on held-out blocks.
DEFAULT: dict[str, Any] = {"seeds": 0}
# What a stage of a cell is called, and the function where its caller reads it.
STAGES = {
    "reading and checks": "barnax.identification.pipeline:read_inputs",
    "reduction": "barnax.model.problem:compress",
    "certified optimum, with the reduction": "barnax.identification.answer:find_global_optimum",
    "evaluation": "barnax.identification.answer:evaluate",
    "intervals": "barnax.identification.answer:assess",
    "result": "barnax.identification.answer:make_result",
    "row": "barnax.fleet.rows:row_of",
}


def make_cells(folder: Path, count: int, lengths: tuple[int, int]) -> Path:
    """Records of simulated cells of lengths between these, and their manifest."""
    import numpy as np
    import polars as pl
    from scipy.signal import lfilter

    import barnax

    ocv = [str(barnax.bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    cell = barnax.characterize([barnax.read_record(path) for path in ocv])
    drive_a = barnax.read_record(barnax.bundled_file("identification")).current_a
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    rows = []
    for place in range(count):
        samples = int(np.exp(rng.uniform(*np.log(lengths))))
        current_a = np.resize(drive_a, samples) * min(1.0, 18_000 / samples)
        charge_ah = np.append(0.0, np.cumsum(current_a[:-1])) / 3600
        r0, *r = np.array([0.03, 0.012, 0.02]) * np.exp(rng.normal(0, 0.1, 3))
        voltage_v = np.array(cell.average_ocv_v(0.98 - charge_ah / cell.capacity_ah))
        voltage_v += rng.normal(0, 1e-3, samples) - r0 * current_a
        tau = np.array([8.0, 150.0]) * np.exp(rng.normal(0, 0.2, 2))
        for r_ohm, tau_s in zip(r, tau, strict=True):
            kept = np.exp(-1 / tau_s)
            answer: Any = lfilter([0.0, 1 - kept], [1.0, -kept], current_a)
            voltage_v -= r_ohm * answer
        columns = {"Test Time / s": np.arange(samples) * 1.0, "Current / A": -current_a}
        name = f"cell{place:05d}.parquet"
        pl.DataFrame(columns | {"Voltage / V": voltage_v}).write_parquet(folder / name)
        rows.append({"id": name, "records": name, "ocv": ";".join(ocv), "initial_soc": 0.98})
    pl.DataFrame(rows).write_csv(folder / "cells.csv")
    return folder / "cells.csv"


def in_process(*words: object) -> dict:
    """What a measurement gives in a process of its own, with the CPU seconds that it took."""
    root = str(Path(__file__).parents[1])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-m", "benchmarks.fleet", "--measure", *map(str, words)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": paths}
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = json.loads(run.stdout.splitlines()[-1]) | {"cpu_s": spent}
    print(*words, found, file=sys.stderr, flush=True)
    return found


def measure_engine(engine: str, manifest: str, workers: str) -> dict:
    """One fleet on an engine: its wall time, the driver's CPU seconds, the workers' memory."""
    from barnax.fleet import identify_fleet, read_manifest

    cells, _ = read_manifest(manifest)
    with tempfile.TemporaryDirectory() as out:
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        scheduler = "local" if engine == "dask" else None
        state = identify_fleet(
            cells, out, settings=ONE_CIRCUIT, workers=int(workers), scheduler=scheduler
        )
        found = {
            "wall_s": time.perf_counter() - wall_s,
            "driver_s": time.process_time() - cpu_s,
            "bytes": (Path(out) / "cells.parquet").stat().st_size,
        }
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return found | {"cells": state.finished, "failed": state.failed, "worker_mib": most}


def measure_alone(manifest: str, count: str, kind: str = "one circuit") -> dict:
    """Cells one after another as a worker does them: the first, the others, and what compiles.

    `kind` is "one circuit" or "default".
    """
    from barnax.fleet.engine import prepare_process

    prepare_process()
    import jax
    import polars as pl

    from barnax.fleet import read_manifest
    from barnax.fleet.rows import identify_rows

    names: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: names.append(record.getMessage().split(" with ")[0])
    jax.config.update("jax_log_compiles", True)
    for module in ("pxla", "dispatch", "compiler"):
        part = "interpreters." if module == "pxla" else ""
        logger = logging.getLogger(f"jax._src.{part}{module}")
        logger.handlers, logger.propagate = [handler], False
    cells = read_manifest(manifest)[0][: int(count)]
    settings = DEFAULT if kind == "default" else ONE_CIRCUIT
    rows, spent, programs = [], [], []
    for cell in cells:
        start_s = time.process_time()
        rows += identify_rows(cell, settings)
        spent.append(time.process_time() - start_s)
        programs.append(sum(name.startswith("Compiling") for name in names))
    large = {"_descend", "respond_all", "rmse_of_all", "errors_and_slopes"}
    compiled = [name for name in names if name.startswith("Compiling")]
    large_programs = sum(name.partition("jit(")[2].strip(")") in large for name in compiled)
    half = len(cells) // 2
    failed = [row["error"] for row in rows if row["error"]]
    assert not failed, failed[0]
    return {
        "first_s": spent[0],
        "cell_s": statistics.median(spent[half:]),
        "programs": programs[-1],
        "large": large_programs,
        "later_programs": programs[-1] - programs[half],
        "row_bytes": pl.DataFrame(rows, infer_schema_length=None).estimated_size() / len(rows),
    }


def measure_loop(manifest: str, count: str) -> dict:
    """The same cells by `barnax.identify` with its defaults, one after another, per cell."""
    import barnax
    from barnax.fleet import read_manifest

    cells, _ = read_manifest(manifest)
    spent = []
    for cell in cells[: int(count)]:
        start_s = time.process_time()
        window = barnax.Window(**cell.window)
        barnax.identify(cell.records, ocv=cell.ocv, window=window)
        spent.append(time.process_time() - start_s)
    return {"cell_s": statistics.median(spent[1:])}


def measure_stages(count: str) -> dict:
    """The least CPU ms of every stage of the bundled cell, of some repeats."""
    from barnax.fleet.engine import prepare_process

    prepare_process()
    from importlib import import_module

    from barnax import bundled_file
    from barnax.fleet import fleet_cell_from_row
    from barnax.fleet.rows import identify_rows

    spent: dict[str, float] = {}

    def timed(name, function):
        def run(*given, **more):
            start_s = time.process_time()
            try:
                return function(*given, **more)
            finally:
                spent[name] = spent.get(name, 0.0) + 1e3 * (time.process_time() - start_s)

        return run

    for name, path in STAGES.items():
        module, _, function = path.partition(":")
        caller = import_module(module)
        setattr(caller, function, timed(name, getattr(caller, function)))
    ocv = [str(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    cell = fleet_cell_from_row(
        {"id": "bundled", "records": str(bundled_file("identification")), "ocv": ocv}
    )
    whole = timed("whole cell", identify_rows)
    found: dict[str, list[float]] = {}
    for turn in range(int(count)):
        spent.clear()
        (row,) = whole(cell, ONE_CIRCUIT)
        assert not row["error"], row["error"]
        for name, each in spent.items() if turn > 1 else ():
            found.setdefault(name, []).append(each)
    return {name: min(each) for name, each in found.items()} | {"samples": row["samples"]}


def measure_resuming(folder: str) -> dict:
    """A fleet whose cells are all done: what finding that out takes."""
    from barnax.fleet import fleet_cell_from_row, identify_fleet
    from barnax.fleet.dataset import dataset_path, read_rows, write_rows

    record = next(Path(folder).glob("*.parquet"))
    tracemalloc.start()
    cells = [fleet_cell_from_row({"id": f"{n}", "records": str(record)}) for n in range(FINISHED)]
    cell_bytes = tracemalloc.get_traced_memory()[0] / FINISHED
    tracemalloc.stop()
    with tempfile.TemporaryDirectory() as out:
        rows = [
            {"id": each.id, "error": None, "fingerprint": each.fingerprint(DEFAULT)}
            for each in cells
        ]
        write_rows(dataset_path(Path(out)), rows)
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        state = identify_fleet(cells, out)
        taken = {"wall_s": time.perf_counter() - wall_s, "own_s": time.process_time() - cpu_s}
        assert state.skipped == FINISHED == len(read_rows(Path(out)))
    return taken | {"cell_bytes": cell_bytes}


MEASURES = {
    "engine": measure_engine,
    "alone": measure_alone,
    "loop": measure_loop,
    "stages": measure_stages,
    "resuming": measure_resuming,
}


def page(folder: Path, tiny: int) -> str:
    """Everything measured, as a page."""
    from benchmarks.pages import as_markdown, provenance

    mixed = make_cells(folder / "mixed", CELLS, LENGTHS)
    few = make_cells(folder / "few", tiny // 4, (300, 301))
    many = make_cells(folder / "many", tiny, (300, 301))
    in_process("alone", mixed, CELLS)  # fills the cache of compiled programs
    load = os.getloadavg()
    alone, loop = in_process("alone", mixed, CELLS), in_process("loop", mixed, ONE_BY_ONE)
    default = in_process("alone", mixed, WITH_TABLES, "default")
    stages = in_process("stages", 25)
    # In turn, and a quarter of the cells first: what the others take beside it has no start in it.
    runs = [
        {name: in_process("engine", kind, cells, workers) for name, kind, workers, _ in ENGINES}
        for cells in (few, many)
    ]
    resuming = in_process("resuming", folder / "mixed")

    def more(name: str, field: str) -> float:
        return runs[1][name][field] - runs[0][name][field]

    beyond = stages["whole cell"] - stages["reading and checks"] - stages["reduction"]
    cell_s, tiny_s = alone["cell_s"], more("pool", "cpu_s") / more("pool", "cells")
    share = more("pool", "driver_s") / more("pool", "cpu_s")
    memory = [each["serial"]["worker_mib"] for each in runs]
    size = statistics.mean(each.stat().st_size for each in (folder / "mixed").glob("*.parquet"))
    row_bytes = runs[1]["pool"]["bytes"] / tiny
    skipped_ms = 1e3 * resuming["own_s"] / FINISHED
    facts = provenance("python -m benchmarks.fleet", 0) | {
        "load": f"{load[0]:.0f} runnable processes on {os.cpu_count()} cores before, "
        f"{os.getloadavg()[0]:.0f} after: wall times say how busy the machine was",
    }
    serial_s = more("serial", "wall_s")
    hours, default_hours = (NIGHT_CELLS * each["cell_s"] / 3600 for each in (alone, default))
    claims = [
        ("CPU a cell, one circuit with constants", f"{1e3 * cell_s:.0f} ms", ""),
        ("CPU a cell, a fleet's default settings", f"{1e3 * default['cell_s']:.0f} ms", ""),
        ("CPU a cell beyond reading and reduction", f"{beyond:.0f} ms", "140 ms"),
        (
            "CPU of `identify` with its defaults, thirty seeds, over a worker's with one circuit",
            f"{loop['cell_s'] / alone['cell_s']:.1f}",
            "6",
        ),
        ("new programs for new lengths of known sizes", f"{alone['later_programs']}", "0"),
        ("large programs of one circuit, 3,000 to 30,000 samples", f"{alone['large']}", "20"),
        ("first cell of a worker, from a warm cache", f"{alone['first_s']:.2f} CPU s", "1 s"),
        *(
            (
                f"{words} over one process, cells a second",
                f"{serial_s / more(name, 'wall_s'):.2f}",
                aim,
            )
            for name, words, aim in (("pool", "two processes", "1.6"), ("dask", "Dask", "1.4"))
        ),
        (
            "CPU of two processes over one, the same cells",
            f"{more('pool', 'cpu_s') / more('serial', 'cpu_s'):.2f}",
            "",
        ),
        (
            "CPU on Dask over that of the pool",
            f"{more('dask', 'cpu_s') / more('pool', 'cpu_s'):.2f}",
            "1.2",
        ),
        (
            f"memory of a worker, {tiny:,} cells over {tiny // 4:,}",
            f"{memory[1] / memory[0]:.2f} ({memory[1]:.0f} MiB)",
            "1.1",
        ),
        (
            f"10,000 tiny cells on two cores, from {tiny:,}",
            f"{1e4 * tiny_s / 2 / 60:.1f} min of {1e3 * tiny_s:.0f} CPU ms each",
            "8 min",
        ),
        (f"resuming {FINISHED:,} finished cells", f"{resuming['own_s']:.2f} CPU s", "1 s"),
        ("driver's share of all CPU, tiny cells", f"{100 * share:.1f} %", "1 %"),
    ]
    lines = [
        "# What a fleet costs",
        "",
        as_markdown(facts),
        "",
        f"{CELLS} simulated cells of {LENGTHS[0]:,} to {LENGTHS[1]:,} samples, and {tiny} of 300. "
        "Unless a line says otherwise, one circuit with constants, certified optimum and "
        f"intervals: the settings `{ONE_CIRCUIT}`. A fleet's defaults, `{DEFAULT}`, compare "
        "three circuits and tables over SOC on held-out blocks. Throughput and CPU of the engines "
        f"are of those tiny cells that {tiny // 4} of them leave, so that no start counts.",
        "",
        "| | measured | aim |",
        "|---|---|---|",
        *(f"| {what} | {found} | {aim} |" for what, found, aim in claims),
        "",
        "## Engines",
        "",
        "| engine | cells a second, wall | CPU ms a tiny cell | driver's CPU ms | start, CPU s |",
        "|---|---|---|---|---|",
        *(
            f"| {words} | {more(name, 'cells') / more(name, 'wall_s'):.2f} | "
            f"{1e3 * more(name, 'cpu_s') / more(name, 'cells'):.0f} | "
            f"{1e3 * more(name, 'driver_s') / more(name, 'cells'):.1f} | "
            f"{(4 * runs[0][name]['cpu_s'] - runs[1][name]['cpu_s']) / 3:.1f} |"
            for name, _, _, words in ENGINES
        ),
        "",
        f"## Stages of a cell of {stages.pop('samples'):,} samples",
        "",
        "The least of twenty-three.",
        "",
        "| stage | CPU ms |",
        "|---|---|",
        *(f"| {name} | {each:.0f} |" for name, each in stages.items() if name != "cpu_s"),
        "",
        "## Ten million cells a night",
        "",
        "Worked out from the figures above, of these lengths and one circuit with constants, in "
        "eight hours.",
        "",
        "| | |",
        "|---|---|",
        f"| core-hours | {hours:,.0f}, so {hours * 3600 / NIGHT_S:,.0f} cores; with the defaults "
        f"{default_hours:,.0f}, so {default_hours * 3600 / NIGHT_S:,.0f} cores |",
        f"| read | {NIGHT_CELLS * size / 1e12:.1f} TB, {NIGHT_CELLS * size / NIGHT_S / 1e6:,.0f} "
        "MB/s |",
        f"| tasks | {NIGHT_CELLS:,}, {NIGHT_CELLS / NIGHT_S:.0f} a second |",
        f"| part files | {NIGHT_CELLS // 50:,} until they are put together |",
        f"| dataset | {NIGHT_CELLS * row_bytes / 1e9:.0f} GB |",
        f"| one driver asking what is done | {NIGHT_CELLS * skipped_ms / 6e4:.1f} min |",
        f"| its list of cells | {NIGHT_CELLS * resuming['cell_bytes'] / 1e9:.0f} GB |",
        f"| all rows at once, when parts are put together | "
        f"{NIGHT_CELLS * alone['row_bytes'] / 1e9:.0f} GB, twice while they are joined |",
        "",
        "The driver's memory breaks first: at the start for its list of cells, at the end for the "
        "rows. `--shard` divides both: of a hundred shards each has a hundred thousand cells, a "
        "driver and a file of its own, and their files are a dataset as they are.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure everything, print the page and write it; or one measurement, as JSON."""
    if sys.argv[1:2] == ["--measure"]:
        print(json.dumps(MEASURES[sys.argv[2]](*sys.argv[3:])))
        return
    from benchmarks.pages import publish

    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet", description=__doc__)
    parser.add_argument("tiny", metavar="TINY CELLS", nargs="?", type=int, default=TINY)
    tiny = parser.parse_args().tiny
    with tempfile.TemporaryDirectory() as folder:
        text = page(Path(folder), tiny)
    publish(RESULTS, text)


if __name__ == "__main__":
    main()
