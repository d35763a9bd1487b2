"""Circuits with tables over SOC beside the constant ones of a comparison."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..baselines import Budget
from ..errors import InputError
from ..model.prepared import PreparedRecord
from ..model.problem import known_to
from ..model.search_space import Range
from ..over_soc import SocErrors, TableFit, TableFits, TableSettings, errors_on, fit_tables
from ..over_soc.by_method import SEARCHES, capped, search_by
from ..over_soc.fit import reduced_objective
from ..search.evaluate import Evaluation, evaluate
from ..table_run import TableRun, table_warnings
from .run import Comparison


@dataclass(frozen=True)
class TableSearch:
    """What one method made of the time constants, with the best tables solved at every place.

    `objective_v` is the median seed's sqrt(J), and `gap` its excess over that of the fit beside
    it; `constants` and `evaluations`, places tried, are that seed's, and `errors` those of its
    tables on the record identified on, then on each validation record.
    """

    method: str
    seeds: int
    objective_v: float
    best_objective_v: float
    worst_objective_v: float
    gap: float
    evaluations: int
    constants: dict[str, float]
    errors: tuple[SocErrors, ...]


@dataclass(frozen=True)
class Tabulated:
    """One circuit with tables over SOC, and the best constant one of the comparison beside it.

    `errors` and `constant_errors` are those on the record identified on, then on each validation
    record; `constant_parameters` counts the constant circuit's values. `searches` are what the
    methods of the comparison find, without the linear ones, which have no tables.
    """

    model: str
    fit: TableFit
    errors: tuple[SocErrors, ...]
    constant_errors: tuple[SocErrors, ...]
    constant_parameters: int
    searches: tuple[TableSearch, ...] = ()
    warnings: tuple[str, ...] = ()


def tabulate(
    comparison: Comparison,
    models: Sequence[str],
    settings: TableSettings | None = None,
    *,
    bounds: Mapping[str, Range] | None = None,
    fixed: Mapping[str, float] | None = None,
) -> tuple[Tabulated, ...]:
    """Tables over SOC for some models of a comparison, on the records and windows of its rows.

    Bounds and fixed values are those of the comparison, and go to the models that know their
    names. Raises `InputError` where no row of such a model has an answer, or tables have no such
    constant.
    """
    settings, found = settings or TableSettings(), []
    for model in models:
        rows = [row for row in comparison.answered if row.model == model]
        if not rows:
            raise InputError(
                f"`models` '{model}:soc': no row of {model} has an answer to compare with"
            )
        all_models = [row.model for row in comparison.rows]
        wanted = replace(
            settings,
            bounds=known_to(model, bounds, all_models),
            fixed=known_to(model, fixed, all_models),
        )
        best = min(rows, key=lambda row: row.evaluations[0].metrics.rmse_v)
        fit = fit_tables(best.problem.prepared_records, wanted)
        parameters = best.median.parameters
        optimum = comparison.optima.get(model)
        if optimum is not None:
            parameters = optimum.parameters
        prepared = [each.prepared for each in best.evaluations]
        run = TableRun.of(wanted, TableFits((fit,)), prepared[:1], prepared[1:], best.problem.cell)
        methods = [row.method for row in comparison.rows if row.model == model]
        found.append(
            Tabulated(
                model=model,
                fit=fit,
                errors=tuple(map(_errors, (*run.identification, *run.validation))),
                constant_errors=tuple(_errors(evaluate(each, parameters)) for each in prepared),
                constant_parameters=len(parameters.to_dict()),
                searches=_searches(methods, fit, wanted, prepared, comparison.budget),
                warnings=tuple(table_warnings(run)),
            )
        )
    return tuple(found)


def _searches(
    methods: Sequence[str],
    fit: TableFit,
    settings: TableSettings,
    prepared: Sequence[PreparedRecord],
    budget: Budget,
) -> tuple[TableSearch, ...]:
    identified, *others = prepared
    settings = replace(settings, folds=0)
    objective = reduced_objective([identified], settings)
    found = []
    for method in dict.fromkeys(each for each in methods if each in SEARCHES):
        ends = search_by(objective, method, capped(budget))
        ends.sort(key=lambda end: end[0].squared)
        median, evaluations = ends[(len(ends) - 1) // 2]
        tables = objective.tables_at(median)
        found.append(
            TableSearch(
                method=method,
                seeds=len(ends),
                objective_v=median.root,
                best_objective_v=ends[0][0].root,
                worst_objective_v=ends[-1][0].root,
                gap=median.root / fit.objective_v - 1 if fit.objective_v else 0.0,
                evaluations=evaluations,
                constants=dict(tables.constants),
                errors=tuple(errors_on(each, tables) for each in (identified, *others)),
            )
        )
    return tuple(found)


def _errors(evaluation: Evaluation) -> SocErrors:
    scored = evaluation.prepared.scored
    return SocErrors.of([(evaluation.error_v[scored], evaluation.prepared.soc[scored])])
