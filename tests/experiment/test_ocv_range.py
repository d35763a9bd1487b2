"""A test after records that show only a part of the state of charge: where it stays, how the cell
is brought there, and that the true cell keeps the limits."""

import ast
from dataclasses import replace

import numpy as np
import pytest

import barnax
from barnax import InputError, bundled_file, read_record
from barnax.cell.curves import InterpolatedCurve
from barnax.experiment.prior import prior_of
from barnax.experiment.protocol import sampled
from barnax.reporting.design import planned_screen
from barnax.reporting.design_forms import procedure, pybamm_script
from barnax.reporting.wording import wording
from helpers.designs import BLOCKS, quick_design
from helpers.report_reader import screen_of

QUICK = {"over": "soc", "model": "so-rc", "seeds": 0, "max_boxes": 0, "folds": 0}
LIMITS = {"max_hours": 1.5, "blocks": BLOCKS, "max_discharge": 1.0, "max_charge": 1.0}


def part_of(name: str, high: float, low: float) -> dict[str, np.ndarray]:
    """A piece of a bundled drive cycle, from one SOC to another of 2 Ah."""
    record = read_record(bundled_file(name))
    soc = 1 - (record.discharged_ah - record.discharged_ah[0]) / 2.0
    first, last = int(np.argmax(soc < high)), int(np.argmax(soc < low))
    cut = slice(first, last)
    return {
        "Time [s]": record.time_s[cut] - record.time_s[first],
        "Current [A]": record.current_a[cut],
        "Voltage [V]": record.voltage_v[cut],
    }


def identified(name: str = "identification", low: float = 0.2, **known):
    quick = {**QUICK, "trust": "none", "resistances_follow": "none"}
    return barnax.identify(part_of(name, 0.6, low), **quick, **known)


@pytest.fixture(scope="module")
def placed():
    """What the piece tells where its place on the axis of SOC is given."""
    return identified(window=barnax.Window(initial_soc=0.6), capacity=2.0)


@pytest.fixture(scope="module")
def prior(placed):
    return prior_of(placed, None)


@pytest.fixture(scope="module")
def unplaced():
    return identified()


@pytest.fixture(scope="module")
def sized():
    """Its capacity is given, and not where it began."""
    return identified(capacity=2.0)


def require_limits(result, design, initial_soc, abs_v=0.05):
    """The true cell stays within the voltages of a test until it is emptied, and its lowest one is
    about as predicted."""
    steps = [step for step in design.steps if step.block not in ("to empty", "last rest")]
    current_a = sampled(steps)
    profile = {"Time [s]": np.arange(float(len(current_a))), "Current [A]": current_a}
    simulated = result.simulate(profile, initial_soc=initial_soc)
    voltage_v = np.asarray(simulated["Voltage [V]"])
    assert design.limits.low_v < voltage_v.min() < voltage_v.max() < design.limits.high_v
    if not any(step.block == "to empty" for step in design.steps):
        assert voltage_v.min() == pytest.approx(design.predicted.voltage_v.min(), abs=abs_v)


def test_a_test_stays_where_the_ocv_was_identified(prior, result):
    design = quick_design(prior, **LIMITS)
    low, high = prior.ocv_soc
    assert (low, high) == pytest.approx((0.2, 0.65), abs=0.01)
    assert design.initial_soc == high
    assert low <= design.predicted.soc.min() < low + 0.1
    assert design.predicted.soc.max() <= high
    assert {width.soc for width in design.of_table("R0")} == {0.3, 0.4, 0.5, 0.6}
    before = wording("design.before", design)
    assert f"discharge {2 * (1 - high):.4g} Ah at 0.4 A (C/5)" in before
    assert before in procedure(design)
    assert before in (ast.get_docstring(ast.parse(pybamm_script(design))) or "")
    require_limits(result, design, high)
    assert "OCV from 20 to 65 %" in screen_of(planned_screen(prior))


@pytest.fixture(scope="module")
def joined(placed):
    return prior_of(placed, None, "nmc")


def test_beyond_what_the_record_showed_the_ocv_is_that_of_the_chemistry(joined, prior):
    soc = np.array([0.0, 0.1, 0.3, 0.6, 0.8, 1.0])
    np.testing.assert_allclose(joined.ocv_v(soc[2:4]), prior.ocv_v(soc[2:4]), atol=1e-3)
    typical_v = prior_of(None, 2.0, "nmc").ocv_v(soc)
    np.testing.assert_allclose(joined.ocv_v(soc[[0, -1]]), typical_v[[0, -1]], atol=1e-6)
    assert np.all(np.diff(joined.ocv_v(np.linspace(0, 1, 501))) >= 0)
    reach_v = joined.ocv_end_v(soc, 1) - joined.ocv_v(soc)
    assert reach_v[4] == pytest.approx(reach_v[3] + 0.05)
    assert "the OCV of a typical NMC cell is joined" in screen_of(planned_screen(joined))


@pytest.mark.slow
def test_a_chemistry_takes_it_from_full_to_empty(joined, result):
    design = barnax.design(joined, **LIMITS)
    assert design.initial_soc == 1.0
    assert any(step.block == "to empty" for step in design.steps)
    require_limits(result, design, 1.0)


def test_another_chemistry_than_the_record_shows_is_refused(placed):
    with pytest.raises(InputError, match=r"`chemistry` lfp: at 65 % SOC .* 3\.27 V, .* 3\.86"):
        prior_of(placed, None, "lfp")


@pytest.mark.slow
def test_where_nothing_shows_what_is_full_the_voltage_brings_the_cell_to_its_start(
    unplaced, result
):
    design = barnax.design(unplaced, **LIMITS)
    # The fullest point is 65 % of the true cell.
    true_v = float(result.cell.average_ocv_v(np.array([0.65]))[0])
    assert design.start_v == pytest.approx(true_v, abs=0.02)
    assert not any(step.block == "to empty" for step in design.steps)
    assert f"to {design.start_v:.3f} V, hold until 0.018" in wording("design.before", design)
    require_limits(result, design, 0.65)


@pytest.mark.parametrize("name", [pytest.param("unplaced", marks=pytest.mark.slow), "sized"])
def test_no_typical_ocv_is_joined_where_nothing_shows_what_is_full(name, request):
    with pytest.raises(InputError, match=r"`chemistry` nmc: nothing shows .* full"):
        prior_of(request.getfixturevalue(name), None, "nmc")


@pytest.mark.slow
def test_a_capacity_alone_leaves_the_test_within_the_record(sized, result):
    """Of the 2 Ah of the true cell, its record began at 60 % and its fullest point is 65 %."""
    prior = prior_of(sized, None)
    design = barnax.design(prior, **LIMITS)
    taken_ah = 2.0 * (design.initial_soc - design.predicted.soc.min())
    held_ah = 2.0 * result.cell.soc_from_rest_voltage(design.start_v)
    assert taken_ah < held_ah - 2.0 * 0.2 + 0.03
    require_limits(result, design, held_ah / 2.0, abs_v=0.2)


def test_a_chemistry_whose_highest_voltage_the_cell_passes_is_refused():
    """A full cell at 4.33 V: near a typical one at 4.18 V, and above the 4.2 V that it stops at."""
    prior = prior_of(None, 2.0, "nmc")
    rising = InterpolatedCurve.fit(np.array([0.0, 1.0]), np.array([2.7, 4.33]))
    cell = replace(prior.cell, charge=rising, discharge=rising)
    with pytest.raises(InputError, match=r"at 100 % SOC .* 4\.18 V, and this one 4\.33 V"):
        prior_of(replace(prior, cell=cell, typical=""), None, "nmc")


@pytest.mark.parametrize(
    ("ocv_soc", "high_v", "words"),
    [
        # Full is where a charge to 4.18 V ends, which no OCV of up to 4.23 V changes.
        ((0.0, 1.0), 4.18, None),
        ((0.0, 1.0), 4.1, r"4\.1 V: the test starts at 100 % SOC, where the OCV is 4\.179 V"),
        # Elsewhere the charge that was taken out brings a cell there, whatever its OCV is.
        ((0.0, 0.9), 4.15, None),
        ((0.0, 0.9), 4.1, r"4\.1 V: the test starts at 90 % SOC, where the OCV may be 4\.133 V"),
    ],
)
def test_a_start_above_the_highest_voltage_is_refused(ocv_soc, high_v, words):
    prior = replace(prior_of(None, 2.0, "nmc"), ocv_soc=ocv_soc, typical="")
    # Refused for its hours: the start was let through.
    with pytest.raises(InputError, match=words or "`max_hours` 0.5") as refused:
        barnax.design(prior, high_voltage=high_v, max_hours=0.5, blocks=BLOCKS)
    assert ("`high_voltage`" in str(refused.value)) is (words is not None)


@pytest.mark.slow
def test_another_capacity_would_stretch_an_ocv_that_the_record_showed(unplaced):
    with pytest.raises(InputError, match=r"the OCV was identified over 0\.90.* would be stretched"):
        barnax.design(unplaced, capacity=2.0)


@pytest.mark.slow
def test_a_flat_ocv_brings_no_cell_to_its_start():
    flat = identified("lfp_identification", low=0.4)
    with pytest.raises(InputError, match="too flat to bring it there"):
        barnax.design(flat)


def test_a_part_of_the_charge_without_a_node_is_refused():
    prior = prior_of(None, 2.0, "nmc")
    nodes = (0.0, 0.4, 0.9, 1.0)
    settings = replace(prior.settings, nodes=nodes)
    coarse = replace(prior, settings=settings, ocv_soc=(0.4, 0.8), typical="")
    with pytest.raises(InputError, match="`want` R0, R1, R2: no node lies from 43 to 80 % SOC"):
        barnax.design(coarse, max_hours=1.5, blocks=BLOCKS)


@pytest.mark.slow
def test_hours_that_are_too_few_are_refused_with_the_least():
    with pytest.raises(InputError, match=r"`max_hours` 0\.5: .* takes .* h without rests") as error:
        barnax.design(capacity=2.0, max_hours=0.5, blocks=BLOCKS)
    least = float(str(error.value).split(" h without rests")[0].split()[-1])
    with pytest.raises(InputError, match="without rests"):
        barnax.design(capacity=2.0, max_hours=least - 0.02, blocks=BLOCKS)
    assert least - 0.02 < barnax.design(capacity=2.0, max_hours=least, blocks=BLOCKS).hours <= least
