"""Batch least squares of the discretised transfer function."""

import numpy as np

from ..evaluate import evaluate_course
from ..problem import Problem
from .answer import Answer
from .even_samples import even_samples
from .method import Budget, Method, Progress
from .transfer_function import (
    circuit_of,
    impedances,
    outside_box,
    regression,
    require_all_free,
)


def least_squares(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The circuit whose difference equation has the least sum of squared equation errors.

    One linear regression, no simulation, and no box. It minimises the error of predicting the next
    sample from the measured ones before it, not that of a simulation: noise in the regressors
    biases the poles toward fast ones (Ljung, System Identification, 1999, section 7.3), so its
    RMSE is no least one even where it answers. Raises `MethodFailure` where the equation belongs
    to no circuit, and where a parameter is held.
    """
    del budget
    require_all_free(problem)
    pairs = problem.bounds.pairs
    samples = even_samples(problem.course, pairs)
    columns, target = regression(samples, pairs)
    # Columns in volts, amperes and their differences span many decades.
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    coefficients = np.linalg.lstsq(columns / scale, target)[0] / scale
    parameters = circuit_of(*impedances(coefficients, samples, pairs))
    progress(1)
    return [
        Answer(
            parameters=parameters,
            rmse_v=evaluate_course(problem.course, parameters).metrics.rmse_v,
            evaluations=0,
            notes=samples.notes + outside_box(parameters, problem),
        )
    ]


LS = Method(
    "ls",
    "Batch least squares of the discretised transfer function (Ljung, 1999, section 7.3)",
    is_deterministic=True,
    run=least_squares,
)
