"""The objects behind a result, and the best circuit known."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

from .cell import CircuitParameters, OcvTable
from .display import Brief
from .errors import InputError
from .global_optimum import GlobalOptimum
from .model.problem import Problem
from .notices import Notice
from .over_soc import SocErrors, table_name
from .records import Record
from .search.evaluate import Evaluation
from .search.refine import SAME_RMSE, AtBound, Refinement
from .search.seeds import Search
from .select import Tried
from .table_run import TableRun
from .uncertainty import Assessment, Examination


@dataclass(frozen=True)
class Candidate:
    """A circuit with its errors on what it was fitted to, and on what it was not.

    Attributes:
        model: Name of the circuit.
        over: "soc" or "soc,temperature" for tables, "ocv" for one value of each resistance at every
            SOC beside a table of the OCV, None for a constant circuit.
        identification: Errors on all records identified on together.
        validation_v: RMSE on each record validated on.
        held_out: Errors on records left out whole where there are several, else on blocks held out
            of the fit; None where nothing was.
        proved_gap: The largest share of its error that a better circuit of its kind could save;
            None without a proof.
        is_answer: True for the one that the result is of.
    """

    model: str
    over: str | None
    identification: SocErrors
    validation_v: tuple[float, ...]
    held_out: SocErrors | None
    proved_gap: float | None = None
    is_answer: bool = False

    @property
    def name(self) -> str:
        """The circuit as tables and screens call it."""
        return table_name(self.model, self.over)

    @classmethod
    def of(
        cls,
        model: str,
        over: str | None,
        identified: Iterable[Evaluation],
        validated: Iterable[Evaluation],
        *given: Any,
    ) -> "Candidate":
        """The candidate with the errors of its evaluations."""
        validation_v = tuple(evaluation.metrics.rmse_v for evaluation in validated)
        scored = [(own, own.prepared.scored) for own in identified]
        together = SocErrors.of((own.error_v[at], own.prepared.soc[at]) for own, at in scored)
        return cls(model, over, together, validation_v, *given)


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
        candidates: The constant circuit and the answer.
        tried: The circuits of the family that were tried, rung by rung.
        hold_shift_ohm: How much more R0 of the constant circuit would be if a sample's current
            flowed on its other side, where that is open.
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
    tried: tuple[Tried, ...] = ()
    hold_shift_ohm: float | None = None
    ocv: list[Record | OcvTable] = field(default_factory=list)
    notes: tuple[Notice, ...] = ()
    warnings: tuple[Notice, ...] = ()
