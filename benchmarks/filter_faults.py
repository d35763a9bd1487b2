"""The state of charge by filters while measurements fail: `python -m benchmarks.filter_faults`.

The bundled cell is identified, and its record replayed with a fault in its middle. Writes
benchmarks/results/filter_faults.md. Needs a C compiler.
"""

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import jax
import numpy as np

import barnax
from barnax.execution import in_float64
from barnax.export import get_exporter
from barnax.filters import Drive, FilterModel, kalman, run_filter
from barnax.model.prepared import PreparedRecord, prepare_record
from barnax.result_filter import model_of
from benchmarks.pages import provenance, publish

RESULTS = Path(__file__).parent / "results" / "filter_faults.md"
KINDS = ("ekf", "ukf", "sum")
PRECISIONS = ("double", "float")
SOC_SD, WRONG_SOC, STUCK_S = 0.15, 0.4, 30.0
# From a wrong start errors count from here on, from a fault at once.
SETTLED_S = 600.0
PROGRAM = """\
#include <stdio.h>
#include <stdlib.h>
#include "barnax_filter.h"
int main(int count, char **given)
{
    static barnax_filter f;
    double in[4], soc;
    barnax_filter_start(&f, (barnax_real)atof(given[1]), (barnax_real)atof(given[2]),
                        atoi(given[3]));
    while (count == 4 && fread(in, sizeof(double), 4, stdin) == 4) {
        barnax_filter_step(&f, (barnax_real)in[0], (barnax_real)in[1], (barnax_real)in[2],
                           (barnax_real)in[3]);
        soc = f.soc;
        fwrite(&soc, sizeof(double), 1, stdout);
    }
    return 0;
}
"""


def faults(prepared: PreparedRecord) -> Iterator[tuple[str, Drive, float, int]]:
    """Each fault by name, with what is measured, the SOC at the start, and where errors count
    from."""
    drive, soc = Drive.of(prepared), float(prepared.soc[0])
    middle = len(prepared.soc) // 2
    stuck_s = prepared.time_s - prepared.time_s[middle]
    stuck = np.flatnonzero((stuck_s >= 0) & (stuck_s < STUCK_S))
    spike_a = 10 * prepared.capacity_ah

    def voltage(where: Any, value: Any) -> Drive:
        return drive._replace(voltage_v=drive.voltage_v.at[where].set(value))

    spike = drive._replace(
        current_a=drive.current_a.at[middle].set(spike_a),
        held_a=drive.held_a.at[middle + 1].set(spike_a),
    )
    settled = int(np.searchsorted(prepared.time_s - prepared.time_s[0], SETTLED_S))
    yield "none", drive, soc, middle
    yield "one voltage of 0 V", voltage(middle, 0.0), soc, middle
    yield "one voltage that is no number", voltage(middle, np.nan), soc, middle
    yield "ten voltages of 5 V", voltage(slice(middle, middle + 10), 5.0), soc, middle
    yield "one current of 10C", spike, soc, middle
    yield "voltage stuck for 30 s", voltage(stuck, drive.voltage_v[middle]), soc, middle
    wrong = soc + (WRONG_SOC if soc < 0.5 else -WRONG_SOC)
    yield "a start that is 40 % off", drive, wrong, settled


def in_python(model: FilterModel, direction: float, drive: Drive, soc: float, kind: Any) -> Any:
    """The SOC by a filter of barnax."""
    start = model.start(soc, SOC_SD, direction, float(direction == 0))
    found = jax.jit(lambda own, start, drive: run_filter(own, start, drive, kind))
    return found(model, start, drive).soc


def ungated(before: Any, after: Any, rejected_s: Any, *_: Any) -> tuple[Any, Any]:
    """Every measurement corrects, whatever it is."""
    del before
    return after, rejected_s


def in_c(program: Path, direction: float, drive: Drive, soc: float) -> np.ndarray:
    """The SOC by the exported filter."""
    rows = np.stack([drive.interval_s, drive.held_a, drive.current_a, drive.voltage_v], axis=1)
    command = [program, str(soc), str(SOC_SD), str(int(direction))]
    ran = subprocess.run(command, input=rows.tobytes(), capture_output=True, check=True)
    return np.frombuffer(ran.stdout)


def programs(result: barnax.Result, folder: Path) -> dict[str, Path]:
    """The exported filter in each precision."""
    (folder / "barnax_filter.h").write_bytes(get_exporter("c-filter").write(result).content)
    (folder / "main.c").write_text(PROGRAM)
    for precision in PRECISIONS:
        command = ["cc", "-std=c99", "-O2", f"-DBARNAX_REAL={precision}", folder / "main.c"]
        subprocess.run([*command, "-o", folder / precision, "-lm"], check=True)
    return {precision: folder / precision for precision in PRECISIONS}


@in_float64
def rows(result: barnax.Result) -> list[str]:
    """RMS errors of each fault: without the gate, with it, and in C."""
    lines = []
    record = barnax.read_record(barnax.bundled.BUNDLED.record)
    prepared = prepare_record(record, result.cell, result.model, result.inputs[0].window)
    model, direction = model_of(result, ("offset", "capacity")), float(prepared.start.direction)
    with tempfile.TemporaryDirectory() as name:
        compiled = programs(result, Path(name))
        for fault, drive, soc, first in faults(prepared):
            given = (model, direction, drive, soc)
            with mock.patch.object(kalman, "_gated", ungated):
                found = [in_python(*given, kind) for kind in KINDS]
            found += [in_python(*given, kind) for kind in KINDS]
            found += [in_c(program, *given[1:]) for program in compiled.values()]
            errors = [np.asarray(each)[first:] - prepared.soc[first:] for each in found]
            rms = [100 * np.sqrt(np.mean(error**2)) for error in errors]
            shown = (f"{each:.2f}" if np.isfinite(each) else "lost" for each in rms)
            lines.append(f"| {fault} | {' | '.join(shown)} |")
    return lines


def main() -> None:
    """Measure, print the page and write it."""
    result = barnax.identify(setup="li2023", seeds=0)
    origin = provenance("python -m benchmarks.filter_faults", 0)
    columns = [f"{kind}, no gate" for kind in KINDS] + [*KINDS] + [f"C, {p}" for p in PRECISIONS]
    lines = [
        "# Faults of the measurement",
        "",
        f"Printed by {origin['command']}, {origin['date']}, {origin['versions']}, "
        f"{origin['machine']}.",
        "",
        "RMS error of the SOC in %, on the record of the bundled cell that it was identified on, "
        "with a standard deviation of 15 % at the start: from the fault in the record's middle "
        "to its end, and from a wrong start after ten minutes. Without the gate every measurement "
        "corrects; lost is a filter whose SOC is no number. C is the Gaussian sum (`sum`).",
        "",
        f"| fault | {' | '.join(columns)} |",
        f"|---|{'---|' * len(columns)}",
        *rows(result),
    ]
    publish(RESULTS, "\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
