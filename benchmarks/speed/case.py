"""What is timed: the bundled cell's identification record, one second a sample."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
from jaxtyping import Array, Float

import barnax
from barnax.bundled import BUNDLED
from barnax.model.coordinates import Coordinates
from barnax.model.prepared import PreparedRecord
from barnax.model.search_space import Kind


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


def drive_of(problem: barnax.Problem, samples: int) -> PreparedRecord:
    """The problem's record repeated or cut to a length, one sample a second."""
    prepared = problem.prepared
    given = prepared.record

    def span(values: np.ndarray) -> np.ndarray:
        return np.resize(values, samples)

    record = replace(
        given,
        time_s=np.arange(samples, dtype=float),
        current_a=span(prepared.current_a),
        voltage_v=span(prepared.voltage_v),
        temperature_degc=None,
        step=None,
        row=np.arange(samples),
    )
    return replace(
        prepared,
        record=record,
        first=0,
        soc=span(prepared.soc),
        direction=span(prepared.direction),
        source_v=span(prepared.source_v),
        scored=np.ones(samples, bool),
    )
