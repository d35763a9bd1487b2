"""Which methods find tables over SOC? `python -m benchmarks.table_tournament`.

On the bundled cell: all resistances, the OCV correction and the time constants at once, some
seventy values; and the time constants alone, with the best tables solved exactly at each. Against
the proved optimum. Writes benchmarks/results/table_tournament.md.
"""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.optimize import differential_evolution, least_squares

import barnax
from barnax.baselines import Budget
from barnax.model.exponentials import Lagrange
from barnax.model.prepared import prepare_record
from barnax.optimizers import evaluations_per_iteration
from barnax.over_soc.by_method import SEARCHES, capped, search_by
from barnax.over_soc.fit import reduced_objective
from barnax.over_soc.objective import Objective
from barnax.over_soc.search import find_best
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "table_tournament.md"
KEY, SEEDS = 0, 5
# A seed of all values at once, and of the time constants alone.
CANDIDATES, EVALUATIONS = 30, 15_000
ALONE = capped(Budget(seeds=SEEDS, key=KEY))
HIGHEST_OHM, HIGHEST_V = 0.25, 0.3

Errors = Callable[[jax.Array], jax.Array]


def bundled_objective() -> Objective:
    """J of so-rc with tables over SOC on the bundled record, OCV interpolated."""
    tests = [
        barnax.read_record(barnax.bundled_file(f"ocv_{way}")) for way in ("discharge", "charge")
    ]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    record = barnax.read_record(barnax.bundled_file("identification"))
    prepared = prepare_record(record, cell, "so-rc")
    settings = barnax.TableSettings(folds=0)
    return reduced_objective([prepared], settings)


def loss_of_all(objective: Objective) -> tuple[Errors, np.ndarray, np.ndarray]:
    """What J is the squares of, over [time constants, every node of every table], and the box."""
    reduced, layout, pairs = objective.reduced, objective.reduced.layout, objective.pairs
    parts, lagrange = jnp.asarray(reduced.part("pairs")), Lagrange.of(layout.in_tau)
    from_skeleton = jnp.asarray(layout.in_tau.from_skeleton)
    own = [jnp.asarray(objective.fixed_columns[table]) for table in (0, 1 + pairs)]
    base, penalty = jnp.asarray(objective.base), jnp.asarray(objective.penalty)

    def loss(x):
        values = x[pairs:].reshape(objective.tables, -1)
        error = base + own[0] @ values[0] + own[1] @ values[1 + pairs]
        for pair in range(pairs):
            counts = from_skeleton @ lagrange.at(jnp.exp(x[pair]), jnp.ones_like(x[pair]))
            error = error + counts @ (parts @ values[1 + pair])
        return jnp.append(error, penalty @ x[pairs:])

    nodes = objective.nodes
    low = [axis.low for axis in objective.axes] + [0.0] * ((1 + pairs) * nodes)
    high = [axis.high for axis in objective.axes] + [HIGHEST_OHM] * ((1 + pairs) * nodes)
    return loss, np.array(low + [-HIGHEST_V] * nodes), np.array(high + [HIGHEST_V] * nodes)


def at_once(name: str, objective: Objective) -> np.ndarray | None:
    """What each seed of a method that searches all values ends with, in V."""
    loss, low, high = loss_of_all(objective)
    if name in barnax.OPTIMIZERS:
        return population(name, lambda x: jnp.linalg.norm(loss(x)), low, high)
    searches = {"lm": descend, "de": evolve}
    return searches[name](loss, low, high) if name in searches else None


def population(name: str, loss: Errors, low, high) -> np.ndarray:
    """A population optimizer's seeds."""
    cost = evaluations_per_iteration(barnax.make_optimizer(name, CANDIDATES, 1))
    optimizer = barnax.make_optimizer(name, CANDIDATES, (EVALUATIONS - CANDIDATES) // cost)

    @jax.jit
    def one(key):
        options = {"key": key, "lower": jnp.asarray(low), "upper": jnp.asarray(high)}
        found = optx.minimise(
            lambda x, _: loss(x), optimizer, jnp.asarray(low), options=options,
            max_steps=None, throw=False,
        )  # fmt: skip
        return found.stats["best_loss"]

    return np.array([float(one(key)) for key in jax.random.split(jax.random.key(KEY), SEEDS)])


def descend(errors: Errors, low, high) -> np.ndarray:
    """Levenberg-Marquardt within the box (SciPy's trust region) from a random start a seed."""
    slopes, errors = jax.jit(jax.jacfwd(errors)), jax.jit(errors)
    starts = np.random.default_rng(KEY).uniform(low, high, (SEEDS, len(low)))
    ends = [
        least_squares(
            lambda x: np.asarray(errors(x)),
            start,
            lambda x: np.asarray(slopes(x)),
            (low, high),
            x_scale="jac",
            max_nfev=EVALUATIONS // len(low),
        ).cost
        for start in starts
    ]
    return np.sqrt(2 * np.array(ends))


def evolve(errors: Errors, low, high) -> np.ndarray:
    """SciPy's differential evolution."""
    losses = jax.jit(jax.vmap(lambda x: jnp.linalg.norm(errors(x))))
    ends = [
        differential_evolution(
            lambda points: np.asarray(losses(points.T)),
            list(zip(low, high, strict=True)),
            maxiter=EVALUATIONS // CANDIDATES - 1,
            init=np.random.default_rng([KEY, seed]).uniform(low, high, (CANDIDATES, len(low))),
            rng=np.random.default_rng([KEY, seed, 1]),
            tol=0,
            polish=False,
            updating="deferred",
            vectorized=True,
        ).fun
        for seed in range(SEEDS)
    ]
    return np.array(ends)


def rows(objective: Objective, best_v: float) -> list[str]:
    """A line for each method: how far above the optimum its seeds end."""
    lines = []
    for name in SEARCHES:
        alone = [end.root for end, _ in search_by(objective, name, ALONE)]
        lines.append(_line(name, [at_once(name, objective), np.array(alone)], best_v))
    return lines


def _line(name: str, found: list[np.ndarray | None], best_v: float) -> str:
    cells = []
    for ends in found:
        if ends is None:
            cells += ["-"] * 3
            continue
        gaps = 100 * (ends / best_v - 1)
        # Less is rounding.
        gaps = np.where(gaps < 1e-6, 0.0, gaps)
        cells += [f"{value:.3g}" for value in (gaps.min(), np.median(gaps), gaps.max())]
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Measure, print the page and write it."""
    jax.config.update("jax_enable_x64", True)
    objective = bundled_objective()
    best_v = find_best(objective).root
    values = 2 + objective.tables * objective.nodes
    lines = [
        "# Which methods find tables over SOC?",
        "",
        as_markdown(provenance("python -m benchmarks.table_tournament", KEY)),
        "",
        f"Bundled cell, so-rc with tables over SOC: {values} values. Excess of sqrt(J) over the "
        f"optimum of {1e3 * best_v:.4f} mV in percent, {SEEDS} seeds each. All values at once: "
        f"{EVALUATIONS} evaluations of {CANDIDATES} candidates; for lm as many simulations, a "
        "Jacobian counting as one for each value. The time constants alone, with the best tables "
        f"solved exactly at each: {ALONE.evaluations} evaluations of {ALONE.population} "
        "candidates; for lm 10 descents.",
        "",
        "| method | at once: best [%] | median [%] | worst [%] "
        "| time constants alone: best [%] | median [%] | worst [%] |",
        "|---|---|---|---|---|---|---|",
        *rows(objective, best_v),
        "",
    ]
    page = "\n".join(lines)
    save_page(RESULTS, page)
    print(page)


if __name__ == "__main__":
    main()
