"""The tables over SOC that designs are made for."""

import pytest

import barnax


@pytest.fixture(scope="session")
def result():
    """The bundled cell with its whole OCV, as fast as its tables are fitted."""
    options = {"max_boxes": 0, "folds": 0, "resistances_follow": "none"}
    return barnax.identify(over="soc", model="so-rc", seeds=0, trust="none", **options)
