"""A third pair is tried where two leave what it takes away, at any rate of sampling."""

from dataclasses import replace

import pytest

import barnax
from barnax.model.prepared import prepare_record
from barnax.over_soc import TableSettings, is_worth_trying
from barnax.over_soc.dependence import searched
from barnax.weighing import THREE_PAIRS
from helpers.packs import PackedCell, drive_a, frame, ocv_table, simulated

TWO = PackedCell(soc=0.95)
THREE = replace(TWO, r_ohm=(0.008, 0.012, 0.012), tau_s=(5.0, 60.0, 700.0))


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    file = tmp_path_factory.mktemp("ocv") / "ocv.csv"
    ocv_table().write_csv(file)
    return barnax.characterize([barnax.read_ocv_table(file)], capacity_ah=5.0)


def prepared(cell, true, circuit):
    current_a = drive_a(7200, mean_a=1.8, seed=3)
    voltage_v = simulated([true], current_a, noise_v=3e-4)
    table = frame(voltage_v, current_a, name="Voltage [V]")
    record = barnax.record_from_frame(table, name="drive", current_hold="forward")
    return prepare_record(record, cell, circuit, barnax.Window(initial_soc=true.soc))


@pytest.mark.parametrize(("true", "is_worth"), [(TWO, False), (THREE, True)])
def test_a_third_pair_is_worth_a_try_where_there_is_one(cell, true, is_worth):
    settings = TableSettings(folds=0, resistances_follow="none")
    objective, best = searched([prepared(cell, true, "so-rc")], settings)
    records = [prepared(cell, true, THREE_PAIRS)]
    assert is_worth_trying(records, settings, best.rms_v, objective.low_end) == is_worth


@pytest.mark.slow
@pytest.mark.parametrize(("true", "circuit"), [(TWO, "so-rc"), (THREE, THREE_PAIRS)])
def test_beside_an_ocv_test_the_tables_have_the_pairs_of_the_cell(cell, true, circuit):
    one = prepared(cell, true, "so-rc")
    found = barnax.identify(
        one.record, cell=one.cell, window=one.window, seeds=0, trust="none", advise=False
    )
    assert found.model == circuit
    assert found.circuit_parameters.tau_s == pytest.approx(true.tau_s, rel=0.15)
