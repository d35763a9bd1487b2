"""The check of an export against barnax's own simulation."""

import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest

from barnax.errors import InputError
from barnax.export import EXPORTERS, HeldLoad, require_package, verify
from barnax.export.tables import TOLERANCE_V, tables_of
from barnax.export.verification import _turns, simulate_here
from helpers.results import make_result, make_table_result

SHORT = HeldLoad(1.0 * np.arange(200), np.where(np.arange(200) % 40 < 20, 2.0, -1.0))
# Nearly to empty, beyond nodes that end before.
DISCHARGE = HeldLoad(5.0 * np.arange(620), np.full(620, 2.0))


def faked(result, error_v):
    """An exporter into a package that is surely installed and errs as it is told."""

    def simulate(content, profile):
        return simulate_here(result, profile) + error_v

    return replace(EXPORTERS["csv"], package="numpy", simulate=simulate)


def test_the_largest_difference_counts_whatever_its_sign():
    result, error_v = make_result("so-rc"), np.zeros(200)
    error_v[[20, 90]] = 1e-3, -4e-3
    actual = verify(result, faked(result, error_v), b"", SHORT)
    assert actual.largest_v == pytest.approx(4e-3)
    assert actual.rms_v == pytest.approx(math.sqrt((1e-3**2 + 4e-3**2) / 200))
    assert (actual.package, actual.samples) == ("numpy", 200)


def test_a_simulation_that_ends_early_never_passes_for_agreement():
    result = make_result("so-rc")
    actual = verify(result, faked(result, np.where(np.arange(200) < 150, 0.0, np.nan)), b"", SHORT)
    assert (actual.largest_v, actual.rms_v) == (math.inf, math.inf)


@pytest.mark.parametrize(("starts_within", "is_alike"), [(True, True), (False, False)])
def test_both_sides_start_full_where_a_package_starts_nothing_beyond(starts_within, is_alike):
    result = make_result("so-rc")
    # By as much as counted charge may put a start beyond full.
    (part, *others) = result.inputs
    start = replace(part.start, soc=1.0013)
    fuller = result.model_copy(
        update={"inputs": (part.model_copy(update={"start": start}), *others)}
    )

    def simulate(content, profile):
        return simulate_here(fuller, profile, 1.0)

    exporter = replace(
        EXPORTERS["csv"], package="numpy", simulate=simulate, starts_within=starts_within
    )
    discharge = HeldLoad(5.0 * np.arange(200), np.full(200, 1.0))
    assert (verify(fuller, exporter, b"", discharge).largest_v < 1e-9) == is_alike


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("circuit", ["iso-rc", "esc"])
def test_both_sides_start_in_the_direction_the_identification_started_in(circuit, direction):
    result = make_result(circuit, initial_direction=direction)
    # Less than the rest current turns nothing.
    resting = HeldLoad(1.0 * np.arange(200), np.tile([0.03, -0.03], 100))
    found_v = simulate_here(result, resting)
    start_v = tables_of(result).initial_hysteresis_v
    assert start_v * direction > 5e-3
    away_v = found_v - simulate_here(make_result("so-rc"), resting)
    np.testing.assert_allclose(away_v, start_v, atol=1e-5)


def test_the_current_turns_where_it_flows_the_other_way_than_it_last_did():
    profile = HeldLoad(np.arange(6.0), np.array([0.0, 1.0, 0.0, 1.0, -1.0, 0.0]))
    assert np.flatnonzero(_turns(profile, 1)).tolist() == [1, 4]
    assert np.flatnonzero(_turns(profile, -1)).tolist() == [4]


def test_a_missing_package_is_named_with_how_to_get_it():
    missing = replace(EXPORTERS["pybamm"], package="no_such_package")
    with pytest.raises(InputError, match=r"no_such_package.*pip install 'barnax\[verify\]'"):
        require_package(missing)


# What other packages warn of when they are imported is theirs.
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["pybamm", "thevenin"])
@pytest.mark.parametrize(
    ("result", "profile"),
    [
        (make_result("so-rc"), SHORT),
        (make_result("3rc", capacity_ah=1.5), SHORT),
        (make_table_result(kept=slice(2, 6)), DISCHARGE),
        (make_table_result(kept=slice(4, 5)), DISCHARGE),
    ],
    ids=["so-rc", "3rc of its own capacity", "nodes from 0.1 to 0.8", "one node"],
)
def test_a_circuit_without_hysteresis_is_the_same_in_the_package(
    name, result, profile, monkeypatch
):
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed; it is in the extra verify")
    monkeypatch.setenv("PYBAMM_DISABLE_TELEMETRY", "true")
    exporter = EXPORTERS[name]
    actual = verify(result, exporter, exporter.write(result).content, profile)
    assert actual.largest_v < 1.5 * TOLERANCE_V
