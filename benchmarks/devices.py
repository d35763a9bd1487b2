"""A population's errors and a whole identification on every kind of device that JAX has here:
`python -m benchmarks.devices`. Where that is only the CPU, it says so and writes nothing."""

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

import barnax
from barnax.execution import in_float64
from barnax.model.problem import Kind, Objective, rmse
from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.speed.case import bundled_problem, points_of

RESULTS = Path(__file__).parent / "results" / "devices.md"
POPULATIONS: dict[Kind, tuple[int, ...]] = {
    "scan": (30, 900, 10_000, 100_000),
    "compressed": (30, 900, 100_000, 1_000_000),
}
TURNS = 5
# Candidates of the largest population that are compared, and how many the CPU computes at most.
COMPARED, MAX_ON_CPU = 900, 10_000


@eqx.filter_jit
def _errors(points: Float[Array, "points free"], objective: Objective) -> Float[Array, "points"]:
    return jax.vmap(rmse, in_axes=(0, None))(points, objective)


@in_float64
def generation(kind: Kind, count: int, device: Any) -> tuple[float, np.ndarray]:
    """Seconds of a population's errors on a device, as the median of turns, and some of them."""
    problem = bundled_problem(kind)
    points, objective = jax.device_put((points_of(problem, count), problem.objective), device)
    found = jax.block_until_ready(_errors(points, objective))
    taken_s = []
    for _ in range(TURNS):
        began_s = time.perf_counter()
        jax.block_until_ready(_errors(points, objective))
        taken_s.append(time.perf_counter() - began_s)
    return statistics.median(taken_s), np.asarray(found[:COMPARED])


def generations(kind: Kind, count: int) -> str:
    """A population's row: both times and the largest difference between the devices."""
    on_cpu = min(count, MAX_ON_CPU) if kind == "scan" else count
    cpu_s, expected = generation(kind, on_cpu, jax.devices("cpu")[0])
    cpu_s *= count / on_cpu
    device_s, found = generation(kind, count, jax.devices()[0])
    if on_cpu != count:
        _, found = generation(kind, on_cpu, jax.devices()[0])
    difference = np.nanmax(np.abs(found / expected - 1))
    note = "" if on_cpu == count else f" (from {on_cpu:,})"
    return (
        f"| {kind} | {count:,} | {1e3 * cpu_s:.3g} ms{note} | {1e3 * device_s:.3g} ms | "
        f"{cpu_s / device_s:.2g} | {difference:.1g} |"
    )


def identified(platforms: str) -> tuple[float, float]:
    """Seconds of `barnax identify` of the bundled cell in a process of its own, after one that has
    compiled, and the RMSE in V that it finds."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"JAX_PLATFORMS": platforms}
        for turn in ("first", "second"):
            command = [sys.executable, "-m", "barnax", "identify", "--out", f"{folder}/{turn}"]
            began_s = time.perf_counter()
            subprocess.run(command, env=environment, check=True, capture_output=True)
            taken_s = time.perf_counter() - began_s
        result = barnax.Result.load(f"{folder}/second")
        return taken_s, result.metrics.identification.rmse_v


def identification() -> str:
    """The row of a whole identification."""
    cpu_s, cpu_v = identified("cpu")
    device_s, device_v = identified("cuda")
    return (
        f"| `barnax identify` | {cpu_s:.1f} s | {device_s:.1f} s | {cpu_s / device_s:.2g} | "
        f"{1e3 * cpu_v:.6f} mV | {1e3 * device_v:.6f} mV |"
    )


def main() -> None:
    """Measure, and put the numbers on the page."""
    # The processes that are timed share the GPU's memory with this one.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    device = jax.devices()[0]
    if device.platform == "cpu":
        print("JAX has no device here but the CPU; install jax[cuda13] for an NVIDIA GPU")
        return
    facts = provenance("python -m benchmarks.devices", 0)
    facts["machine"] = (
        f"{device.device_kind}; {os.cpu_count()} CPU cores, {platform.machine()}, float64"
    )
    rows = [generations(kind, count) for kind, counts in POPULATIONS.items() for count in counts]
    lines = [
        "# On a GPU",
        "",
        as_markdown(facts),
        "",
        f"The errors of a whole population on the bundled record, 19,680 samples, two RC pairs; "
        f"median of {TURNS} turns. The difference is the largest of any candidate's RMSE, "
        "relative to the CPU's.",
        "",
        "| objective | candidates | CPU | GPU | times faster | difference |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
        "The main job on the bundled cell, each in a process of its own after one that compiles.",
        "",
        "| command | CPU | GPU | times faster | RMSE on the CPU | on the GPU |",
        "|---|---|---|---|---|---|",
        identification(),
        "",
    ]
    publish(RESULTS, "\n".join(lines))


if __name__ == "__main__":
    main()
