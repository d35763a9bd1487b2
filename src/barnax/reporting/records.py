"""Records in words: a replay by a Kalman filter, the checks of a file, the fit of kept factors."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from .document import Document, Lines, Paragraph, Picture, screen
from .wording import blocks, document, sentences, wording

if TYPE_CHECKING:
    from ..checks import FileCheck
    from ..over_soc.fit import TableFit
    from ..over_soc.kept import Kept
    from ..replay import SocReplay


def replay_document(replay: "SocReplay", illustrations: Iterable[Picture] = ()) -> Document:
    """The whole report of a replay."""
    facts = {"replay": replay, "verdict": sentences("replay.verdict", replay)}
    return document("replayed", illustrations, **facts)


def soc_screen(replay: "SocReplay") -> Document:
    """The replay, its scenarios, the estimated parameters, and the innovations."""
    about = [wording("replay.record", replay, "   "), wording("replay.filter", replay)]
    lines = Lines(sentences("replay.verdict", replay))
    return screen(map(Paragraph, about), blocks("replay.errors", replay, True), [lines])


def check_document(check: "FileCheck") -> Document:
    """The file's contents, the findings, and the roles that it can serve in."""
    return document("check", check=check)


def kept_document(kept: "Sequence[Kept]", fit: "TableFit") -> Document:
    """The fit of some kept records together."""
    return document("kept", kept=kept, fit=fit)
