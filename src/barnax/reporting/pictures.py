"""Figures as the pictures of a document."""

from collections.abc import Iterable

from ..plots.illustration import Illustration
from .document import Picture


def picture(illustration: Illustration) -> Picture:
    """The smaller of both forms: PNG of what is dense, SVG of all else."""
    is_png = illustration.is_dense
    return Picture(
        name=illustration.name,
        caption=illustration.caption,
        alt=illustration.alt,
        media_type="image/png" if is_png else "image/svg+xml",
        content=illustration.png if is_png else illustration.svg,
    )


class Pictures:
    """The pictures of a report by their figures' names, to be put where they belong."""

    def __init__(self, illustrations: Iterable[Illustration]):
        self._pictures = {each.name: picture(each) for each in illustrations}

    def of(self, *names: str) -> tuple[Picture, ...]:
        """Those of the named pictures that there are, in this order."""
        return tuple(self._pictures[name] for name in names if name in self._pictures)

    def starting(self, beginning: str) -> tuple[Picture, ...]:
        """The pictures whose names begin so, in the order given."""
        return tuple(each for name, each in self._pictures.items() if name.startswith(beginning))
