"""The pieces that a test is made of: currents held for a while, in shares of what is allowed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import jax
import numpy as np
from jaxtyping import Array, Float, Int

# A cycler holds no step shorter than this, and levels are multiples of that share.
SHORTEST_S = 2.0
LEVEL = 0.05


@dataclass(frozen=True)
class Block:
    """Steps of constant current: how long each lasts, and its level.

    Args:
        name: What it is.
        durations_s: Duration of each step.
        levels: Its level: a share of the largest current allowed at the state of charge where the
            block stands; 1 is the largest discharge, -1 the largest charge, 0 a rest.

    >>> Block("pulse", (10.0, 40.0), (1.0, 0.0)).duration_s
    50.0
    """

    name: str
    durations_s: tuple[float, ...]
    levels: tuple[float, ...]

    @property
    def duration_s(self) -> float:
        return sum(self.durations_s)

    def currents(self, discharge_a: float, charge_a: float) -> Float[np.ndarray, "steps"]:
        """The current of every step in A, where so much discharge and charge are allowed."""
        level = np.array(self.levels)
        return np.where(level > 0, level * discharge_a, level * charge_a)

    def pairs(self, discharge_a: float, charge_a: float) -> list[tuple[float, float]]:
        """Duration and current of every step."""
        currents = self.currents(discharge_a, charge_a).tolist()
        return [*zip(self.durations_s, currents, strict=True)]


def candidate_blocks(
    key: Array, drive: Float[np.ndarray, "seconds"] | None = None
) -> tuple[Block, ...]:
    """The blocks that a design chooses from by default.

    Pulses and rests, pseudo-random binary currents of several clocks, random steps, a multisine
    and, where one is given, pieces of a drive cycle (`drive`, a level for every second).

    Args:
        key: What the random ones are drawn with.
        drive: A drive cycle, 1 its largest discharge.
    """
    binary_key, step_key, sine_key, piece_key = jax.random.split(key, 4)
    pulses_s = (10.0, 40.0, 10.0, 40.0)
    blocks = [
        Block("slow discharge", (300.0,), (0.2,)),
        Block("short pulses", pulses_s, (1.0, 0.0, -1.0, 0.0)),
        Block("small pulses", pulses_s, (0.5, 0.0, -0.5, 0.0)),
        Block("long pulse", (60.0, 120.0), (1.0, 0.0)),
    ]
    for number, (clock_s, length_s) in enumerate(((4, 64), (12, 144), (40, 240))):
        own = jax.random.fold_in(binary_key, number)
        for floor in (-1.0, 0.0):
            levels = np.where(_balanced(own, length_s // clock_s), 1.0, floor)
            name = f"binary {clock_s} s" + (", no charge" if floor == 0 else "")
            blocks.append(_joined(name, [float(clock_s)] * len(levels), levels))
    for number, (longest_s, length_s) in enumerate(((30, 120), (120, 360))):
        own = jax.random.fold_in(step_key, number)
        blocks.append(_random_steps(own, longest_s, length_s))
    blocks.append(_multisine(sine_key, 256))
    if drive is not None and len(drive) > DRIVE_S:
        starts = jax.random.randint(piece_key, (2,), 0, len(drive) - DRIVE_S)
        for number, start in enumerate(np.asarray(starts).tolist(), 1):
            piece = np.clip(drive[start : start + DRIVE_S], -1.0, 1.0)
            blocks.append(_joined(f"drive cycle {number}", [1.0] * DRIVE_S, piece))
    return tuple(blocks)


DRIVE_S = 120


def _balanced(key: Array, count: int) -> Int[np.ndarray, "count"]:
    """Ones and zeros in random order, half of each."""
    return np.asarray(jax.random.permutation(key, np.arange(count) % 2 == 0))


def _random_steps(key: Array, longest_s: float, length_s: float) -> Block:
    """Steps of random levels, with lengths as often short as long."""
    length_key, level_key = jax.random.split(key)
    count = int(length_s // SHORTEST_S)
    drawn = jax.random.uniform(length_key, (count,))
    lengths = np.round(3.0 * (longest_s / 3.0) ** np.asarray(drawn))
    count = int(np.searchsorted(np.cumsum(lengths), length_s)) + 1
    lengths = lengths[:count]
    levels = np.asarray(jax.random.uniform(level_key, (count,), minval=-1.0, maxval=1.0))
    return _joined(f"random steps up to {longest_s:g} s", lengths.tolist(), levels)


def _multisine(key: Array, length_s: int) -> Block:
    """Sines of equal size from 16 s to the length, octave by octave, with random phases."""
    periods = length_s / 2.0 ** np.arange(int(np.log2(length_s / 16)) + 1)
    phases = np.asarray(jax.random.uniform(key, (len(periods), 1))) * 2 * np.pi
    time_s = np.arange(0.0, length_s, 4.0)
    level = np.sum(np.sin(2 * np.pi * time_s / periods[:, None] + phases), axis=0)
    return _joined("multisine", [4.0] * len(level), level / np.abs(level).max())


def _joined(name: str, lengths: Sequence[float], levels: Float[np.ndarray, "steps"]) -> Block:
    """A block of these steps; neighbors of one rounded level are one step."""
    joined = list(_runs(lengths, np.round(levels / LEVEL) * LEVEL + 0.0))
    return Block(name, tuple(length for length, _ in joined), tuple(level for _, level in joined))


def _runs(
    lengths: Sequence[float], levels: Float[np.ndarray, "steps"]
) -> Iterator[tuple[float, float]]:
    firsts = np.flatnonzero(np.append(True, np.diff(levels) != 0))
    for first, after in pairwise([*firsts.tolist(), len(levels)]):
        yield float(sum(lengths[first:after])), round(float(levels[first]), 6)
