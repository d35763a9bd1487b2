"""Command: `python -m benchmarks.optimizer_speed`."""

import argparse
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from barnax.optimizers import OPTIMIZERS, AbstractPopulationMinimiser, Box
from barnax.optimizers.draws import written_out
from benchmarks.environments import make_environment, run_worker
from benchmarks.li2023.table2.runs import run_optimizer
from benchmarks.pages import as_markdown, provenance, save_page, write_csv

from .sizes import DIMS, HALF_WIDTH, ITERATIONS, POPULATION, REPEATS, RUNS

HERE = Path(__file__).parent
RESULTS = HERE.parent / "results"
REQUIREMENTS = {"mealpy": "mealpy==3.0.3", "evosax": "evosax==0.3.2"}
KEY = 2023


def time_ours() -> dict[str, dict]:
    """Seconds of the first call, compilation included, and of the fastest later one."""
    found = {}
    with jax.enable_x64(True):
        for name, make in OPTIMIZERS.items():
            optimizer = make(population=POPULATION, iterations=ITERATIONS)
            seconds = []
            for _ in range(1 + REPEATS):
                begin = time.perf_counter()
                runs = run_optimizer(optimizer, "F1", jax.random.key(KEY), RUNS)
                seconds.append(time.perf_counter() - begin)
            found[name] = {
                "first_seconds": seconds[0],
                "seconds": min(seconds[1:]),
                "draw_seconds": time_draws(optimizer),
                "evaluations": RUNS * runs.evaluations,
                "final": runs.final,
            }
    return found


def time_draws(optimizer: AbstractPopulationMinimiser) -> float:
    """Seconds that the random numbers of all runs take alone, as many generations at once as do."""
    box = Box(jnp.full(DIMS, -HALF_WIDTH), jnp.full(DIMS, HALF_WIDTH))
    keys = jr.split(jr.key(KEY), RUNS)
    seconds = []
    for _ in range(1 + REPEATS):
        begin = time.perf_counter()
        jax.block_until_ready(_draws(optimizer, box, keys))
        seconds.append(time.perf_counter() - begin)
    return min(seconds[1:])


@eqx.filter_jit
def _draws(optimizer: AbstractPopulationMinimiser, box: Box, keys: jax.Array) -> jax.Array:
    at_once = optimizer._generations_at_once(box)

    def one(key):
        key = written_out(key)

        def some(total, first):
            generations = first + jnp.arange(at_once)
            drawn = jax.vmap(lambda g: optimizer.draw(jr.fold_in(key, g), g, box))(generations)
            return total + sum(jnp.sum(leaf * 1.0) for leaf in jax.tree.leaves(drawn)), None

        total, _ = jax.lax.scan(some, 0.0, jnp.arange(1, ITERATIONS + 1, at_once))
        return total

    return jax.vmap(one)(keys)


def rows_of(ours: dict[str, dict], theirs: dict[str, dict[str, dict]]) -> list[dict]:
    """Microseconds an evaluation, the ratios, and the medians found."""
    rows = []
    for name, run in ours.items():
        row = {
            "optimizer": name,
            "first_call_s": run["first_seconds"],
            "later_call_s": run["seconds"],
            "ours_us": 1e6 * run["seconds"] / run["evaluations"],
            "draws_us": 1e6 * run["draw_seconds"] / run["evaluations"],
            "ours_median": float(np.median(run["final"])),
        }
        for library in REQUIREMENTS:
            other = theirs[library].get(name)
            time_us = 1e6 * other["seconds"] / other["evaluations"] if other else ""
            row[f"{library}_us"] = time_us
            row[f"{library}_ratio"] = time_us / row["ours_us"] if other else ""
            row[f"{library}_median"] = float(np.median(other["final"])) if other else ""
        rows.append(row)
    return rows


def markdown_page(rows: list[dict], facts: dict[str, str]) -> str:
    """The table and what it compares."""
    lines = [
        "# Time per evaluation",
        "",
        f"The sphere function in 30 dimensions, population {POPULATION}, {ITERATIONS} iterations, "
        f"float64. Ours and evosax: {RUNS} runs in one compiled call, without compilation (the "
        "first call, which includes it, is beside it); mealpy: one run, since there runs follow "
        f"one another. The fastest of {REPEATS} each, for the machine is shared. A ratio above 1 "
        "says ours is faster. Draws: our random numbers alone, in a program of their own. "
        "Each library runs in an environment that this command makes.",
        "",
        as_markdown(facts),
        f"- against: {', '.join(REQUIREMENTS.values())}",
        "",
        "| optimizer | first call [s] | later [s] | ours [us] | draws [us] | mealpy [us] | ratio "
        "| evosax [us] | ratio | median loss: ours | mealpy | evosax |",
        "|---" * 12 + "|",
    ]
    columns = [
        ("first_call_s", ".2f"),
        ("later_call_s", ".2f"),
        ("ours_us", ".2f"),
        ("draws_us", ".2f"),
        ("mealpy_us", ".1f"),
        ("mealpy_ratio", ".0f"),
        ("evosax_us", ".2f"),
        ("evosax_ratio", ".2f"),
        ("ours_median", ".1e"),
        ("mealpy_median", ".1e"),
        ("evosax_median", ".1e"),
    ]
    for row in rows:
        cells = [format(row[name], spec) if row[name] != "" else "" for name, spec in columns]
        lines.append(f"| {row['optimizer']} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "None of the others follows the rule of our defaults, so the losses are not to agree: "
        "mealpy's PSO has constant inertia and redraws what leaves the box, its WOA and GWO let a "
        "candidate move only to a better place, its BMO takes a uniform p and keeps no parents, "
        "its SOA is the paper's where ours is the authors' code; "
        "evosax's PSO has constant inertia, one random number for all dimensions and no bounds. "
        "mealpy's IGWO is another algorithm of that name (Kaveh and Zakian, 2018). Which rules are "
        "the same, and that they then give the same losses, is in rule_check.md.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Time all, and write table and page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.optimizer_speed", description=__doc__
    )
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    theirs = {
        library: run_worker(make_environment(library, wanted), HERE / f"{library}_worker.py")
        for library, wanted in REQUIREMENTS.items()
    }
    rows = rows_of(time_ours(), theirs)
    page = markdown_page(rows, provenance("python -m benchmarks.optimizer_speed", KEY))
    write_csv(options.out / "optimizer_speed.csv", rows)
    save_page(options.out / "optimizer_speed.md", page)
    print(page)


if __name__ == "__main__":
    main()
