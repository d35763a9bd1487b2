"""The filter in C: compiled by the system's compiler, and run beside the one in Python."""

import shutil
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest

from barnax.execution import in_float64
from barnax.export import EXPORTERS
from barnax.filters import Drive, model_of, run_filter
from barnax.model.inputs import prepare_record
from barnax.model.window import Window
from helpers.results import PAIRS_OF, make_record, make_result, make_table_result

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="this system has no C compiler")
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2")
PROGRAM = """\
#include <stdio.h>
#include "barnax_filter.h"
int main(void)
{
    barnax_filter f;
    double in[4], out[4];
    barnax_filter_start(&f, (barnax_real)0.7, (barnax_real)0.1);
    while (fread(in, sizeof(double), 4, stdin) == 4) {
        barnax_filter_step(&f, (barnax_real)in[0], (barnax_real)in[1], (barnax_real)in[2],
                           (barnax_real)in[3]);
        out[0] = f.x[0];
        out[1] = sqrt(f.p[0][0]);
        out[2] = f.innovation_v;
        out[3] = f.innovation_sd_v;
        fwrite(out, sizeof(double), 4, stdout);
    }
    return 0;
}
"""


def in_c(folder, result, drive, precision):
    """SOC, its deviation, innovation and its deviation after every sample."""
    (folder / "barnax_filter.h").write_bytes(EXPORTERS["c-filter"].write(result).content)
    (folder / "main.c").write_text(PROGRAM)
    program = folder / precision
    subprocess.run(
        [COMPILER, *STRICT, f"-DBARNAX_REAL={precision}", folder / "main.c", "-o", program, "-lm"],
        check=True,
    )
    rows = np.stack([drive.interval_s, drive.held_a, drive.current_a, drive.voltage_v], axis=1)
    ran = subprocess.run([program], input=rows.tobytes(), capture_output=True, check=True)
    return np.frombuffer(ran.stdout).reshape(-1, 4)


@in_float64
def in_python(result, prepared):
    model, drive = model_of(result, ("offset", "capacity")), Drive.of(prepared)
    found = run_filter(model, model.start(0.7, 0.1, float(prepared.start.direction), 0.0), drive)
    columns = (found.soc, found.soc_sd, found.innovation_v, found.innovation_sd_v)
    return np.asarray(jnp.stack(columns, axis=1)), drive


@pytest.mark.parametrize(
    ("circuit", "with_tables"),
    [*((name, False) for name in PAIRS_OF), ("so-rc", True), ("esc", True)],
)
def test_it_is_the_filter_in_python(tmp_path, circuit, with_tables):
    make = make_table_result if with_tables else make_result
    result = make(circuit, rest_current_a=0.05)
    window = Window(initial_soc=0.9, initial_direction=1, rest_current_a=0.05)
    prepared = prepare_record(make_record(2000), result.cell_model, circuit, window)
    expected, drive = in_python(result, prepared)
    found = in_c(tmp_path, result, drive, "double")
    assert np.abs(found - expected).max() < 1e-9
    single = in_c(tmp_path, result, drive, "float")
    assert np.abs(single[:, 0] - expected[:, 0]).max() < 2e-3
