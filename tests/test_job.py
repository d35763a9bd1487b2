"""A job: what was chosen, what replaces what, and what is refused."""

import inspect
from dataclasses import replace

import pytest

import barnax
from barnax import InputError, Job, Reading, Settings, TableSettings


def test_what_is_given_by_name_replaces_what_an_object_holds():
    settings = Settings(model="esc", seeds=2)
    # A default that is given is chosen too.
    job = Job("a.csv", settings=settings, seeds=30, reading=Reading(series=96))
    assert (job.model, job.seeds, job.series, job.records) == ("esc", 30, 96, "a.csv")
    assert {"model", "seeds", "series", "records"} <= job.chosen.keys()
    assert "method" not in job.chosen
    assert job.part(Settings) == replace(settings, seeds=30)


def test_tables_may_have_separate_bounds():
    own = TableSettings(folds=0, bounds={"tau1 [s]": (2.0, 20.0)})
    job = Job("a.csv", over="soc", tables=own, nodes=(0.2, 0.8))
    assert job.table_settings == replace(own, nodes=(0.2, 0.8))
    assert job.bounds is None


@pytest.mark.parametrize("function", [barnax.identify, barnax.hppc])
def test_every_option_is_a_keyword_that_an_editor_and_the_help_know(function):
    known = inspect.signature(function).parameters
    assert known["seeds"].default == 30
    assert {"model", "series", "nodes", "ocv_fit", "window", "trust"} <= known.keys()
    assert "nodes: States of charge at which tables have a value" in function.__doc__


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"ocv_fitt": "polynomial"}, r"there is no option ocv_fitt; did you mean ocv_fit\?"),
        ({"xyz": 1}, "no option xyz; there are model, method"),
        ({"initial_soc": 1.0}, r"give window=barnax.Window\(initial_soc=...\)"),
    ],
)
def test_a_wrong_keyword_fails_at_once_with_what_was_meant(options, told):
    with pytest.raises(TypeError, match=told):
        barnax.identify("nowhere.csv", **options)


@pytest.mark.parametrize(
    ("name", "choices"),
    [("hysteresis_fit", ""), ("current_hold", ""), ("setup", ""), ("over", "soc, 'soc,temp")],
)
def test_a_value_that_is_no_choice_is_refused_with_those_there_are(name, choices):
    with pytest.raises(InputError, match=f"`{name}` 'magic' is not known; there are {choices}"):
        Job(**{name: "magic"})


def test_a_value_that_is_no_number_is_refused_with_its_option_and_what_to_give():
    for option, value, kind in (("capacity", "x", "number"), ("seeds", 1.5, "whole number")):
        with pytest.raises(InputError, match=f"`{option}` {value!r} is not a {kind}; give one"):
            Job(**{option: value})
    with pytest.raises(InputError, match="`start_time` '5 s' is not a number; give one"):
        barnax.Window(start_time_s="5 s")
