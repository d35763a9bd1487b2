"""The objects behind a result, and the best circuit known."""

from dataclasses import dataclass, field
from typing import Literal

from .candidates import Candidate
from .cell import CircuitParameters, OcvTable
from .display import Brief
from .errors import InputError
from .global_optimum import GlobalOptimum, OtherHold
from .model.problem import Problem
from .notices import Notice
from .records import Record
from .search.evaluate import Evaluation
from .search.refine import SAME_RMSE, AtBound, Refinement
from .search.seeds import Search
from .table_run import TableRun
from .uncertainty import Assessment, Examination


@dataclass(frozen=True)
class Answer:
    """The best circuit known, by the scan's RMSE: the seeds' best, or the global optimum."""

    parameters: CircuitParameters
    rmse_v: float
    source: Literal["seeds", "global optimum"]
    at_bound: tuple[AtBound, ...]


def best_answer(refinement: Refinement | None, optimum: GlobalOptimum | None) -> Answer:
    """The better of the refined seeds and the global optimum.

    Where both are the same optimum it is the latter, which no seed has a part in. Raises
    `InputError` where there is neither.
    """
    if optimum is not None and (
        refinement is None or optimum.rmse_v <= refinement.rmse_v * (1 + SAME_RMSE)
    ):
        return Answer(optimum.parameters, optimum.rmse_v, "global optimum", optimum.at_bound)
    if refinement is None:
        raise InputError(
            "the bounds are too wide to look for the global optimum; narrow them with `bounds`, or "
            "search with `seeds`"
        )
    return Answer(refinement.parameters, refinement.rmse_v, "seeds", refinement.at_bound)


@dataclass(frozen=True, eq=False, repr=False)
class Run(Brief):
    """The objects behind a result.

    Attributes:
        problem: The problem that was searched.
        search: What the seeds found, None without seeds.
        refinement: Where Levenberg-Marquardt took them.
        optimum: The global optimum, None if the box is too wide to look for it.
        answer: The best circuit known.
        identification: Simulations of the records identified on.
        validation: Simulations of the records validated on.
        assessment: Intervals and diagnostics.
        examination: What further fits add.
        tables: The circuit with tables over SOC.
        candidates: The circuits that were weighed against each other.
        other_hold: The answer if a sample's current flowed on its other side.
        ocv: The OCV tests.
        notes: What was done with the inputs.
        warnings: What is doubtful, with what to do.
    """

    problem: Problem
    search: Search | None
    refinement: Refinement | None
    optimum: GlobalOptimum | None
    answer: Answer
    identification: list[Evaluation]
    validation: list[Evaluation]
    assessment: Assessment | None
    examination: Examination | None
    tables: TableRun | None = None
    candidates: tuple[Candidate, ...] = ()
    other_hold: OtherHold | None = None
    ocv: list[Record | OcvTable] = field(default_factory=list)
    notes: tuple[Notice, ...] = ()
    warnings: tuple[Notice, ...] = ()
