"""How far an answer can be trusted: its uncertainty, what the data determine, where it errs."""

from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from ..refinement import CrossCheck
from .covariance import CONFIDENCE, Uncertainty, uncertainty
from .diagnostics import Diagnostics, diagnostics
from .identifiability import Identifiability, identifiability
from .linearization import Linearization, linearize


@dataclass(frozen=True, eq=False)
class Assessment:
    """What can be said of a refined answer without fitting anything again."""

    near: Linearization
    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics

    @property
    def words(self) -> str:
        """Sentences for a report."""
        inflations = [
            each.inflation for each in self.uncertainty.estimates if each.inflation is not None
        ]
        sentences = []
        if inflations:
            sentences.append(
                f"The {100 * CONFIDENCE:.0f} % intervals reckon with errors that stay alike from "
                "sample to sample; were all samples independent, standard errors would be "
                f"{min(inflations):.2g} to {max(inflations):.2g} times smaller."
            )
        return " ".join([*sentences, self.identifiability.words, self.diagnostics.words])

    def to_dict(self) -> dict[str, Any]:
        return {
            "uncertainty": self.uncertainty.to_dict(),
            "identifiability": self.identifiability.to_dict(),
            "diagnostics": self.diagnostics.to_dict(),
        }


def assess(checked: CrossCheck) -> Assessment:
    """The assessment of a cross-checked answer; it costs one Jacobian and some transforms."""
    near = linearize(checked.found.problem, checked.parameters)
    # One thread: what a library does with several would change the last bits.
    with threadpool_limits(1, "blas"):
        sure = uncertainty(checked.parameters, near)
        return Assessment(
            near=near,
            uncertainty=sure,
            identifiability=identifiability(checked, near, sure),
            diagnostics=diagnostics(checked, near, sure.noise),
        )
