"""What the other sampling of the current does to resistances, against a regression on one pair."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from barnax import TableSettings, Window, pack, read_record, record_from_frame
from barnax.bundled import BUNDLED
from barnax.cell import CircuitParameters, characterize
from barnax.cell.parameters import RATE
from barnax.fit.node_interval import NodeInterval
from barnax.fit.pack import PackCell, PackFit, Value
from barnax.fit.temperature_fits import TableFits
from barnax.identification import answer
from barnax.model.other_sampling import resampled_share, resampling, source_shift_ohm
from barnax.model.prepared import prepare_record
from barnax.model.reference import simulate_circuit
from helpers.problems import drive_a
from helpers.reference import filtered_response

INTERVAL_S, NODES, TAU_S = 5.0, (0.3, 0.6, 0.9), (4.0, 60.0)
ROWS = {"R0 [Ohm]": (0.05, 0.04, 0.06), "R1 [Ohm]": (0.02, 0.03, 0.015), "R2 [Ohm]": (0.03,) * 3}
SLOPE_V, CAPACITY_AH = 0.8, 2.0
# Of lines between nodes.
MEANS = {name: (row[0] + 2 * row[1] + row[2]) / 4 for name, row in ROWS.items()}
R0 = MEANS["R0 [Ohm]"]


@dataclass(frozen=True)
class Fit:
    """As much of a fit as sampling is concerned with."""

    intervals: tuple[NodeInterval, ...]
    means: tuple[NodeInterval, ...]
    tables: CircuitParameters

    def of_table(self, name):
        return [interval for interval in self.intervals if interval.name == name]


def made(hold):
    """Tables over three nodes and their record, as far as their sampling is concerned."""
    intervals = [
        NodeInterval(name, soc, ohm, 0.001, 0.0, ohm - 0.002, ohm + 0.002)
        for name, row in ROWS.items()
        for soc, ohm in zip(NODES, row, strict=True)
    ]
    intervals += [
        NodeInterval(f"tau{pair} [s]", None, tau, 0.1, 0.0, tau, tau)
        for pair, tau in enumerate(TAU_S, 1)
    ]
    r0, *pairs = ROWS.values()
    tables = CircuitParameters.over_soc(NODES, TAU_S, r0, tuple(pairs))
    record = SimpleNamespace(hold=SimpleNamespace(value=hold, strength="assumed"))
    cell = SimpleNamespace(average_ocv_v=lambda soc: 3 + SLOPE_V * soc)
    held_a = drive_a(400)
    passed = np.concatenate([[0.0], np.cumsum(held_a[:-1])]) * INTERVAL_S / 3600 / CAPACITY_AH
    prepared = SimpleNamespace(
        record=record,
        median_interval_s=INTERVAL_S,
        dense_interval_s=INTERVAL_S,
        cell=cell,
        time_s=INTERVAL_S * np.arange(len(held_a)),
        held_a=held_a,
        soc=0.9 - passed,
        hysteresis_amplitude_v=None,
        capacity_ah=CAPACITY_AH,
    )
    means = [
        NodeInterval(name, None, ohm, 0.001, 0.0, ohm - 0.002, ohm + 0.002)
        for name, ohm in MEANS.items()
    ]
    fits = TableFits((Fit(tuple(intervals), tuple(means), tables),))
    return fits, prepared, resampling([prepared], tables, MEANS)


def regressed(tau, hold, other):
    """R0 and R of a pair of 1 ohm that is sampled one way, where the other is taken for it."""
    current_a = drive_a(400)
    current_a[0] = 0.0
    answers = {way: filtered_response(INTERVAL_S, current_a, tau, way) for way in (hold, other)}
    columns = np.column_stack([current_a, answers[other]])
    fits, left, *_ = np.linalg.lstsq(columns, answers[hold])
    assert left[0] < 1e-20
    return fits


@pytest.mark.parametrize(("hold", "other"), [("forward", "backward"), ("backward", "forward")])
def test_the_other_sampling_moves_r0_and_the_pairs_as_a_regression_does(hold, other):
    _, _, change = made(hold)
    moved = [regressed(tau, hold, other) for tau in TAU_S]
    means = [MEANS[name] for name in ("R1 [Ohm]", "R2 [Ohm]")]
    shift_ohm = sum(ohm * r0 for ohm, (r0, _) in zip(means, moved, strict=True))
    # A current that flowed before its sample has already moved the OCV by one more interval.
    later = {"forward": -1, "backward": 1}[hold]
    shift_ohm += later * SLOPE_V * INTERVAL_S / (3600 * CAPACITY_AH)
    assert change.r0_ohm == pytest.approx(shift_ohm, rel=1e-9)
    shares = {name: r - 1 for name, (_, r) in zip(("R1 [Ohm]", "R2 [Ohm]"), moved, strict=True)}
    assert change.shares == pytest.approx(shares, rel=1e-9)


@pytest.mark.parametrize(("hold", "share"), [("forward", 8 / 9), ("backward", 9 / 8)])
def test_a_slow_log_counts_other_charge_with_the_other_sampling(hold, share):
    # 2 x 20 + 1 x 30 + 2 x 10 As, or 1 x 20 + 2 x 30.
    frame = {"Time [s]": [0, 20, 50, 60, 70], "Current [A]": [2.0, 1.0, 2.0, 0.0, 0.0]}
    record = record_from_frame(
        {**frame, "Voltage [V]": [4.0, 3.95, 3.8, 3.9, 3.9]}, current_hold=hold
    )
    assert resampled_share(SimpleNamespace(record=record, span=slice(5))) is None
    assumed = replace(record, hold=replace(record.hold, strength="assumed"))
    assert resampled_share(SimpleNamespace(record=assumed, span=slice(5))) == pytest.approx(share)
    # What is not simulated does not count: 1 x 30 + 2 x 10 As of the rest, or 2 x 30.
    after = resampled_share(SimpleNamespace(record=assumed, span=slice(1, 5)))
    assert after == pytest.approx(6 / 5 if hold == "forward" else 5 / 6)


@pytest.mark.parametrize(("hold", "other"), [("forward", "backward"), ("backward", "forward")])
@pytest.mark.parametrize("circuit", ["esc", "iso-rc"])
def test_what_an_interval_moves_of_ocv_and_hysteresis_is_taken_for_r0(circuit, hold, other):
    """Against the voltages of both samplings, one less the other, regressed on the current."""
    cell = characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")
    time_s, current_a = INTERVAL_S * np.arange(1000), drive_a(1000) - 1.0
    own = {}
    for way in (hold, other):
        table = {
            "Time [s]": time_s,
            "Current [A]": current_a,
            "Voltage [V]": 3.7 - 0.01 * current_a,
        }
        record = record_from_frame(table, current_hold=way, current_sign="discharge-positive")
        own[way] = prepare_record(record, cell, circuit, Window(initial_soc=0.9))
    gamma = {RATE: 60.0} if circuit == "esc" else {}
    truth = {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.02, "C1 [F]": 2e3, "R2 [Ohm]": 0.03, "C2 [F]": 2e4}
    parameters = CircuitParameters.from_dict(truth | gamma)
    bare = {name: [1e-9] for name in parameters.resistances}
    voltage_v = {
        way: simulate_circuit(prepared, parameters.with_tables(bare))
        for way, prepared in own.items()
    }
    # A slow difference is charge that was counted from another first sample.
    moved_v, step_a = np.diff(voltage_v[other] - voltage_v[hold]), np.diff(current_a)
    direct_ohm = -(moved_v @ step_a) / (step_a @ step_a)
    shift_ohm = source_shift_ohm(own[hold], other, parameters)
    assert abs(direct_ohm) > 1e-4
    assert shift_ohm == pytest.approx(-direct_ohm, rel=0.1)


def test_intervals_reach_over_what_the_other_sampling_makes_of_their_values(monkeypatch):
    fits, prepared, change = made("forward")
    constant = CircuitParameters.from_dict(
        {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.02, "C1 [F]": 200.0, "R2 [Ohm]": 0.03, "C2 [F]": 2000.0}
    )
    other = constant.with_tables({"R0 [Ohm]": [0.041]})
    # A step that answers 20 mOhm above the constant circuit's R0.
    monkeypatch.setattr(answer, "answers_ohm", lambda record: None)
    monkeypatch.setattr(answer, "late_r0_ohm", lambda known: 0.07)
    monkeypatch.setattr(answer, "hold_warning", lambda *given: given)
    monkeypatch.setattr(answer, "bands_by_soc", lambda evaluations: ())
    bounds = SimpleNamespace(ranges={})
    problem = SimpleNamespace(prepared_records=[prepared], bounds=bounds)
    setup = SimpleNamespace(problem=problem)
    evaluations = SimpleNamespace(identification=[SimpleNamespace(prepared=prepared)])
    warnings = []
    tables = answer._assessed(setup, fits, evaluations, warnings)
    others = answer._others(problem, constant, other)
    # A shift of more than a twentieth is a warning besides.
    far = abs(change.r0_ohm) > 0.05 * R0
    assert [notice[1:] for notice in warnings] == far * [(R0, R0 + change.r0_ohm)]
    # Samples of 5 s show every pair. Refits go up to 15 % beyond the closed form.
    assert [circuit.r0 for circuit in others] == pytest.approx([0.07, 0.05, 0.041, 0.03965])
    shares = change.shares
    fit, widened = fits.fits[0], tables.fits[0]
    before_all, after_all = fit.intervals + fit.means, widened.intervals + widened.means
    for before, after in zip(before_all, after_all, strict=True):
        moved = [0.0, shares.get(before.name, 0.0) * before.value]
        if before.name == "R0 [Ohm]":
            # Beside the mean: what comes late, and the tables' own shift.
            moved = [0.0, 0.07 - R0, 1.15 * change.r0_ohm]
        assert after.low == pytest.approx(max(before.low + min(moved), 0.0), rel=1e-12)
        assert after.high == pytest.approx(before.high + max(moved), rel=1e-12)


def test_a_hidden_pair_widens_r0_of_a_cell_of_a_pack_unless_bounds_of_r0_are_given():
    fits, prepared, _ = made("backward")
    prepared.record.hold.strength, prepared.dense_interval_s = "strong", 10.0
    values = {"R0 [Ohm]": Value(R0, R0 - 0.001, R0 + 0.001)}
    cell = PackCell("V1", 1e-3, fits.fits[0].tables, (), values)
    lows = []
    for bounds in ({}, {"R0 [Ohm]": (0.01, 0.1)}):
        given = replace(fits, settings=TableSettings(nodes=NODES, bounds=bounds))
        (widened,) = pack._spanning(PackFit((), 0.1, (cell,)), prepared, given).cells
        lows.append(widened.values["R0 [Ohm]"].low)
    # R0 without the pair is a third of it at least.
    assert lows == pytest.approx([R0 / 3 - 0.001, R0 - 0.001], rel=1e-12)


def test_a_constant_circuit_sampled_otherwise_has_the_same_time_constants(monkeypatch):
    _, prepared, change = made("forward")
    taus_s = (10.0, 60.0)
    circuit = CircuitParameters.of_tau(0.05, (0.02, 0.03), taus_s)
    monkeypatch.setattr(answer, "resampling", lambda *_: change)
    other = answer._resampled(SimpleNamespace(prepared_records=[prepared]), circuit)
    assert other.tau_s == pytest.approx(taus_s, rel=1e-12)
    ratios = np.array(other.r) / circuit.r - 1
    assert ratios == pytest.approx([change.shares[name] for name in circuit.resistances[1:]])
    assert np.all(np.abs(ratios) > 1e-3)
