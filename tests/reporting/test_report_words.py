"""The examples in the report's modules hold, and its words for edge cases."""

import doctest
import importlib

import pytest

from barnax.reporting.words import fixed, joined, millivolt, percent


@pytest.mark.parametrize("module", ["render", "words"])
def test_the_examples_in_the_docstrings_hold(module):
    found = doctest.testmod(importlib.import_module(f"barnax.reporting.{module}"))
    assert found.failed == 0
    assert found.attempted > 0


@pytest.mark.parametrize(
    ("items", "said"),
    [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (list("abc"), "a, b and c")],
)
def test_items_are_joined_as_in_a_sentence(items, said):
    assert joined(items) == said


@pytest.mark.parametrize(
    ("ratio", "said"), [(0.0, "0 %"), (0.996, "100 %"), (0.1234, "12 %"), (0.00123, "0.12 %")]
)
def test_a_percentage_has_no_exponent_where_none_is_needed(ratio, said):
    assert percent(ratio) == said


def test_no_voltage_and_no_number_have_their_words():
    assert millivolt(0.0) == "0.00 mV"
    assert fixed(None, 3) == "–"
