"""A row's answers as plain arrays, so that a long comparison can be resumed."""

from collections.abc import Sequence

import numpy as np

from ..cell import Circuit, CircuitParameters
from .answer import Answer

Arrays = tuple[np.ndarray, ...]


def can_be_stored(answers: Sequence[Answer]) -> bool:
    """Whether arrays hold all of them: searches do, what has words or a trajectory does not."""
    return all(
        answer.history_v is not None and answer.trajectory is None and not answer.notes
        for answer in answers
    )


def to_arrays(answers: Sequence[Answer]) -> Arrays:
    """Parameters, RMSE, evaluations and histories, a row a seed."""
    return (
        np.array([list(answer.parameters.to_dict().values()) for answer in answers]),
        np.array([answer.rmse_v for answer in answers]),
        np.array([answer.evaluations for answer in answers]),
        np.stack([np.asarray(answer.history_v) for answer in answers]),
    )


def from_arrays(arrays: Arrays, circuit: Circuit) -> list[Answer]:
    """The answers again, of a search on `circuit`."""
    return [
        Answer(
            CircuitParameters.from_dict(
                dict(zip(circuit.parameter_names, values.tolist(), strict=True))
            ),
            float(rmse_v),
            int(evaluations),
            history_v,
        )
        for values, rmse_v, evaluations, history_v in zip(*arrays, strict=True)
    ]
