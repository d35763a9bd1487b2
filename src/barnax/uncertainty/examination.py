"""All that can be learned by fitting again: profiles, the bootstrap, what would lower the error."""

from dataclasses import dataclass
from typing import Any

from jaxtyping import Array, Key

from ..search.refine import Refinement
from .assessment import Assessment
from .bootstrap import Bootstrap, bootstrap
from .profile import Profile, profile
from .refit import Refit
from .suggestions import Suggestion, in_words, suggestions


@dataclass(frozen=True, eq=False)
class Examination:
    """Profiles of all free parameters, the block bootstrap, and changes ranked by their error."""

    profiles: tuple[Profile, ...]
    bootstrap: Bootstrap
    suggestions: tuple[Suggestion, ...]
    rmse_v: float

    @property
    def words(self) -> str:
        """What would lower the error, in a sentence."""
        return in_words(self.suggestions, self.rmse_v)

    def to_dict(self) -> dict[str, Any]:
        return {
            "profiles": {each.name: each.to_dict() for each in self.profiles},
            "bootstrap": self.bootstrap.to_dict(),
            "suggestions": [each.to_dict() for each in self.suggestions],
            "words": self.words,
        }


def examine(refinement: Refinement, assessment: Assessment, *, key: Key[Array, ""]) -> Examination:
    """The examination of a cross-checked answer: some hundred fits, and two or three programs to
    compile for circuits with one part more. `key` decides what the bootstrap draws.
    """
    refit = Refit(refinement.search.problem)
    names = [each.name for each in assessment.uncertainty.estimates if each.relative_error]
    return Examination(
        profiles=tuple(
            profile(refinement, name, assessment=assessment, refit=refit) for name in names
        ),
        bootstrap=bootstrap(refinement, key=key, assessment=assessment, refit=refit),
        suggestions=suggestions(refinement, refit=refit),
        rmse_v=refinement.rmse_v,
    )
