"""The board's tools recover a circuit that made two records, and refuse tables that are none."""

import numpy as np
import pytest
from benchmarks.board.tools import PEERS, along, submitted

import barnax
from barnax import InputError
from barnax.model.prepared import prepare_record
from helpers.reference import drop_v, filtered_response

R_OHM, TAU_S = (0.05, 0.02, 0.03), (12.0, 150.0)


def prepared_on(cell, seed, hold="forward"):
    """A record of two RC pairs, made with SciPy's `lfilter` from full to half full; of `hold`
    backward each row has the current before its voltage."""
    draw = np.random.default_rng(seed)
    current_a = np.repeat(draw.gamma(0.8, 1.2, 120) * draw.choice([1, 1, -0.5, 0], 120), 25)
    current_a[:60] = 0.0
    soc = 0.95 - np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / cell.capacity_ah
    of_row_a = current_a if hold == "forward" else np.append(0.0, current_a[:-1])
    pairs = drop_v(filtered_response, 1.0, current_a, (0.0, R_OHM[1:], TAU_S))
    voltage_v = cell.average_ocv_v(soc) - R_OHM[0] * of_row_a - pairs
    table = {"Time [s]": np.arange(3000.0), "Current [A]": of_row_a, "Voltage [V]": voltage_v}
    record = barnax.record_from_frame(
        table, name="made", current_sign="discharge-positive", current_hold=hold
    )
    return prepare_record(record, cell, "so-rc", barnax.Window(initial_soc=0.95))


@pytest.fixture(scope="module", params=["forward", "backward"])
def pair(request, bundled_cell):
    return tuple(prepared_on(bundled_cell, seed, request.param) for seed in (1, 2))


@pytest.mark.parametrize("tool", PEERS)
def test_a_tool_predicts_another_record_of_the_same_circuit(pair, tool):
    fitted, left_out = pair
    errors_v = PEERS[tool](fitted)(left_out)
    assert np.sqrt(np.mean(errors_v**2)) < 1.5e-3


def test_a_submitted_circuit_is_simulated(pair, tmp_path):
    path = tmp_path / "made.csv"
    heads = "SOC,R0 [Ohm],R1 [Ohm],tau1 [s],R2 [Ohm],tau2 [s]\n"
    path.write_text(f"{heads}0,0.05,0.02,12,0.03,150\n1,0.05,0.02,,0.03,\n")
    assert np.abs(along(submitted(path))(pair[1])).max() < 1e-9
    path.write_text("SOC,R0 [Ohm],R1 [Ohm]\n0.5,0.05,0.02\n")
    with pytest.raises(InputError, match=r"made\.csv: no table of a circuit .*tau1"):
        submitted(path)
