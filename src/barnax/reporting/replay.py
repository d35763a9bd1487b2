"""A replay by a Kalman filter in words: its report and its screen."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from .document import Entries, Page, Paragraph, Picture, screen
from .wording import blocks, document, sentences, wording

if TYPE_CHECKING:
    from ..replay import SocReplay


def replay_document(replay: "SocReplay", illustrations: Iterable[Picture] = ()) -> Page:
    """The whole report of a replay."""
    facts = {"replay": replay, "verdict": sentences("replay.verdict", replay)}
    return document("replayed", illustrations, **facts)


def soc_screen(replay: "SocReplay") -> Page:
    """The replay, its scenarios, the estimated parameters, and the innovations."""
    about = [wording("replay.record", replay, "   "), wording("replay.filter", replay)]
    lines = Entries(sentences("replay.verdict", replay))
    return screen(map(Paragraph, about), blocks("replay.errors", replay, True), [lines])
