"""What is random in the barnacles: the tent-map start, normal numbers, the Levy-flight step."""

import math
from typing import Any, Literal

import jax.numpy as jnp
import jax.random as jr
from jax import lax
from jaxtyping import Array, Float, Key

TentBranch = Literal["state", "random"]


def tent_map(
    key: Key[Array, ""], population: int, dims: int, branch: TentBranch, dtype: Any
) -> Float[Array, "candidates dims"]:
    """Tent sequences (Li et al., 2023, Eq. 13): a seed a candidate, iterated along the dimensions.

    `branch="state"` takes the branch by the value itself, which keeps the sequence uniform in
    [0, 1]. `"random"` takes it by an independent random number, as the equation is printed; then
    most values leave [0, 1] and end on the bounds once clipped.
    """
    seed_key, branch_key = jr.split(key)
    # 0 and 1 are fixed points of the map, so the seed stays strictly inside.
    seed = jr.uniform(seed_key, (population,), dtype, minval=1e-6, maxval=1 - 1e-6)
    chances = jr.uniform(branch_key, (dims, population), dtype)

    def iterate(value, chance):
        decides = value if branch == "state" else chance
        return jnp.where(decides < 0.7, value / 0.7, (1 - value) * (10 / 3)), value

    _, columns = lax.scan(iterate, seed, chances)
    return columns.T


def levy_step(
    key: Key[Array, ""], shape: tuple[int, ...], exponent: float, dtype: Any
) -> Float[Array, "..."]:
    """Levy-stable steps by Mantegna's method (Li et al., 2023, Eq. 17 and 18)."""
    numerator = math.gamma(1 + exponent) * math.sin(math.pi * exponent / 2)
    denominator = math.gamma((1 + exponent) / 2) * exponent * 2 ** ((exponent - 1) / 2)
    sigma = (numerator / denominator) ** (1 / exponent)
    top_key, bottom_key = jr.split(key)
    top = sigma * normal(top_key, shape, dtype)
    bottom = jnp.abs(normal(bottom_key, shape, dtype))
    return top / bottom ** (1 / exponent)


def normal(key: Key[Array, ""], shape: tuple[int, ...], dtype: Any) -> Float[Array, "..."]:
    """Standard normal numbers, with the resolution of single precision whatever the dtype.

    Where only their distribution counts, that is enough, and three times faster than jax.random's
    in double precision. None exceeds 5.5.
    """
    return jr.normal(key, shape, jnp.float32).astype(dtype)
