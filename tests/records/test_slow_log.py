"""What the rows of a slow log are, told by what its load does between them."""

import numpy as np
import pytest

from barnax.checks import check_file
from barnax.records import record_from_frame, source_from_frame
from helpers.records import CURRENT, logged, simulated_cell

EVERY = 10
CELL = {"r0": 0.05, "capacity_ah": 2.5, "soc": 1.0, "pairs": ((0.025, 17.0), (0.03, 150.0))}


def drive(seed):
    """A load of accelerations, cruises, brakes and stops at 1 s."""
    rng = np.random.default_rng(seed)
    pieces, seconds = [], 0
    while seconds < 11_000:
        up, cruise, down, stop = rng.integers([4, 5, 3, 2], [15, 60, 12, 25])
        wave = 1 + 0.4 * rng.standard_normal(cruise // 4 + 1).repeat(4)[:cruise]
        pieces += [
            np.linspace(0.5, rng.uniform(1.5, 4.0), up),
            rng.uniform(0.2, 1.2) * wave,
            -rng.uniform(0.5, 2.0) * np.linspace(1, 0.2, down),
            np.zeros(stop),
        ]
        seconds += up + cruise + down + stop
    return np.concatenate(pieces)


def log(seed, rows, every=EVERY, step_v=0.0):
    """What a logger writes of it: instants or means, with noise and steps of the reading."""
    current_a = drive(seed)
    voltage_v = simulated_cell(current_a, **CELL)
    count = len(current_a) // every
    parts = [each[: count * every].reshape(count, every) for each in (current_a, voltage_v)]
    amps, volts = (each[:, 0] if rows == "instants" else each.mean(axis=1) for each in parts)
    rng = np.random.default_rng(seed)
    volts = volts + 1e-3 * rng.standard_normal(count)
    volts = step_v * np.round(volts / step_v) if step_v else volts
    amps = amps + 2e-3 * rng.standard_normal(count)
    return logged(float(every) * np.arange(count), -amps, volts)


@pytest.mark.parametrize("step_v", [pytest.param(0.0, marks=pytest.mark.slow), 0.005])
@pytest.mark.parametrize("rows", ["instants", "means"])
def test_rows_of_instants_and_means_are_distinguished(rows, step_v):
    records = [record_from_frame(log(seed, rows, step_v=step_v)) for seed in range(20)]
    told = [record.evidence.slow.kind for record in records]
    assert told.count(rows) >= 19
    assert "means" not in told if rows == "instants" else "instants" not in told


@pytest.mark.parametrize("rows", ["instants", "means"])
def test_a_check_tells_what_the_rows_are_and_what_that_does(rows):
    checked = check_file(source_from_frame(log(0, rows), "log"))
    (notice,) = [each for each in checked.findings if each.check == "fast load"]
    assert notice.severity == ("warning" if rows == "instants" else "note")
    assert notice.values["rows"] == rows
    assert checked.traits
    assert checked.traits.facts["current hold"] == "centered"


def calm(seed, in_time):
    """Instants 10 s apart of a load that stands still for 3 to 40 s, or for whole intervals."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(3, 41, 700)
    if in_time:
        lengths = EVERY * rng.integers(1, 5, 550)
    kind = rng.random(len(lengths))
    levels_a = np.select([kind < 0.2, kind < 0.35], [0.0, -1.0], 2.5) * rng.random(len(lengths))
    current_a = levels_a.repeat(lengths)
    current_a = current_a[: np.argmax(np.cumsum(current_a) > 0.9 * 3600 * 2.5)]
    amps, volts = current_a[::EVERY], simulated_cell(current_a, **CELL)[::EVERY]
    volts = volts + 1e-3 * rng.standard_normal(len(volts))
    return logged(float(EVERY) * np.arange(len(amps)), -amps, volts)


@pytest.mark.parametrize("in_time", [True, False])
def test_a_load_that_seldom_changes_between_rows_is_distinguished_from_one_in_time(in_time):
    holds = [record_from_frame(calm(seed, in_time)).hold.value for seed in range(20)]
    assert holds.count("forward" if in_time else "centered") >= 19


def test_a_centered_current_has_about_half_of_every_interval_on_either_side():
    table = log(0, "means")
    record = record_from_frame(table, current_hold="centered")
    amps = -table[CURRENT].to_numpy()
    halves_a = (amps[1:] + amps[:-1]) / 2
    assert np.max(np.abs(record.interval_current_a - halves_a)) < 0.05 * np.ptp(amps)
    assert record.discharged_ah[-1] == pytest.approx(np.sum(halves_a) * EVERY / 3600, rel=1e-3)
