"""How far an answer can be trusted: its uncertainty, what the data determine, where it errs."""

from dataclasses import dataclass
from typing import Any

from ..execution import one_blas_thread
from ..search.refine import Refinement
from .covariance import Uncertainty, estimate_uncertainty
from .diagnostics import Diagnostics, diagnostics
from .identifiability import Identifiability, identifiability
from .linearization import Linearization, linearize


@dataclass(frozen=True, eq=False)
class Assessment:
    """What can be said of a refined answer without fitting anything again."""

    linearization: Linearization
    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics

    @property
    def words(self) -> str:
        """Sentences for a report."""
        parts = (self.uncertainty, self.identifiability, self.diagnostics)
        return " ".join(part.words for part in parts if part.words)

    def to_dict(self) -> dict[str, Any]:
        return {
            "uncertainty": self.uncertainty.to_dict(),
            "identifiability": self.identifiability.to_dict(),
            "diagnostics": self.diagnostics.to_dict(),
        }


def assess(refinement: Refinement) -> Assessment:
    """The assessment of a cross-checked answer; it costs one Jacobian and some transforms."""
    linearization = linearize(refinement.search.problem, refinement.parameters)
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        uncertainty = estimate_uncertainty(refinement.parameters, linearization)
        return Assessment(
            linearization=linearization,
            uncertainty=uncertainty,
            identifiability=identifiability(refinement, linearization, uncertainty),
            diagnostics=diagnostics(refinement, linearization, uncertainty.noise),
        )
