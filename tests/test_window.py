import numpy as np
import pytest

from barnax.errors import InputError
from barnax.model.inputs import Window, first_sample, initial_soc, scored_samples, soc_along
from reference import make_record

TIME_S = 100.0 + np.arange(20) * 10.0
STEP = np.repeat([1, 2, 3, 2], 5)
CURRENT_A = np.repeat([0.0, 1.0, 0.0, -2.0], 5)


def record_with(**changes):
    return make_record(TIME_S, CURRENT_A, **({"step": STEP} | changes))


def test_a_simulation_starts_with_the_record_by_default():
    assert first_sample(record_with(), Window()) == 0


def test_a_start_time_is_on_the_files_own_clock():
    assert first_sample(record_with(), Window(start_time_s=125.0)) == 3


def test_a_start_after_a_step_is_the_last_sample_of_its_last_block():
    assert first_sample(record_with(), Window(start_after_step=2)) == 19
    assert first_sample(record_with(), Window(start_after_step=1)) == 4


def test_every_sample_is_scored_by_default():
    assert scored_samples(record_with(), Window(), 0).all()


def test_no_sample_before_the_start_is_scored():
    scored = scored_samples(record_with(), Window(), 7)
    assert np.flatnonzero(scored).tolist() == list(range(7, 20))


def test_scored_steps_and_times_must_both_hold():
    window = Window(score_steps=(2, 3), score_from_s=160.0, score_to_s=250.0)
    scored = scored_samples(record_with(), window, 0)
    assert np.flatnonzero(scored).tolist() == list(range(6, 16))


def test_the_ends_of_the_scored_times_are_inside():
    scored = scored_samples(record_with(), Window(score_from_s=110.0, score_to_s=130.0), 0)
    assert np.flatnonzero(scored).tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start_time_s": 1.0, "start_after_step": 2}, "--start-time or --start-after-step, not"),
        ({"initial_soc": 80.0}, r"--initial-soc 80.0 is not a fraction.* 0 \(empty\) to 1 \(full"),
        ({"initial_soc": float("nan")}, "--initial-soc nan is not a fraction"),
        ({"initial_direction": 0}, r"--initial-direction 0 is neither \+1 .* nor -1"),
        ({"rest_current_a": 0.0}, r"--rest-current 0.0 A must be positive"),
        ({"rest_current_a": float("nan")}, r"--rest-current nan A must be positive"),
        (
            {"score_from_s": 20.0, "score_to_s": 10.0},
            r"--score-to 10.0 s must come after --score-from 20.0 s",
        ),
    ],
)
def test_a_window_that_cannot_be_is_refused_with_the_option_and_its_value(options, message):
    with pytest.raises(InputError, match=message):
        Window(**options)


@pytest.mark.parametrize("start_s", [99.0, 291.0])
def test_a_start_outside_the_record_is_refused_with_its_clock(start_s):
    with pytest.raises(InputError, match=rf"made.csv: --start-time {start_s} s .* from 100 to 290"):
        first_sample(record_with(), Window(start_time_s=start_s))


def test_a_start_after_a_step_that_is_not_there_is_refused_with_the_steps_that_are():
    with pytest.raises(InputError, match=r"made.csv: there is no step 9; .* steps 1, 2, 3"):
        first_sample(record_with(), Window(start_after_step=9))


def test_a_scored_step_that_is_not_there_is_refused_with_the_steps_that_are():
    with pytest.raises(InputError, match=r"made.csv: there is no step 8; .* steps 1, 2, 3"):
        scored_samples(record_with(), Window(score_steps=(3, 8)), 0)


def test_a_start_after_a_step_without_a_step_column_names_the_other_way():
    with pytest.raises(InputError, match=r"made.csv: --start-after-step needs .* --start-time"):
        first_sample(record_with(step=None), Window(start_after_step=1))


def test_scored_steps_without_a_step_column_name_the_other_way():
    with pytest.raises(InputError, match=r"made.csv: --score-steps needs .* --score-from"):
        scored_samples(record_with(step=None), Window(score_steps=(1,)), 0)


def test_a_window_without_scored_samples_is_refused_with_the_start_and_the_remedy():
    with pytest.raises(InputError, match=r"made.csv: no sample .* 170 s; widen --score-steps"):
        scored_samples(record_with(), Window(score_to_s=150.0), 7)


def test_a_given_state_of_charge_is_taken(bundled_cell):
    window = Window(initial_soc=0.4)
    assert initial_soc(record_with(), bundled_cell, window, 5, 0.02, 1) == (0.4, "given")


@pytest.mark.parametrize("direction", [1, -1])
def test_a_rested_voltage_is_read_on_the_branch_of_the_last_direction(bundled_cell, direction):
    branch = bundled_cell.charge if direction == 1 else bundled_cell.discharge
    record = record_with(voltage_v=float(branch(np.array(0.6))))
    soc, reason = initial_soc(record, bundled_cell, Window(), 2, 0.02, direction)
    assert soc == pytest.approx(0.6, abs=1e-4)
    assert "rested voltage" in reason
    assert "row 4" in reason


def test_a_start_under_load_asks_for_the_state_of_charge(bundled_cell):
    with pytest.raises(InputError, match=r"made.csv: .* row 7 under \+1 A .* give --initial-soc"):
        initial_soc(record_with(), bundled_cell, Window(), 5, 0.02, 1)


def test_a_rested_voltage_outside_the_curve_asks_for_the_state_of_charge(bundled_cell):
    with pytest.raises(InputError, match=r"made.csv: row 2: .* 5\.0000 V .* --initial-soc"):
        initial_soc(record_with(voltage_v=5.0), bundled_cell, Window(), 0, 0.02, 1)


@pytest.mark.parametrize(
    ("hold", "expected_ah"),
    [
        # 50 s at 1 A after samples 5 to 9, or before them; from sample 3 on nothing before counts.
        ("forward", 50 / 3600),
        ("backward", 50 / 3600),
    ],
)
def test_the_state_of_charge_falls_by_the_ampere_hours_taken(hold, expected_ah):
    soc = soc_along(record_with(hold=hold), 2.0, 3, 0.9)
    assert soc[3] == 0.9
    assert soc[14] == pytest.approx(0.9 - expected_ah / 2.0, rel=1e-12)


@pytest.mark.parametrize(("hold", "sample"), [("forward", 5), ("backward", 4)])
def test_the_hold_says_when_the_ampere_hours_begin(hold, sample):
    soc = soc_along(record_with(hold=hold), 2.0, 0, 1.0)
    assert soc[sample] == 1.0
    assert soc[sample + 1] == pytest.approx(1.0 - 10 / 3600 / 2.0, rel=1e-12)


def test_a_charge_raises_the_state_of_charge():
    soc = soc_along(record_with(), 2.0, 0, 0.5)
    assert soc[19] - soc[15] == pytest.approx(4 * 10 * 2 / 3600 / 2.0, rel=1e-9)


def test_a_start_after_a_short_rest_asks_for_the_state_of_charge(bundled_cell):
    current_a = np.array([1.0, 1.0, *[0.0] * 8])
    record = make_record(np.arange(10.0), current_a)
    with pytest.raises(InputError, match=r"row 7, where.*has rested for 4 s only.*--initial-soc"):
        initial_soc(record, bundled_cell, Window(), 5, 0.02, -1)
