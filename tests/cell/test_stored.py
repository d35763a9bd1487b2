"""A cell and its circuit are stored by the one serializer, and come back bit for bit."""

from pathlib import Path

import pytest

from barnax.cell import CellModel, CircuitParameters, characterize
from barnax.schema import Document
from helpers.ocv_tests import both_ways, discharge_only


class Stored(Document):
    cell: CellModel
    parameters: CircuitParameters


def stored(path: Path, make=both_ways, **fits: str) -> Stored:
    document = Stored(
        cell=characterize([make()], **fits),
        parameters=CircuitParameters.constant(0.05, (0.02, 0.03), (500.0, 2000.0), gamma=300.0),
    )
    path.write_text(document.to_json())
    return document


@pytest.mark.parametrize("ocv_fit", ["polynomial", "interpolated"])
@pytest.mark.parametrize("hysteresis_fit", ["continuous", "independent"])
@pytest.mark.parametrize("make", [both_ways, discharge_only])
def test_a_cell_survives_its_file_bit_for_bit(tmp_path, make, ocv_fit, hysteresis_fit):
    path = tmp_path / "stored.json"
    document = stored(path, make, ocv_fit=ocv_fit, hysteresis_fit=hysteresis_fit)
    again = Stored.from_json(path)
    assert (again, again.to_json()) == (document, path.read_text())
