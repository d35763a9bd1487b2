"""The C header, compiled where there is a compiler, and its numbers printed by a program."""

import shutil
import subprocess

import numpy as np
import pytest

from barnax.export import EXPORTERS
from barnax.export.tables import tables_of
from helpers.results import CIRCUITS, GAMMA, PAIRS, PAIRS_OF, make_result

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler here")
PROGRAM = r"""
#include <stdio.h>
#include "barnax_cell.h"
#include "barnax_cell.h"

static void show(const double *values, int count)
{
    int k;
    for (k = 0; k < count; k++)
        printf("%.17g ", values[k]);
    printf("\n");
}

int main(void)
{
    show(&barnax_capacity_ah, 1);
    show(&barnax_initial_soc, 1);
    show(&barnax_initial_direction, 1);
    show(&barnax_rest_current_a, 1);
    show(&barnax_r0_ohm, 1);
    show(barnax_r_ohm, BARNAX_RC_PAIRS);
    show(barnax_c_f, BARNAX_RC_PAIRS);
    show(barnax_tau_s, BARNAX_RC_PAIRS);
    show(barnax_ocv_soc, BARNAX_OCV_POINTS);
    show(barnax_ocv_v, BARNAX_OCV_POINTS);
#if BARNAX_HYSTERESIS
    show(barnax_hysteresis_soc, BARNAX_HYSTERESIS_POINTS);
    show(barnax_hysteresis_v, BARNAX_HYSTERESIS_POINTS);
#endif
#if BARNAX_HYSTERESIS == 2
    show(&barnax_gamma, 1);
#endif
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("circuit", CIRCUITS)
def test_a_program_prints_every_number_of_the_result(tmp_path, circuit):
    result = make_result(circuit, initial_direction=-1)
    (tmp_path / "barnax_cell.h").write_bytes(EXPORTERS["c-header"].write(result).content)
    (tmp_path / "main.c").write_text(PROGRAM)
    strict = ["-std=c89", "-pedantic", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([COMPILER, *strict, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    ran = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    found = [[float(word) for word in line.split()] for line in ran.stdout.splitlines()]

    tables = tables_of(result)
    r, c = np.array(PAIRS[: PAIRS_OF[circuit]]).T
    expected = [[2.0], [0.9], [-1.0], [0.035], [0.0511], r, c, r * c]
    expected += [tables.ocv.soc, tables.ocv.voltage_v]
    if tables.hysteresis is not None:
        expected += [tables.hysteresis.soc, tables.hysteresis.voltage_v]
    if circuit == "esc":
        expected += [[GAMMA]]
    assert len(found) == len(expected)
    for numbers, values in zip(found, expected, strict=True):
        np.testing.assert_array_equal(numbers, values)


@pytest.mark.parametrize(("circuit", "code"), [("so-rc", 0), ("iso-rc", 1), ("esc", 2)])
def test_the_kind_of_hysteresis_can_be_asked_of_the_preprocessor(circuit, code):
    text = EXPORTERS["c-header"].write(make_result(circuit)).content.decode()
    assert f"#define BARNAX_HYSTERESIS {code}\n" in text
