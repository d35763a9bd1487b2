"""Records of any length in one shape, so that one compiled scan serves them all."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Self

from .intervals import next_nodes
from .simulate import AbstractEvaluator, Joint, SimulationInput


@dataclass(frozen=True)
class PaddedSize:
    """The size of the largest of some records: samples, and nodes of both clocks."""

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
            max((len(hysteresis.intervals.node_s) for hysteresis in turning), default=0),
        )

    def fill(self, inputs: SimulationInput) -> SimulationInput:
        """The record, made as large as this; its errors keep their bits."""
        if not self.is_shared:
            inputs = inputs.padded_to(self.samples)
        hysteresis = inputs.hysteresis
        if hysteresis is not None:
            clock = hysteresis.intervals.with_nodes(self.turning_nodes)
            hysteresis = replace(hysteresis, intervals=clock)
        intervals = inputs.intervals.with_nodes(self.nodes)
        return replace(inputs, intervals=intervals, hysteresis=hysteresis)


def to_common_size(inputs: SimulationInput) -> SimulationInput:
    """The record in one of few shapes, so that a new one seldom compiles anything: one an octave of
    samples, two of very many, where they cost more than programs; one every two octaves of nodes.
    """
    size = PaddedSize.of([inputs])
    # The next of 64, 128 and so on to 65,536, then 98,304, 131,072 and so on.
    power = max(6, (size.samples - 1).bit_length())
    is_between = power > 16 and size.samples <= 3 << (power - 2)
    samples = 3 << (power - 2) if is_between else 1 << power
    nodes, turning_nodes = map(next_nodes, (size.nodes, size.turning_nodes))
    return PaddedSize(samples, False, nodes, turning_nodes).fill(inputs)


def padding_for(
    evaluators: Iterable[AbstractEvaluator],
) -> Callable[[AbstractEvaluator], AbstractEvaluator]:
    """A function that makes each of these evaluators as large as the largest.

    Those that do not simulate samples one by one, or do not hold equally many records, stay as
    they are.
    """
    rows = [records_in(evaluator) for evaluator in evaluators]
    if not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        return lambda evaluator: evaluator
    sizes = [PaddedSize.of(column) for column in zip(*rows, strict=True)]

    def fill(evaluator: AbstractEvaluator) -> AbstractEvaluator:
        filled = zip(sizes, records_in(evaluator), strict=True)
        return Joint.of(tuple(size.fill(inputs) for size, inputs in filled))

    return fill


def records_in(evaluator: AbstractEvaluator) -> tuple[SimulationInput, ...]:
    """The records that are simulated sample by sample, none where any is not."""
    parts = evaluator.parts if isinstance(evaluator, Joint) else (evaluator,)
    all_inputs = tuple(part for part in parts if isinstance(part, SimulationInput))
    return all_inputs if len(all_inputs) == len(parts) else ()
