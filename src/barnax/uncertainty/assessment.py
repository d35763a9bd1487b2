"""An assessment needs no further fit; an examination fits again, some hundred times."""

from dataclasses import dataclass

from jaxtyping import Array, Key

from ..cell import CircuitParameters
from ..execution import one_blas_thread
from ..model.problem import Problem, rmse_by_scan
from .bootstrap import Bootstrap, bootstrap
from .covariance import Covariance, Uncertainty
from .diagnostics import Diagnostics, diagnostics
from .identifiability import Identifiability, identifiability
from .linearization import linearize
from .profile import Profile, profile
from .refit import Refit
from .suggestions import Suggestion, suggestions


@dataclass(frozen=True, eq=False)
class Assessment:
    """What the record says of a circuit's parameters, without fitting anything again.

    `covariance` is what the other three follow from.
    """

    covariance: Covariance
    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics


@dataclass(frozen=True)
class Examination:
    """Profiles of all free parameters, the block bootstrap, and changes ranked by their error.

    `rmse_v` is that of the circuit itself.
    """

    rmse_v: float
    profiles: tuple[Profile, ...]
    bootstrap: Bootstrap
    suggestions: tuple[Suggestion, ...]


def assess(problem: Problem, parameters: CircuitParameters) -> Assessment:
    """The assessment of an optimum; it costs one Jacobian and some transforms.

    Raises `InputError` where the circuit's errors or their derivatives are not finite.
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
    """The examination of an optimum. Two or three programs are compiled for circuits with one part
    more; `key` decides what the bootstrap draws."""
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
