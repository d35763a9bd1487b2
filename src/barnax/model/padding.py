"""Records of any length in one shape, so that one compiled scan serves them all."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp

from .simulate import AbstractEvaluator, Drive, Joint


@dataclass(frozen=True)
class Room:
    """What the largest of some drives takes: samples, and nodes of both its clocks."""

    samples: int
    is_shared: bool
    nodes: int
    turning_nodes: int

    @classmethod
    def of(cls, drives: Iterable[Drive]) -> Self:
        """Room for every one of these."""
        lengths = {len(drive.current_a) for drive in drives}
        turning = [drive.hysteresis for drive in drives if drive.hysteresis is not None]
        return cls(
            max(lengths),
            len(lengths) == 1,
            max(len(drive.intervals.node_s) for drive in drives),
            max((len(each.intervals.node_s) for each in turning), default=0),
        )

    def fill(self, drive: Drive) -> Drive:
        """The drive, made as large as this; its errors keep their bits."""
        if not self.is_shared:
            drive = drive.filled_up(self.samples)
        drive = _with_nodes(drive, lambda drive: drive.intervals.node_s, self.nodes)
        if drive.hysteresis is None:
            return drive
        return _with_nodes(
            drive, lambda drive: drive.hysteresis.intervals.node_s, self.turning_nodes
        )


def filler(
    evaluators: Iterable[AbstractEvaluator],
) -> Callable[[AbstractEvaluator], AbstractEvaluator]:
    """A function that makes each of these evaluators as large as the largest.

    Those that do not simulate samples one by one, or do not hold equally many records, stay as
    they are.
    """
    rows = [_drives(evaluator) for evaluator in evaluators]
    if not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        return lambda evaluator: evaluator
    rooms = [Room.of(column) for column in zip(*rows, strict=True)]

    def fill(evaluator: AbstractEvaluator) -> AbstractEvaluator:
        filled = zip(rooms, _drives(evaluator), strict=True)
        return Joint.of(tuple(room.fill(drive) for room, drive in filled))

    return fill


def _drives(evaluator: AbstractEvaluator) -> tuple[Drive, ...]:
    parts = evaluator.parts if isinstance(evaluator, Joint) else (evaluator,)
    drives = tuple(part for part in parts if isinstance(part, Drive))
    return drives if len(drives) == len(parts) else ()


def _with_nodes(drive: Drive, nodes_of: Callable[[Any], Any], count: int) -> Drive:
    missing = count - len(nodes_of(drive))
    return eqx.tree_at(
        nodes_of, drive, replace_fn=lambda node_s: jnp.pad(node_s, (0, missing), mode="edge")
    )
