"""A record is told again whatever was done to its file, and a test that was repeated is another."""

import numpy as np
import pytest

from barnax.bundled import BUNDLED
from barnax.records import read_record, record_from_frame
from barnax.records.fingerprint import Content, read_fingerprint
from barnax.records.lag import aligned
from helpers.records import logged, pulses_a, simulated_cell


def recorded(time_s, current_a, voltage_v):
    return record_from_frame(logged(time_s, -current_a, voltage_v))


four_digits = np.vectorize(lambda value: float(f"{value:.4g}"))


def interpolated(interval_s):
    def resample(t, i, v):
        grid_s = np.arange(t[0], t[-1], interval_s)
        return grid_s, np.interp(grid_s, t, i), np.interp(grid_s, t, v)

    return resample


COPIES = {
    "in other units": lambda t, i, v: (t / 3600 * 3600, i * 1e3 / 1e3, v * 1e3 / 1e3),
    "rounded": lambda t, i, v: (t, np.round(i, 2), np.round(v, 2)),
    "of four digits": lambda t, i, v: (t, four_digits(i), four_digits(v)),
    "of another clock": lambda t, i, v: (t + 1.7e9, i, v),
    "its first 90 %": lambda t, i, v: (t[:17700], i[:17700], v[:17700]),
    "its middle from zero": lambda t, i, v: (t[5000:15000] - 5000, i[5000:15000], v[5000:15000]),
    "every third sample": lambda t, i, v: (t[1::3], i[1::3], v[1::3]),
    "interpolated to more": interpolated(0.4),
}


@pytest.fixture(scope="module")
def record():
    return read_record(BUNDLED.record)


# The current of a record is moved to the moments of its voltages, and of a thinned copy is not.
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.4])
@pytest.mark.parametrize("copy", COPIES)
def test_a_copy_is_recognized_by_its_samples_and_by_what_is_stored_of_them(record, copy, lag_s):
    values = COPIES[copy](record.time_s, record.current_a, record.voltage_v)
    own, other = Content(aligned(record, lag_s)), Content(recorded(*values))
    assert own.is_like(other)
    assert other.holds(own.fingerprint)


@pytest.mark.parametrize(("noise_v", "places"), [(2e-4, 4), (1e-3, 3), (1e-3, 2)])
@pytest.mark.parametrize("r0", [0.05, 0.0505])
@pytest.mark.parametrize("lag_s", [0.0, 0.02])
def test_the_same_current_again_or_on_another_cell_is_another_record(noise_v, places, r0, lag_s):
    current_a, rng = pulses_a(6000), np.random.default_rng(0)
    voltages_v = (
        simulated_cell(current_a, r0=ohm) + rng.normal(0, noise_v, 6000) for ohm in (0.05, r0)
    )
    one, other = (
        Content(aligned(recorded(np.arange(6000.0), current_a, np.round(voltage_v, places)), lag_s))
        for voltage_v in voltages_v
    )
    assert not one.is_like(other)
    assert not one.holds(other.fingerprint)
    assert not other.holds(one.fingerprint)


def test_a_part_overlaps_with_the_whole_and_not_with_what_follows_it(record):
    cut = (slice(0, 9000), slice(5000, 14000), slice(9000, None))
    first, middle, last = (
        Content(recorded(record.time_s[part], record.current_a[part], record.voltage_v[part]))
        for part in cut
    )
    assert first.is_like(middle)
    assert middle.is_like(last)
    assert not first.is_like(last)


@pytest.mark.parametrize("text", ["0 1", "0;1 2 3", "0 1;1 2", "0 1;a b c"])
def test_what_is_no_fingerprint_is_refused(text):
    with pytest.raises(ValueError, match=r"holds samples|unpack|reshape|could not convert"):
        read_fingerprint(text)
