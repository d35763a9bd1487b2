"""Can population optimizers find tables over SOC? `python -m benchmarks.table_tournament`.

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
from scipy.optimize import minimize

import barnax
from barnax.model.exponentials import Lagrange
from barnax.model.inputs import prepare_record
from barnax.optimizers import evaluations_per_iteration
from barnax.over_soc.fit import box_of, reduced_objective
from barnax.over_soc.objective import Objective
from barnax.over_soc.search import find_best
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "table_tournament.md"
KEY, SEEDS = 0, 5
# Population and evaluations of a seed: of all values at once, and of the time constants alone.
ALL, ALONE = (30, 15_000), (10, 300)
HIGHEST_OHM, HIGHEST_V = 0.25, 0.3

Loss = Callable[[jax.Array], jax.Array]


def bundled_objective() -> Objective:
    """J of so-rc with tables over SOC on the bundled record, OCV interpolated."""
    tests = [
        barnax.read_record(barnax.bundled_file(f"ocv_{way}")) for way in ("discharge", "charge")
    ]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    record = barnax.read_record(barnax.bundled_file("identification"))
    prepared = prepare_record(record, cell, "so-rc")
    settings = barnax.TableSettings(folds=0)
    return reduced_objective([prepared], settings, box_of([prepared], settings))[0]


def loss_of_all(objective: Objective) -> tuple[Loss, np.ndarray, np.ndarray]:
    """sqrt(J) over [time constants, every node of every table], and the box."""
    reduced, layout, pairs = objective.reduced, objective.reduced.layout, objective.pairs
    parts, lagrange = jnp.asarray(reduced.part(0)), Lagrange.of(layout.in_tau)
    from_skeleton = jnp.asarray(layout.in_tau.from_skeleton)
    own = [jnp.asarray(objective.fixed_columns[table]) for table in (0, 1 + pairs)]
    base, penalty = jnp.asarray(objective.base), jnp.asarray(objective.penalty)

    def loss(x):
        values = x[pairs:].reshape(objective.tables, -1)
        error = base + own[0] @ values[0] + own[1] @ values[1 + pairs]
        for pair in range(pairs):
            counts = from_skeleton @ lagrange.at(jnp.exp(x[pair]), jnp.ones_like(x[pair]))
            error = error + counts @ (parts @ values[1 + pair])
        bent = penalty @ x[pairs:]
        return jnp.sqrt(error @ error + bent @ bent)

    nodes = objective.nodes
    low = [axis.low for axis in objective.axes] + [0.0] * ((1 + pairs) * nodes)
    high = [axis.high for axis in objective.axes] + [HIGHEST_OHM] * ((1 + pairs) * nodes)
    return loss, np.array(low + [-HIGHEST_V] * nodes), np.array(high + [HIGHEST_V] * nodes)


def loss_alone(objective: Objective) -> tuple[Loss, np.ndarray, np.ndarray]:
    """sqrt(J) over the time constants, every table being the best one there, and the box."""

    def roots(places: np.ndarray) -> np.ndarray:
        flat = places.reshape(-1, places.shape[-1])
        found = [objective.solve(tuple(place.tolist())).root for place in flat]
        return np.array(found).reshape(places.shape[:-1])

    def loss(x):
        return jax.pure_callback(
            roots, jax.ShapeDtypeStruct((), x.dtype), x, vmap_method="expand_dims"
        )

    axes = objective.axes
    return loss, np.array([axis.low for axis in axes]), np.array([axis.high for axis in axes])


def search(name: str, loss: Loss, low, high, budget: tuple[int, int]) -> np.ndarray:
    """What each seed of an optimizer ends with, in V."""
    population, evaluations = budget
    cost = evaluations_per_iteration(barnax.make_optimizer(name, population, 1))
    optimizer = barnax.make_optimizer(name, population, (evaluations - population) // cost)

    @jax.jit
    def one(key):
        options = {"key": key, "lower": jnp.asarray(low), "upper": jnp.asarray(high)}
        found = optx.minimise(
            lambda x, _: loss(x), optimizer, jnp.asarray(low), options=options,
            max_steps=None, throw=False,
        )  # fmt: skip
        return found.stats["best_loss"]

    return np.array([float(one(key)) for key in jax.random.split(jax.random.key(KEY), SEEDS)])


def descend(loss: Loss, low, high) -> np.ndarray:
    """What L-BFGS-B ends with from random starts, in V."""
    slope = jax.jit(jax.value_and_grad(lambda x: loss(x) ** 2))
    starts = np.random.default_rng(KEY).uniform(low, high, (SEEDS, len(low)))
    ends = [
        minimize(
            lambda x: tuple(np.asarray(each, float) for each in slope(jnp.asarray(x))),
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)),
            options={"maxiter": 5000, "maxfun": 10_000},
        ).fun
        for start in starts
    ]
    return np.sqrt(np.array(ends))


def rows(objective: Objective, best_v: float) -> list[str]:
    """A line for each optimizer: how far above the optimum its seeds end."""
    at_once, alone = loss_of_all(objective), loss_alone(objective)
    lines = []
    for name in barnax.OPTIMIZERS:
        found = [search(name, *at_once, ALL), search(name, *alone, ALONE)]
        lines.append(_line(name, found, best_v))
    return [*lines, _line("L-BFGS-B, random starts", [descend(*at_once)], best_v)]


def _line(name: str, found: list[np.ndarray], best_v: float) -> str:
    cells = []
    for ends in found:
        gaps = 100 * (ends / best_v - 1)
        cells += [f"{value:.3g}" for value in (gaps.min(), np.median(gaps), gaps.max())]
    cells += ["-"] * (6 - len(cells))
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Measure, print the page and write it."""
    # Callbacks run in threads of their own, where a scope would not reach.
    jax.config.update("jax_enable_x64", True)
    objective = bundled_objective()
    best_v = find_best(objective).root
    values = 2 + objective.tables * objective.nodes
    lines = [
        "# Can population optimizers find tables over SOC?",
        "",
        as_markdown(provenance("python -m benchmarks.table_tournament", KEY)),
        "",
        f"Bundled cell, so-rc with tables over SOC: {values} values. Excess of sqrt(J) over the "
        f"optimum of {1e3 * best_v:.4f} mV in percent, {SEEDS} seeds each. All values at once: "
        f"{ALL[1]} evaluations of {ALL[0]} candidates. The time constants alone, with the best "
        f"tables solved exactly at each: {ALONE[1]} evaluations of {ALONE[0]} candidates.",
        "",
        "| optimizer | at once: best [%] | median [%] | worst [%] "
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
