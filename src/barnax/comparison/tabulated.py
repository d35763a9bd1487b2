"""Circuits with tables over SOC beside the constant ones of a comparison."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError
from ..over_soc import SocErrors, TableFit, TableSettings, evaluate_tables, fit_tables
from ..search.evaluate import Evaluation, evaluate
from .run import Comparison


@dataclass(frozen=True)
class Tabulated:
    """One circuit with tables over SOC, and the best constant one of the comparison beside it.

    `errors` and `constant_errors` are those on the record identified on, then on each validation
    record; `constant_parameters` counts the constant circuit's values.
    """

    model: str
    fit: TableFit
    errors: tuple[SocErrors, ...]
    constant_errors: tuple[SocErrors, ...]
    constant_parameters: int


def tabulate(
    comparison: Comparison, models: Sequence[str], settings: TableSettings | None = None
) -> tuple[Tabulated, ...]:
    """Tables over SOC for some models of a comparison, on the records and windows of its rows.

    Raises `InputError` where no row of such a model has an answer.
    """
    found = []
    for model in models:
        rows = [row for row in comparison.answered if row.model == model]
        if not rows:
            raise InputError(f"`models` '{model}:soc': no row of {model} has an answer beside it")
        best = min(rows, key=lambda row: row.evaluations[0].metrics.rmse_v)
        fit = fit_tables(best.problem.prepared_records, settings)
        parameters = best.median.parameters
        optimum = comparison.optima.get(model)
        if optimum is not None:
            parameters = optimum.parameters
        prepared = [each.prepared for each in best.evaluations]
        found.append(
            Tabulated(
                model=model,
                fit=fit,
                errors=tuple(_errors(evaluate_tables(each, fit.tables)) for each in prepared),
                constant_errors=tuple(_errors(evaluate(each, parameters)) for each in prepared),
                constant_parameters=len(parameters.to_dict()),
            )
        )
    return tuple(found)


def _errors(evaluation: Evaluation) -> SocErrors:
    scored = evaluation.prepared.scored
    return SocErrors.of(evaluation.error_v[scored], evaluation.prepared.soc[scored])
