"""Simscape: a .mat file with the parameters of the block Battery (Table-Based).

Variables bear the block's own parameter names (MathWorks, Simscape Electrical and Simscape
Battery, "Battery (Table-Based)", tables over SOC alone), in the block's default units: V, Ohm, s
and A*hr. `load` the file and write the names into the block.
"""

import io

import numpy as np
from scipy.io import savemat

from ..result import Result
from .caveats import hysteresis_is_left_out
from .exporter import Export, Exporter
from .tables import tables_of
from .text import note_lines

HEADER_BYTES = 116
HEADER = b"MATLAB 5.0 MAT-file, written by barnax"


def write_simscape(result: Result) -> Export:
    """The .mat file (MATLAB 5)."""
    tables = tables_of(result)
    circuit = tables.parameters
    caveats = (
        *hysteresis_is_left_out("The block Battery (Table-Based)", tables),
        'The block reads its tables linearly; set "Extrapolation method for all tables" to '
        "Nearest, as barnax holds the OCV constant beyond its end points.",
    )
    over_soc = np.ones_like(tables.ocv.soc)
    variables: dict[str, object] = {
        "SOC_vec": tables.ocv.soc,
        "V0_vec": tables.ocv.voltage_v,
        "V_range": np.array([0.0, np.inf]),
        "AH": tables.capacity_ah,
        "R0_vec": circuit.r0 * over_soc,
        "prm_dyn": f"simscape.enum.tablebattery.prm_dyn.rc{circuit.pairs}",
        "stateOfCharge": tables.initial_soc,
        "barnax_notes": note_lines(tables.heading, caveats),
    }
    for pair, (r, tau_s) in enumerate(zip(circuit.r, circuit.tau_s, strict=True), start=1):
        variables[f"R{pair}_vec"] = r * over_soc
        variables[f"tau{pair}_vec"] = tau_s * over_soc
    file = io.BytesIO()
    savemat(file, variables, oned_as="row")
    # SciPy writes the date there; equal results are to give equal bytes.
    file.seek(0)
    file.write(HEADER.ljust(HEADER_BYTES))
    return Export(file.getvalue(), caveats)


SIMSCAPE = Exporter(
    name="simscape",
    description="MATLAB file: tables of Simscape's Battery (Table-Based)",
    file_name="barnax_simscape.mat",
    write=write_simscape,
)
