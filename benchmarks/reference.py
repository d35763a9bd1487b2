"""The numbers of the reference runs at full precision, what has moved between two sets of them, and
the answers of all records at hand.

    python -m benchmarks.reference [--only RUN] [--data FOLDER] [--out FILE]
    python -m benchmarks.reference compare A B [--tolerance SHARE]
    python -m benchmarks.reference answers [--only CELL] [--data FOLDER] [--out FILE]

What needs measured cells that are not there is named and skipped. `compare` ends with 1 where a
number has moved by more than the tolerance, or is in one of the sets alone.
"""

import argparse
import json
import math
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from pydantic import BaseModel
from tests.helpers.packs import PackedCell, alike, drive_a, frame, simulated

import barnax
from barnax import InputError, Result, Window, identify
from barnax.fleet.dataset import dataset_path
from benchmarks.pages import PACKAGES, save_page

REPOSITORY = Path(__file__).parents[1]
SHARED = Path(os.environ.get("BARNAX_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
BUNDLED = REPOSITORY / "data" / "virtual_cell"
CALCE, LG = "calce-inr18650-20r", "lg-hg2-18650"
A123, LEAF = "plett-a123-26650", "nissan-leaf-lmo-33ah"
TOLERANCE = 1e-9
# Few and short searches, for the global optimum decides; and none at all.
QUICK, ALONE = {"seeds": 2, "iterations": 20}, {"seeds": 0}
PROFILE = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
FULL = Window(initial_soc=1.0)
CHARGE = Window(initial_soc=0.0, initial_direction=-1, score_steps=(11,), score_soc=(0.03, 0.95))
# Columns of a fleet's rows that are of the machine, or of where the files are.
UNSTEADY = ("seconds", "time", "version", "record", "fingerprint", "memory", "inputs",
            "warnings")  # fmt: skip

Numbers = dict[str, Any]


def files(folder: Path, names: str) -> list[Path]:
    return [folder / f"{name}.parquet" for name in names.split()]


def pack_of(**options: Any) -> Numbers:
    """The mean cell of a pack of known cells, and every cell's values with intervals."""
    cells, current_a = alike(8), drive_a(2000)
    table = frame(simulated(cells, current_a), current_a)
    window = Window(initial_soc=float(np.mean([cell.soc for cell in cells])))
    pack = barnax.identify_pack(table, capacity=PackedCell().capacity_ah, window=window, **options)
    return {**numbers_of(pack.result), "cells": pack.rows(), "weakest": pack.weakest}


def fleet_of(**options: Any) -> Numbers:
    """The rows of a fleet of parts of the bundled record."""
    table = pl.read_parquet(BUNDLED / "identification.parquet")
    ocv = ";".join(map(str, files(BUNDLED, "ocv_charge ocv_discharge")))
    with tempfile.TemporaryDirectory() as folder:
        cells = []
        for samples in (4000, 5000, 6000):
            path = Path(folder, f"{samples}.parquet")
            table[:samples].write_parquet(path)
            cells.append({"id": str(samples), "records": str(path), "ocv": ocv})
        barnax.identify_fleet(cells, Path(folder, "fleet"), settings=options, workers=1)
        rows = pl.read_parquet(dataset_path(Path(folder, "fleet"))).sort("id")
    steady = [name for name in rows.columns if not name.startswith(UNSTEADY)]
    return {"rows": plain(rows.select(steady).to_dicts())}


def result_of(run: Callable[..., Result] = identify, **options: Any) -> Numbers:
    return numbers_of(run(**options))


def run_of(run: Callable[..., Numbers], options: Numbers) -> Numbers:
    return {"options": plain(options), **run(**options)}


def cells(data: Path) -> dict[str, tuple[list[Path], list[Path], dict[str, Window]]]:
    """Records, OCV tests and the records' windows by cell and temperature."""
    calce, lg, test = data / CALCE, data / LG, "ocv-incremental_25degC_SP20-3"
    sets = {
        "simulated": (BUNDLED, "identification validation", "ocv_charge ocv_discharge", ()),
        "simulated LFP": (BUNDLED, "lfp_identification lfp_validation",
                          "lfp_ocv_charge lfp_ocv_discharge", ()),
        "A123": (data / A123, "dyn-s1_25degC dyn-s3_25degC", "ocv-s1_25degC ocv-s3_25degC",
                 (FULL, CHARGE)),
        "Leaf": (data / LEAF, "hppc_25degC discharge-1c discharge-3c", "", ()),
    }  # fmt: skip
    half = " dst_25degC_50soc us06_25degC_50soc"
    for degc, more in (("25degC", half), ("0degC", ""), ("45degC", "")):
        names = f"dst_{degc}_80soc us06_{degc}_80soc{more}".replace("soc", "soc_SP20-2")
        sets[f"CALCE {degc}"] = calce, names, test, (PROFILE,) * 4
    for degc, more in (("25degC", " la92_25degC"), ("0degC", " la92_0degC"), ("minus10degC", "")):
        sets[f"LG {degc}"] = lg, f"us06_{degc} mixed1_{degc}{more}", f"c20_{degc}", (FULL,) * 3
    return {
        cell: (paths := files(folder, names), files(folder, tests),
               {path.name: window for path, window in zip(paths, windows, strict=False)})
        for cell, (folder, names, tests, windows) in sets.items()
    }  # fmt: skip


def runs(data: Path) -> dict[str, tuple[Callable[..., Numbers], Numbers]]:
    """What makes the numbers of each run, and its options."""
    sets = cells(data)

    def of(name: str, count: int, **options: Any) -> Numbers:
        """The first records of a cell, validated on the others."""
        paths, ocv, windows = sets[name]
        given = {"records": paths[:count], "validate": paths[count:], "ocv": ocv}
        return {**given, "window": windows, **options}

    tables = {**ALONE, "model": "so-rc", "over": "soc"}
    return {
        "bundled": (result_of, QUICK),
        "CALCE folder": (result_of, {"records": [data / CALCE], **ALONE}),
        "CALCE single": (result_of, of("CALCE 25degC", 1, **QUICK)),
        "A123": (result_of, of("A123", 1, **ALONE)),
        **{name: (result_of, of(name, 2, **tables)) for name in sets if name.startswith("LG")},
        "Leaf HPPC": (partial(result_of, barnax.hppc), {"records": sets["Leaf"][0][:1], **ALONE}),
        "pack": (pack_of, {}),
        "fleet": (fleet_of, {"trust": "basic"}),
        "own OCV": (result_of, {"records": sets["simulated"][0][:1], **ALONE}),
        "constant circuit": (result_of, {**QUICK, "model": "iso-rc"}),
        "setup li2023": (result_of, {**QUICK, "setup": "li2023"}),
    }


def plain(value: Any) -> Any:
    """Numbers, texts, lists and mappings of anything that a result holds."""
    if isinstance(value, BaseModel):
        value = {name: getattr(value, name) for name in type(value).model_fields}
    elif is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(each) for each in value]
    if isinstance(value, Path):
        return value.name
    return value if value is None or isinstance(value, bool | int | float) else str(value)


def numbers_of(result: Result) -> Numbers:
    """The numbers of a result, its choices and its warnings' codes, all from its public face."""
    constant, of_input = (
        result.constant,
        ("name", "sha256", "start", "capacity_ah", "hold", "window"),
    )
    of_constant = "model", "parameters", "global_optimum"
    of_fit = ("tables", "errors", "objective_v", "lower_bound_v", "proved_gap", "status",
              "intervals", "cross_validation")  # fmt: skip
    return plain(
        {
            "answer": result.answer,
            "errors": result.metrics,
            "candidates": {each.name: each for each in result.candidates},
            "fits": [{name: getattr(fit, name) for name in of_fit} for fit in result.fits],
            "constant": {name: getattr(constant, name) for name in of_constant},
            "intervals": constant.assessment and constant.assessment.uncertainty.estimates,
            "inputs": [{name: getattr(part, name) for name in of_input} for part in result.inputs],
            "warnings": sorted(warning.code for warning in result.warnings),
        }
    )


def answer_of(paths: list[Path], ocv: list[Path], windows: Mapping[str, Window], count: int):
    """What some of a cell's first records are identified as, and the errors on the others."""
    given = {"ocv": ocv} if ocv else {}
    used = {path.name: windows[path.name] for path in paths[:count] if path.name in windows}
    try:
        result = identify(paths[:count], window=used, **given, **ALONE)
        errors = {
            path.name: result.validate(path, windows.get(path.name)).metrics.rmse_v
            for path in paths[count:]
        }
    except InputError as problem:
        return {"refused": str(problem)}
    tables = result.fit.tables
    return {
        "circuit": result.answer,
        "nodes": len(tables.nodes),
        "law": tables.dependence and tables.dependence.numbers,
        "OCV": "fitted" if result.cell.ocv_is_fitted else "test",
        "fit": result.metrics.identification.rmse_v,
        "not used": errors,
    }


def compared(one: Numbers, other: Numbers, tolerance: float) -> list[tuple[float, str, Any, Any]]:
    """What has moved by more than a share, the furthest first; what is no number, or on one side
    alone, has moved by infinity."""

    def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
        if not isinstance(value, dict | list):
            yield at, value
            return
        for name, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(each, f"{at}/{name}")

    def moved(first: Any, second: Any) -> float:
        numbers = [each for each in (first, second) if isinstance(each, int | float)]
        if first == second or (len(numbers) == 2 and all(map(math.isnan, numbers))):
            return 0.0
        is_finite = len(numbers) == 2 and all(map(math.isfinite, numbers))
        return abs(first - second) / max(map(abs, numbers)) if is_finite else math.inf

    first, second = (dict(leaves(each["numbers"])) for each in (one, other))
    pairs = {at: (first.get(at), second.get(at)) for at in {**first, **second}}
    rows = [(moved(*pair), at, *pair) for at, pair in pairs.items()]
    return sorted((row for row in rows if row[0] > tolerance), key=lambda row: (-row[0], row[1]))


def collected(work: Mapping[str, tuple[list[Path], Callable[[], Numbers]]], out: Path | None):
    """What each of some works makes of files that are there, with what it was made of."""
    made_of = {"machine": f"{os.cpu_count()} cores, {platform.machine()}"}
    made_of |= {name: version(name) for name in PACKAGES}
    numbers, skipped = (
        {},
        [name for name, (paths, _) in work.items() if not all(map(Path.exists, paths))],
    )
    for name in [name for name in work if name not in skipped]:
        began = time.perf_counter()
        numbers[name] = work[name][1]()
        print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    print(f"skipped: {', '.join(skipped) or 'none'}", file=sys.stderr)
    document = {"made of": made_of, "skipped": skipped, "numbers": numbers}
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")) + "\n"
    save_page(out, text) if out else print(text)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reference", usage=__doc__)
    parser.add_argument("command", nargs="?", choices=["compare", "answers"])
    parser.add_argument("sets", nargs="*", type=Path)
    parser.add_argument("--only")
    parser.add_argument("--data", type=Path, default=SHARED)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--tolerance", type=float, default=TOLERANCE)
    options = parser.parse_args()
    if options.command == "compare":
        one, other = (json.loads(path.read_text(encoding="utf-8")) for path in options.sets)
        rows = compared(one, other, options.tolerance)
        for share, at, first, second in rows:
            print(f"{share:.3g} {at}: {first} -> {second}")
        sys.exit(bool(rows))
    if options.command == "answers":
        work = {
            f"{name}, {count} of {len(cell[0])}": (cell[0], partial(answer_of, *cell, count))
            for name, cell in cells(options.data).items()
            for count in (1, 2)
        }
    else:
        work = {
            name: (given.get("records", []), partial(run_of, run, given))
            for name, (run, given) in runs(options.data).items()
        }
    if options.only is not None:
        work = {name: each for name, each in work.items() if name == options.only}
    collected(work, options.out)


if __name__ == "__main__":
    main()
