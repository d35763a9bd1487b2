"""Records of many lengths through one compiled scan: one program, and the bits of each alone."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

import barnax.search.seeds
from barnax.execution import in_float64
from barnax.model.inputs import Window
from barnax.model.padding import padding_for
from barnax.model.problem import make_problem, rmse_by_scan
from barnax.optimizers import make_optimizer
from barnax.search.seeds import search_many, search_seeds
from reference import make_record

# One that compiles quickly; the default one searches in one of the cases.
OPTIMIZER = make_optimizer("pso", 8, 20)
KNOWN_SOC = Window(initial_soc=0.8, initial_direction=-1)


def problem_of(cell, circuit, clocks, **settings):
    """A problem on records of these clocks, all with their own current and voltage."""
    records = []
    for seed, time_s in enumerate(clocks):
        rng = np.random.default_rng(seed)
        current_a = np.repeat(rng.choice([0.0, 2.0, -1.0], len(time_s) // 10 + 1), 10)
        voltage_v = 3.7 - 0.05 * current_a[: len(time_s)] + rng.normal(0, 1e-3, len(time_s))
        records.append(make_record(time_s, current_a[: len(time_s)], voltage_v))
    return make_problem(records, cell, circuit, window=KNOWN_SOC, **settings)


def even(samples):
    return np.arange(samples) * 1.0


def uneven(samples, seed):
    steps = np.random.default_rng(seed).choice([0.5, 1.0, 7.0 + seed], samples)
    return np.cumsum(steps)


CASES = {
    "even": ("pso", "iso-rc", [[even(333)], [even(512)]]),
    "uneven": ("ibmo", "so-rc", [[uneven(303, 1)], [uneven(502, 2)]]),
    "turning": ("pso", "esc", [[uneven(221, 2)], [uneven(304, 1)]]),
    "joint": ("pso", "so-rc", [[even(300), even(200)], [even(250), even(450)]]),
}


@pytest.mark.parametrize("objective", ["scan", "compressed"])
@pytest.mark.parametrize("case", CASES)
def test_records_of_many_lengths_have_the_bits_each_has_alone(bundled_cell, case, objective):
    name, circuit, clocks = CASES[case]
    optimizer = make_optimizer(name, 8, 20)
    bounds = {"tau1 [s]": (1.0, 100.0), "tau2 [s]": (1.0, 100.0)}
    problems = [
        problem_of(bundled_cell, circuit, each, objective=objective, bounds=bounds)
        for each in clocks
    ]
    together = search_many(problems, optimizer, key=jr.key(0), seeds=2)
    # The first one is filled up; one case tells that the longest, which is not, keeps its bits too.
    compared = len(problems) if case == "uneven" else 1
    for problem, many in zip(problems[:compared], together, strict=False):
        alone = search_seeds(problem, optimizer, key=jr.key(0), seeds=2)
        for ours, expected in zip(many.seeds, alone.seeds, strict=True):
            assert ours.parameters == expected.parameters
            assert ours.rmse_v == expected.rmse_v
            assert ours.history_v.tobytes() == expected.history_v.tobytes()


def test_one_search_is_compiled_for_all_lengths(bundled_cell, monkeypatch):
    problems = [problem_of(bundled_cell, "so-rc", [even(n)]) for n in (211, 307, 401)]
    traces = []
    search = barnax.search.seeds._search

    def counted(optimizer, objective, keys):
        traces.append(objective)
        return search(optimizer, objective, keys)

    monkeypatch.setattr(barnax.search.seeds, "_search", counted)
    search_many(problems, OPTIMIZER, key=jr.key(0), seeds=2)
    assert len(traces) == 1


@in_float64
def test_what_fills_a_record_up_counts_nothing(bundled_cell):
    short, long = (problem_of(bundled_cell, "so-rc", [even(n)]) for n in (211, 401))
    fill = padding_for([short.scan, long.scan])
    middle = short.coordinates.decode((short.coordinates.lower + short.coordinates.upper) / 2)
    plain, filled = short.scan.errors(middle), fill(short.scan).errors(middle)
    assert filled.shape == (401,)
    np.testing.assert_array_equal(filled[:211], plain)
    assert not jnp.any(filled[211:])


@in_float64
def test_compressed_records_stay_as_they_are(bundled_cell):
    problem = problem_of(bundled_cell, "so-rc", [even(211)])
    assert padding_for([problem.compressed, problem.scan])(problem.compressed) is problem.compressed
    circuits = [search_seeds(problem, OPTIMIZER, key=jax.random.key(0), seeds=1).best.parameters]
    assert rmse_by_scan(problem, circuits, padding_for([problem.scan])) == rmse_by_scan(
        problem, circuits
    )
