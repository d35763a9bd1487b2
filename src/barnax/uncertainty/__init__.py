"""What the data determine, how well, and what would lower the error."""

from .assessment import Assessment, Examination, assess, examine
from .covariance import Covariance, Estimate, Uncertainty
from .diagnostics import Band, Diagnostics
from .identifiability import Finding, Identifiability
from .linearization import compile_linearization
from .refit import Refit
from .refitted import Bootstrap, Profile, bootstrap, profile
from .suggestions import Suggestion, suggestions

__all__ = [
    "Assessment",
    "Band",
    "Bootstrap",
    "Covariance",
    "Diagnostics",
    "Estimate",
    "Examination",
    "Finding",
    "Identifiability",
    "Profile",
    "Refit",
    "Suggestion",
    "Uncertainty",
    "assess",
    "bootstrap",
    "compile_linearization",
    "examine",
    "profile",
    "suggestions",
]
