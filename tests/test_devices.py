"""Where JAX computes for the command line and a fleet's processes."""

import os
import sys

import pytest

from barnax import devices


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A process that has not loaded JAX and whose environment does not say where it computes."""
    for name in devices.VARIABLES:
        # Set first: what is set afterwards is put back too.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    monkeypatch.delitem(sys.modules, "jax")
    return monkeypatch


def test_without_a_word_it_is_the_cpu(fresh):
    devices.prefer_cpu()
    assert devices.given_platforms() == {"JAX_PLATFORMS": "cpu"}


@pytest.mark.parametrize("name", devices.VARIABLES)
@pytest.mark.parametrize("value", ["cuda", ""])
def test_what_the_environment_says_stays(fresh, name, value):
    fresh.setenv(name, value)
    devices.prefer_cpu()
    assert devices.given_platforms() == {name: value}


def test_a_process_that_has_loaded_jax_is_left_alone(fresh):
    fresh.setitem(sys.modules, "jax", os)
    devices.prefer_cpu()
    assert devices.given_platforms() == {}
