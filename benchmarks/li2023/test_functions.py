"""Nine functions population optimizers are compared on, and the same moved off the origin.

Each takes one point `x` of any number of dimensions and a key, which only F5 uses. The formulas
are those of Li et al. (2023), Table 1, with its misprints mended so that each has the optimum
named there: absolute values in F2, no floor in F3, squared sines in F9.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jax import lax
from jaxtyping import Array, Float, Int, Key, Scalar

DIMS = 30


class BenchmarkFunction(NamedTuple):
    """A function, the half-width of its search box about zero, and where its minimum lies.

    `minimizer` is the value of every coordinate of the minimum, where the loss is zero.
    """

    loss: Callable[[Float[Array, "dims"], Key[Array, ""]], Scalar]
    half_width: float
    minimizer: float
    source: str
    dims: int = DIMS
    minimum: float = 0.0
    is_noisy: bool = False


def sphere(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F1, the sum of squares."""
    return jnp.sum(x**2)


def schwefel_222(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F2, the sum and the product of absolute values (Schwefel, 1981, problem 2.22)."""
    return jnp.sum(jnp.abs(x)) + jnp.prod(jnp.abs(x))


def smooth_step(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F3, the step function without its floor: a sphere about -0.5."""
    return jnp.sum((x + 0.5) ** 2)


def schwefel_221(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F4, the largest absolute value (Schwefel, 1981, problem 2.21)."""
    return jnp.max(jnp.abs(x))


def quartic(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F5 without its noise, the weighted sum of fourth powers (De Jong, 1975)."""
    return jnp.sum(_ordinals(x) * x**4)


def noisy_quartic(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F5, with uniform noise in [0, 1) redrawn at every evaluation (De Jong, 1975)."""
    return quartic(x, key) + jr.uniform(key, (), x.dtype)


def griewank(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F6 (Griewank, 1981)."""
    return jnp.sum(x**2) / 4000 - jnp.prod(jnp.cos(x / jnp.sqrt(_ordinals(x)))) + 1


def rastrigin(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F7 (Rastrigin, 1974)."""
    return jnp.sum(x**2 - 10 * jnp.cos(2 * jnp.pi * x) + 10)


def ackley(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F8 (Ackley, 1987)."""
    distance = jnp.sqrt(jnp.mean(x**2))
    ripple = jnp.mean(jnp.cos(2 * jnp.pi * x))
    return -20 * jnp.exp(-0.2 * distance) - jnp.exp(ripple) + 20 + jnp.e


def penalized(x: Float[Array, "dims"], key: Key[Array, ""]) -> Scalar:
    """F9, Levy's function with a penalty outside [-10, 10] (Yao et al., 1999, their f12)."""
    y = 1 + (x + 1) / 4
    rise = 10 * jnp.sin(jnp.pi * y[0]) ** 2
    waves = jnp.sum((y[:-1] - 1) ** 2 * (1 + 10 * jnp.sin(jnp.pi * y[1:]) ** 2))
    penalty = jnp.sum(100 * jnp.maximum(jnp.abs(x) - 10, 0) ** 4)
    return jnp.pi / len(x) * (rise + waves + (y[-1] - 1) ** 2) + penalty


def _ordinals(x: Float[Array, "dims"]) -> Float[Array, "dims"]:
    return jnp.arange(1, len(x) + 1, dtype=x.dtype)


FUNCTIONS: Mapping[str, BenchmarkFunction] = MappingProxyType(
    {
        "F1": BenchmarkFunction(sphere, 100, 0.0, "De Jong (1975)"),
        "F2": BenchmarkFunction(schwefel_222, 10, 0.0, "Schwefel (1981), 2.22"),
        "F3": BenchmarkFunction(smooth_step, 100, -0.5, "Li et al. (2023)"),
        "F4": BenchmarkFunction(schwefel_221, 100, 0.0, "Schwefel (1981), 2.21"),
        "F5": BenchmarkFunction(noisy_quartic, 1.28, 0.0, "De Jong (1975)", is_noisy=True),
        "F6": BenchmarkFunction(griewank, 600, 0.0, "Griewank (1981)"),
        "F7": BenchmarkFunction(rastrigin, 5.12, 0.0, "Rastrigin (1974)"),
        "F8": BenchmarkFunction(ackley, 32, 0.0, "Ackley (1987)"),
        "F9": BenchmarkFunction(penalized, 50, -1.0, "Yao et al. (1999), f12"),
    }
)

# What F5 is where its noise would drown the comparison.
QUIET_FUNCTIONS: Mapping[str, BenchmarkFunction] = MappingProxyType(
    {**FUNCTIONS, "F5": BenchmarkFunction(quartic, 1.28, 0.0, "De Jong (1975), no noise")}
)


class Displacement(eqx.Module):
    """A function moved: its value at x becomes that at `rotation @ (x - offset)`.

    `offset` is in half-widths of the box; without `rotation` the axes stay.
    """

    offset: Float[Array, "dims"]
    rotation: Float[Array, "dims dims"] | None = None

    def __call__(self, x: Float[Array, "dims"], half_width: Scalar) -> Float[Array, "dims"]:
        moved = x - self.offset * half_width
        return moved if self.rotation is None else self.rotation @ moved


def draw_displacement(
    key: Key[Array, ""], dims: int, is_rotated: bool, dtype: type = float
) -> Displacement:
    """An offset uniform within 0.6 half-widths, and an orthogonal matrix, uniform by Haar."""
    offset_key, rotation_key = jr.split(key)
    offset = jr.uniform(offset_key, (dims,), dtype, minval=-0.6, maxval=0.6)
    rotation = jr.orthogonal(rotation_key, dims, dtype=dtype) if is_rotated else None
    return Displacement(offset, rotation)


class Problem(eqx.Module):
    """Which function, by its place in a mapping, and how it is displaced; all of it traced."""

    index: Int[Array, ""]
    half_width: Float[Array, ""]
    displacement: Displacement | None = None


def make_problem(
    name: str, displacement: Displacement | None = None, dtype: type = float
) -> Problem:
    """The problem `name` of the nine.

    Raises `ValueError` for an unknown name.
    """
    if name not in FUNCTIONS:
        raise ValueError(f"no function is called {name!r}; there are {', '.join(FUNCTIONS)}")
    index = jnp.asarray(list(FUNCTIONS).index(name))
    return Problem(index, jnp.asarray(FUNCTIONS[name].half_width, dtype), displacement)


def loss_of_problem(
    x: Float[Array, "dims"], problem_and_key: tuple[Problem, Key[Array, ""]]
) -> Scalar:
    """The loss at `x`: an objective for `options["keyed_objective"]`, F5's noise included.

    One compilation serves all nine functions as long as `index` is not batched.
    """
    return _switch(FUNCTIONS, x, *problem_and_key)


def quiet_loss_of_problem(x: Float[Array, "dims"], problem: Problem) -> Scalar:
    """The loss at `x` with F5 free of noise."""
    return _switch(QUIET_FUNCTIONS, x, problem, jr.key(0))


def _switch(functions: Mapping, x: Array, problem: Problem, key: Array) -> Scalar:
    if problem.displacement is not None:
        x = problem.displacement(x, problem.half_width)
    return lax.switch(problem.index, [function.loss for function in functions.values()], x, key)
