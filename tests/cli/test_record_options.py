"""Options of a record: for all, or for one by its name."""

import pytest

from barnax.cli.options import RecordOptions
from barnax.errors import InputError
from barnax.model.window import Window


def test_a_record_s_own_start_replaces_the_common_one():
    options = RecordOptions(
        start_time=["60"], initial_soc=["0.9"], start_after_step=["b.csv=3"], score_to=["900"]
    )
    assert options.windows() == {
        "": Window(start_time_s=60.0, initial_soc=0.9, score_to_s=900.0),
        "b.csv": Window(start_after_step=3, initial_soc=0.9, score_to_s=900.0),
    }


def test_what_contradicts_itself_is_refused_by_the_name_of_its_record():
    options = RecordOptions(start_time=["b.csv=60"], start_after_step=["b.csv=3"])
    with pytest.raises(InputError, match=r"^b\.csv: give `start_time` or `start_after_step`"):
        options.windows()
