"""Pages with pictures of few pixels, which take most of their time."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def coarse_pictures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("barnax.reporting.document.PICTURE_DPI", 40)
        yield
