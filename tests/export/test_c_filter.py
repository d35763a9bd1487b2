"""The filter in C: compiled by the system's compiler, and run beside the one in Python."""

import subprocess
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from barnax.execution import in_float64
from barnax.export import EXPORTERS
from barnax.filters import Drive, run_filter
from barnax.model.prepared import prepare_record
from barnax.model.window import Window
from barnax.result_filter import model_of
from helpers.results import PAIRS_OF, WITH_GAMMA, make_record, make_result, make_table_result

from .conftest import compiled, needs_a_compiler

pytestmark = needs_a_compiler
HYSTERETIC = ("iso-rc", "esc", "takacs")
# So many samples pass before the current flows.
REST = 40
PROGRAM = """\
#include <stdio.h>
#include <stdlib.h>
#include "barnax_cell.h"
#include "barnax_filter.h"
int main(int count, char **given)
{
    barnax_filter f;
    double in[4], out[4];
    const double soc = count > 2 ? atof(given[2]) : 0.7;
    barnax_filter_start(&f, (barnax_real)soc, (barnax_real)0.1, count > 1 ? atoi(given[1]) : 0);
    while (fread(in, sizeof(double), 4, stdin) == 4) {
        barnax_filter_step(&f, (barnax_real)in[0], (barnax_real)in[1], (barnax_real)in[2],
                           (barnax_real)in[3]);
        out[0] = f.soc;
        out[1] = f.soc_sd;
        out[2] = f.innovation_v;
        out[3] = f.innovation_sd_v;
        fwrite(out, sizeof(double), 4, stdout);
    }
    return 0;
}
"""


@cache
def result_of(circuit, with_tables):
    make = make_table_result if with_tables else make_result
    return make(circuit, rest_current_a=0.05)


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    """What runs the filter of a result in C, each program compiled once."""

    @cache
    def program_of(circuit, with_tables, precision):
        options = ("-std=c99", f"-DBARNAX_REAL={precision}")
        folder, result = tmp_path_factory.mktemp("filter"), result_of(circuit, with_tables)
        # The other header of the same cell stands beside it.
        cell_header = EXPORTERS["c-header"].write(result).content
        (folder / "barnax_cell.h").write_bytes(cell_header)
        return compiled(folder, EXPORTERS["c-filter"], result, PROGRAM, *options)

    def run(circuit, with_tables, precision, direction, drive, soc=0.7):
        """SOC, its deviation, innovation and its deviation after every sample, from a last
        direction on."""
        rows = np.stack([drive.interval_s, drive.held_a, drive.current_a, drive.voltage_v], axis=1)
        command = [program_of(circuit, with_tables, precision), str(direction), str(soc)]
        ran = subprocess.run(command, input=rows.tobytes(), capture_output=True, check=True)
        return np.frombuffer(ran.stdout).reshape(-1, 4)

    return run


@in_float64
def in_python(result, prepared, direction):
    """The same; an unknown direction is halfway between both, with a deviation of one."""
    # A record that begins with a rest starts where that ends.
    before_load = np.cumsum(np.abs(prepared.current_a) > prepared.rest_current_a) == 0
    prepared = replace(prepared, direction=np.where(before_load, direction, prepared.direction))
    model, drive = model_of(result, ("offset", "capacity")), Drive.of(prepared)
    start = model.start(0.7, 0.1, float(direction), 1.0 if direction == 0 else 0.0)
    actual = jax.jit(run_filter)(model, start, drive)
    columns = (actual.soc, actual.soc_sd, actual.innovation_v, actual.innovation_sd_v)
    return np.stack(columns, axis=1), drive


@pytest.mark.parametrize(
    ("circuit", "with_tables"),
    [
        *(
            pytest.param(name, False, marks=pytest.mark.slow)
            for name in PAIRS_OF
            if name not in WITH_GAMMA
        ),
        ("esc", False),
        ("so-rc", True),
        ("esc", True),
    ],
)
def test_it_is_the_filter_in_python(in_c, circuit, with_tables):
    result = result_of(circuit, with_tables)
    record = make_record(2000)
    at_rest = np.arange(record.samples) < REST
    record = replace(record, current_a=np.where(at_rest, 0.0, record.current_a))
    window = Window(initial_soc=0.9, initial_direction=1, rest_current_a=0.05)
    prepared = prepare_record(record, result.cell, circuit, window)
    for direction in (1, 0) if circuit in HYSTERETIC else (1,):
        expected, drive = in_python(result, prepared, direction)
        double, single = (
            in_c(circuit, with_tables, each, direction, drive) for each in ("double", "float")
        )
        assert np.abs(double - expected).max() < 1e-9
        assert np.abs(single[:, 0] - expected[:, 0]).max() < 2e-3


@pytest.mark.parametrize("soc", [0.0, 0.5, 1.0])
def test_single_precision_is_double_precision_from_a_point_of_the_table_too(in_c, soc):
    """There the OCV's slope is another on either side, at full that beyond it."""
    result = result_of("esc", True)
    number = np.arange(2000)
    current_a = np.where(number < REST, 0.0, np.where(number % 20 < 10, 2.0, -1.9))
    held_a = np.append(0.0, current_a[:-1])
    voltage_v = result.cell.average_ocv_v(np.full(2000, soc)) - 0.05 * current_a
    drive = SimpleNamespace(
        interval_s=1.0 * (number > 0), held_a=held_a, current_a=current_a, voltage_v=voltage_v
    )
    double, single = (in_c("esc", True, each, 1, drive, soc) for each in ("double", "float"))
    assert np.abs(single[:, 0] - double[:, 0]).max() < 2e-4


BRANCHES = """\
#include <stdio.h>
#define BARNAX_BRANCHES
#include "barnax_filter.h"
int main(void)
{
    barnax_filter f;
    double soc, out[2];
    barnax_filter_start(&f, (barnax_real)0.7, (barnax_real)0.1, 0);
    barnax_filter_step(&f, 0, 0, 0, (barnax_real)3.7);
    while (fread(&soc, sizeof(double), 1, stdin) == 1) {
        barnax_filter_branches(soc, &out[0], &out[1]);
        fwrite(out, sizeof(double), 2, stdout);
    }
    return 0;
}
"""


@pytest.mark.parametrize("circuit", ["iso-rc", "esc"])
def test_both_branches_of_the_ocv_are_in_it(tmp_path, circuit):
    result = make_result(circuit)
    program = compiled(tmp_path, EXPORTERS["c-filter"], result, BRANCHES, "-std=c99")
    soc = np.linspace(0.05, 0.95, 19)
    ran = subprocess.run([program], input=soc.tobytes(), capture_output=True, check=True)
    found_v, cell = np.frombuffer(ran.stdout).reshape(-1, 2), result.cell
    half_v = (cell.branch_gap_v if circuit in WITH_GAMMA else cell.hysteresis_v)(soc) / 2
    expected_v = cell.average_ocv_v(soc)[:, None] + half_v[:, None] * [1, -1]
    assert np.abs(found_v - expected_v).max() < 1e-3


@pytest.mark.parametrize("direction", [1, -1])
def test_an_unknown_direction_leaves_room_for_both(in_c, direction):
    """At rest on a branch at 70 % SOC, as believed: the wrong branch is the farthest off."""
    cell, rest, soc = result_of("esc", False).cell, np.zeros(600), np.array([0.7])
    voltage_v = (cell.average_ocv_v(soc) + direction * cell.branch_gap_v(soc) / 2)[0] + rest
    drive = SimpleNamespace(interval_s=rest + 1, held_a=rest, current_a=rest, voltage_v=voltage_v)
    wrong, unknown, right = (
        in_c("esc", False, "double", each, drive)[-1] for each in (-direction, 0, direction)
    )
    assert abs(right[0] - 0.7) < abs(unknown[0] - 0.7) < abs(wrong[0] - 0.7)
    assert abs(unknown[0] - 0.7) < unknown[1]
