"""What is timed: the bundled cell's identification record, one second a sample."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import barnax
from barnax.bundled import BUNDLED
from barnax.model.coordinates import Coordinates
from barnax.model.intervals import Intervals
from barnax.model.problem import Kind
from barnax.model.simulate import SimulationInput


@cache
def bundled_cell() -> barnax.CellModel:
    """The bundled cell."""
    tests = [barnax.read_record(path) for path in BUNDLED.ocv]
    return barnax.characterize(tests, ocv_fit="polynomial")


@cache
def bundled_record() -> barnax.Record:
    """The bundled record that `barnax identify` takes, 19,680 samples."""
    return barnax.read_record(barnax.bundled_file("identification"))


def bundled_problem(kind: Kind = "scan") -> barnax.Problem:
    """A fresh problem, as `barnax identify` sees it. Nothing is reduced or compiled yet."""
    return barnax.make_problem(bundled_record(), bundled_cell(), objective=kind)


def points_of(problem: barnax.Problem, count: int) -> Float[Array, "points free"]:
    """Random points in a problem's box, always the same."""
    return points_in(problem.coordinates, count)


def points_in(box: Coordinates, count: int) -> Float[Array, "points free"]:
    """Random points in a box, always the same."""
    fractions = jax.random.uniform(jax.random.key(count), (count, len(box.lower)), box.lower.dtype)
    return box.lower + fractions * (box.upper - box.lower)


def drive_of(problem: barnax.Problem, samples: int) -> SimulationInput:
    """The problem's record repeated or cut to a length."""
    inputs = problem.all_inputs[0]

    def span(values: Float[Array, "samples"]) -> Float[Array, "samples"]:
        return jnp.asarray(np.resize(np.asarray(values), samples))

    return SimulationInput(
        current_a=span(inputs.current_a),
        held_a=span(inputs.held_a),
        source_v=span(inputs.source_v),
        base_error_v=span(inputs.base_error_v),
        weight=None,
        scored=jnp.asarray(float(samples)),
        intervals=Intervals.measure(
            np.arange(samples, dtype=float), problem.coordinates.shortest_tau_s
        ),
    )
