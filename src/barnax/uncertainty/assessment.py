"""An assessment needs no further fit; an examination fits again, some hundred times."""

from dataclasses import dataclass

from jaxtyping import Array, Key

from ..cell import CircuitParameters
from ..execution import one_blas_thread
from ..model.problem import Problem, rmse_by_scan
from .covariance import Covariance, Uncertainty
from .diagnostics import Diagnostics, diagnostics
from .identifiability import Identifiability, identifiability
from .linearization import linearize
from .refit import Refit
from .refitted import Bootstrap, Profile, bootstrap, profile
from .suggestions import Suggestion, suggestions


@dataclass(frozen=True, eq=False)
class Assessment:
    """Intervals, identifiability and residual diagnostics of an optimum, without further fits.

    They follow from `covariance`.
    """

    covariance: Covariance
    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics


@dataclass(frozen=True)
class Examination:
    """Profiles of all free parameters, the block bootstrap, and changes ranked by their error.

    `rmse_v` is the RMSE of the unchanged circuit, in V.
    """

    rmse_v: float
    profiles: tuple[Profile, ...]
    bootstrap: Bootstrap
    suggestions: tuple[Suggestion, ...]


def assess(problem: Problem, parameters: CircuitParameters) -> Assessment:
    """The intervals and diagnostics of an optimum, from one Jacobian.

    `parameters` must be an optimum of the problem, such as those of `refine` or
    `find_global_optimum`. Raises `InputError` if the errors or their derivatives are not finite.
    """
    linearization = linearize(problem, parameters)
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        covariance = Covariance.of(linearization)
        return Assessment(
            covariance=covariance,
            uncertainty=covariance.summary(parameters),
            identifiability=identifiability(problem, parameters, covariance),
            diagnostics=diagnostics(problem, covariance),
        )


def examine(
    problem: Problem,
    parameters: CircuitParameters,
    assessment: Assessment,
    *,
    key: Key[Array, ""],
) -> Examination:
    """Profiles, a block bootstrap, and changes that might lower the error, by further fits.

    `parameters` and `assessment` are those of the same optimum; `key` is for the bootstrap. Two or
    three programs are compiled, for circuits with one more part."""
    refit, covariance = Refit(problem), assessment.covariance
    free = [each.name for each in assessment.uncertainty.estimates if each.relative_error]
    return Examination(
        rmse_v=rmse_by_scan(problem, [parameters])[0],
        profiles=tuple(
            profile(problem, parameters, name, covariance=covariance, refit=refit) for name in free
        ),
        bootstrap=bootstrap(problem, parameters, key=key, covariance=covariance, refit=refit),
        suggestions=suggestions(problem, parameters, refit=refit),
    )
