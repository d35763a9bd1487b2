"""Records of any length in one shape, so that one compiled scan serves them all."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp

from .simulate import AbstractEvaluator, Joint, SimulationInput


@dataclass(frozen=True)
class PaddedSize:
    """What the largest of some records takes: samples, and nodes of both its clocks."""

    samples: int
    is_shared: bool
    nodes: int
    turning_nodes: int

    @classmethod
    def of(cls, all_inputs: Iterable[SimulationInput]) -> Self:
        """Room for every one of these."""
        lengths = {len(inputs.current_a) for inputs in all_inputs}
        turning = [inputs.hysteresis for inputs in all_inputs if inputs.hysteresis is not None]
        return cls(
            max(lengths),
            len(lengths) == 1,
            max(len(inputs.intervals.node_s) for inputs in all_inputs),
            max((len(each.intervals.node_s) for each in turning), default=0),
        )

    def fill(self, inputs: SimulationInput) -> SimulationInput:
        """The record, made as large as this; its errors keep their bits."""
        if not self.is_shared:
            inputs = inputs.padded_to(self.samples)
        inputs = _with_nodes(inputs, lambda inputs: inputs.intervals.node_s, self.nodes)
        if inputs.hysteresis is None:
            return inputs
        return _with_nodes(
            inputs, lambda inputs: inputs.hysteresis.intervals.node_s, self.turning_nodes
        )


def padding_for(
    evaluators: Iterable[AbstractEvaluator],
) -> Callable[[AbstractEvaluator], AbstractEvaluator]:
    """A function that makes each of these evaluators as large as the largest.

    Those that do not simulate samples one by one, or do not hold equally many records, stay as
    they are.
    """
    rows = [_records(evaluator) for evaluator in evaluators]
    if not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        return lambda evaluator: evaluator
    sizes = [PaddedSize.of(column) for column in zip(*rows, strict=True)]

    def fill(evaluator: AbstractEvaluator) -> AbstractEvaluator:
        filled = zip(sizes, _records(evaluator), strict=True)
        return Joint.of(tuple(size.fill(inputs) for size, inputs in filled))

    return fill


def _records(evaluator: AbstractEvaluator) -> tuple[SimulationInput, ...]:
    parts = evaluator.parts if isinstance(evaluator, Joint) else (evaluator,)
    all_inputs = tuple(part for part in parts if isinstance(part, SimulationInput))
    return all_inputs if len(all_inputs) == len(parts) else ()


def _with_nodes(
    inputs: SimulationInput, nodes_of: Callable[[Any], Any], count: int
) -> SimulationInput:
    missing = count - len(nodes_of(inputs))
    return eqx.tree_at(
        nodes_of, inputs, replace_fn=lambda node_s: jnp.pad(node_s, (0, missing), mode="edge")
    )
