"""How fast a generation and a whole identification are: `python -m benchmarks.core_speed`.

Baselines run in the same process, in turn with ours: thirty lines of C that hold the candidates in
SIMD lanes, and SciPy's lfilter. Writes benchmarks/results/core_speed.md.
"""

import ctypes
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import date
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

import barnax
from barnax.problem import rmse

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "core_speed.md"
POPULATIONS = (30, 240, 900)
REPEATS = 15
CALLS = 10
LANES = 32


def bundled_problem() -> barnax.Problem:
    """The bundled cell's identification record, 19,680 samples, as `barnax identify` sees it."""
    tests = [
        barnax.read_record(barnax.bundled_file(f"ocv_{way}")) for way in ("discharge", "charge")
    ]
    record = barnax.read_record(barnax.bundled_file("identification"))
    return barnax.make_problem(record, barnax.characterize(tests))


def compile_kernel(folder: Path) -> Callable | None:
    """The C kernel as a function of (circuits, current, base), or None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    library = folder / "squared_errors.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
    subprocess.run(
        [compiler, *flags, str(HERE / "squared_errors.c"), "-o", str(library)], check=True
    )
    kernel = ctypes.CDLL(str(library)).squared_errors
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    kernel.argtypes = [pointer, ctypes.c_size_t, pointer, pointer, ctypes.c_size_t, pointer]
    kernel.restype = None

    def run(circuits: np.ndarray, current_a: np.ndarray, base_v: np.ndarray) -> np.ndarray:
        total = np.empty(circuits.shape[1])
        kernel(circuits, circuits.shape[1], current_a, base_v, len(current_a), total)
        return total

    return run


def milliseconds(runs: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median wall time of each run, taken in turn so that a drifting machine is fair to all.

    A turn is `CALLS` generations one after the other; "scan" runs them in one call.
    """
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(REPEATS):
        for name, run in runs.items():
            start = time.perf_counter()
            for _ in range(1 if name == "scan" else CALLS):
                run()
            taken[name].append(1e3 * (time.perf_counter() - start) / CALLS)
    return {name: statistics.median(times) for name, times in taken.items()}


def time_generations(problem: barnax.Problem, kernel: Callable | None) -> list[str]:
    """Table rows: one generation of each population size, ours and the baselines'."""
    objective = problem.objective
    box = objective.coordinates
    drive = objective.evaluator
    current_a, base_v = np.asarray(drive.current_a), np.asarray(drive.base_error_v)
    evaluate = jax.jit(jax.vmap(rmse, in_axes=(0, None)))
    # As in a search: one generation after the other inside one compiled call.
    generations = jax.jit(
        lambda populations: jax.lax.map(lambda each: evaluate(each, objective), populations)
    )
    rows = []
    for population in POPULATIONS:
        shape = (population, len(box.lower))
        fractions = jax.random.uniform(jax.random.key(population), shape, box.lower.dtype)
        points = box.lower + fractions * (box.upper - box.lower)
        circuits = jax.vmap(box.decode)(points)
        r0, (r1, r2), (tau1, tau2) = jax.tree.map(
            np.asarray, (circuits.r0, circuits.r, circuits.tau)
        )
        decay1, decay2 = np.exp(-1 / tau1), np.exp(-1 / tau2)
        table = np.stack([decay1, (1 - decay1) * r1, decay2, (1 - decay2) * r2, r0])
        padded = np.pad(table, ((0, 0), (0, -population % LANES)), mode="edge")

        def filtered(candidates=table):
            errors = []
            for d1, p1, d2, p2, ohmic in candidates.T:
                error = base_v + ohmic * current_a
                error += lfilter([0, p1], [1, -d1], current_a)
                error += lfilter([0, p2], [1, -d2], current_a)
                errors.append(error @ error)
            return np.array(errors)

        populations = jnp.stack([points] * CALLS)
        runs = {"scan": lambda given=populations: generations(given).block_until_ready()}
        if kernel is not None:
            runs["kernel"] = lambda padded=padded: kernel(padded, current_a, base_v)
            ours = np.asarray(evaluate(points, objective)) ** 2 * len(base_v)
            agreement = np.max(np.abs(runs["kernel"]()[:population] / ours - 1))
            if not agreement < 1e-9:
                raise SystemExit(f"the kernel and the scan disagree by {agreement:.1e}")
        if population <= 30:
            runs["lfilter"] = filtered
        taken = milliseconds(runs)
        cells = [f"{population}", f"{taken['scan']:.2f}"]
        cells += [f"{taken['kernel']:.2f}" if kernel else "-"]
        cells += [f"{taken['scan'] / taken['kernel']:.1f}" if kernel else "-"]
        cells += [f"{taken['lfilter']:.1f}" if "lfilter" in taken else "-"]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def time_command(cache: Path) -> list[str]:
    """Table rows: `barnax identify` in fresh processes, cold and warm compilation cache."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache / "jax")}
    rows = []
    for title in ("first start, cold cache", "second start", "third start"):
        command = [sys.executable, "-m", "barnax", "identify", "--quiet"]
        start = time.perf_counter()
        subprocess.run([*command, "--out", str(cache / title)], check=True, env=environment)
        rows.append(f"| {title} | {time.perf_counter() - start:.1f} |")
    return rows


def main() -> None:
    """Measure, print the page and write it."""
    with tempfile.TemporaryDirectory() as folder:
        kernel = compile_kernel(Path(folder))
        with jax.enable_x64(True):
            rows = time_generations(bundled_problem(), kernel)
        commands = time_command(Path(folder))
    page = "\n".join(
        [
            "# Speed of the core",
            "",
            "Printed by `python -m benchmarks.core_speed`.",
            f"{date.today()}, {os.cpu_count()} CPU cores ({platform.machine()}), "
            f"jax {version('jax')}, Python {platform.python_version()}. Medians of {REPEATS} turns "
            f"of {CALLS} generations, the runs of one row in turn.",
            "",
            "One generation: the RMSE of a population on the bundled record, 19,680 samples, "
            "float64. The kernel is `squared_errors.c`, candidates in SIMD lanes, one core; "
            "lfilter is SciPy's, one candidate after the other.",
            "",
            "| candidates | scan [ms] | C kernel [ms] | scan / kernel | lfilter [ms] |",
            "|---|---|---|---|---|",
            *rows,
            "",
            "The whole of `barnax identify` on the bundled cell (30 seeds, 30 candidates, 500 "
            "generations, cross-check, figures) in a fresh process:",
            "",
            "| process | wall [s] |",
            "|---|---|",
            *commands,
            "",
        ]
    )
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(page)
    print(page)


if __name__ == "__main__":
    main()
