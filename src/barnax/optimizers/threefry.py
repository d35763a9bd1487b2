"""The random bits of `jax.random`, from a program that runs them faster on the CPU.

There JAX compiles the twenty rounds of Threefry (Salmon et al., 2011) as a loop over rounds, each
of which walks the numbers anew. That compiles quickly, but costs ten times the numbers themselves
where a few hundred are drawn at a time, as in a generation. Written out, all rounds of a number
run in its registers.
"""

import math

import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax import lax
from jax.extend.random import define_prng_impl
from jaxtyping import Array, Key, UInt32

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = np.uint32(0x1BD11BDA)


def written_out(key: Key[Array, "*keys"]) -> Key[Array, "*keys"]:
    """The key as one whose numbers are those of `jax.random` for `key`, only sooner.

    They are those of JAX's default setting, `jax_threefry_partitionable`. Keys of other kinds than
    its default are left as they are.

    >>> key = jr.key(0)
    >>> bool(jr.uniform(written_out(key)) == jr.uniform(key))
    True
    """
    if str(jr.key_impl(key)) != "threefry2x32":
        return key
    return jr.wrap_key_data(jr.key_data(key), impl=_WRITTEN_OUT)


def _hash(
    key: UInt32[Array, "2"], high: UInt32[Array, "*shape"], low: UInt32[Array, "*shape"]
) -> tuple[UInt32[Array, "*shape"], UInt32[Array, "*shape"]]:
    """Threefry-2x32 with 20 rounds of the counters `high`, `low`."""
    schedule = (key[0], key[1], key[0] ^ key[1] ^ _PARITY)
    left, right = high + schedule[0], low + schedule[1]
    for group in range(5):
        for distance in _ROTATIONS[group % 2]:
            left = left + right
            right = left ^ (right << np.uint32(distance) | right >> np.uint32(32 - distance))
        left = left + schedule[(group + 1) % 3]
        right = right + schedule[(group + 2) % 3] + np.uint32(group + 1)
    return left, right


def _hash_counters(key: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    low = lax.iota(np.uint32, math.prod(shape)).reshape(shape)
    return _hash(key, jnp.zeros_like(low), low)


def _split(key: Array, shape: tuple[int, ...]) -> Array:
    return jnp.stack(_hash_counters(key, shape), axis=-1)


def _fold_in(key: Array, data: int | Array) -> Array:
    return jnp.stack(_hash(key, jnp.uint32(0), jnp.asarray(data, np.uint32)))


def _random_bits(key: Array, width: int, shape: tuple[int, ...]) -> Array:
    left, right = _hash_counters(key, shape)
    if width == 64:
        return left.astype(np.uint64) << np.uint64(32) | right.astype(np.uint64)
    return (left ^ right).astype(f"uint{width}")


def _seed(seed: Array) -> Array:
    return jr.key_data(jr.key(seed, impl="threefry2x32"))


_WRITTEN_OUT = define_prng_impl(
    key_shape=(2,),
    seed=_seed,
    split=_split,
    random_bits=_random_bits,
    fold_in=_fold_in,
    name="threefry2x32_written_out",
    tag="fryw",
)
