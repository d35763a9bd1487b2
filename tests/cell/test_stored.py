"""What is read back from a file must be of its kind and no more than a cell can have."""

import pytest

from barnax.cell.stored import stored_number, stored_numbers, stored_texts
from barnax.errors import InputError


@pytest.mark.parametrize("value", [True, None, "1.0", float("nan"), float("inf"), 10**400, [1.0]])
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(InputError, match="'soc' of the stored point must hold finite numbers"):
        stored_number({"soc": value}, "soc", "point")


@pytest.mark.parametrize("value", [-10.0, 10.0])
def test_numbers_may_reach_the_largest_but_not_pass_it(value):
    assert stored_numbers({"soc": [0.5, value]}, "soc", "curve", 10.0) == (0.5, value)
    with pytest.raises(InputError, match=r"'soc' of the stored curve reaches 10\.01, beyond 10"):
        stored_numbers({"soc": [0.5, 1.001 * value]}, "soc", "curve", 10.0)


def test_no_numbers_are_as_good_as_any():
    assert stored_numbers({"soc": []}, "soc", "curve", 0.5) == ()


@pytest.mark.parametrize("value", ["a text", [1], ["a text", 1], None, {"a": "text"}])
def test_what_is_no_list_of_texts_is_refused(value):
    with pytest.raises(InputError, match="'warnings' of the stored cell must be a list of texts"):
        stored_texts({"warnings": value}, "warnings", "cell")
