"""A cell and its circuit are stored by the one serializer, and come back bit for bit."""

from pathlib import Path

import pytest

from barnax.cell import CellModel, CircuitParameters, characterize
from barnax.errors import InputError
from barnax.schema import Document
from helpers.hostile import EXAMPLES, damaged, repeated
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


@pytest.mark.parametrize("examples", EXAMPLES)
def test_a_damaged_file_is_refused_or_gives_itself_back(tmp_path, examples):
    path = tmp_path / "stored.json"
    good = stored(path).to_json().encode()

    def survive(content: bytes) -> None:
        path.write_bytes(content)
        try:
            again = Stored.from_json(path)
        except InputError as problem:
            refusal = str(problem)
        else:
            refusal = f"{path}: "
            path.write_text(again.to_json())
            assert Stored.from_json(path).to_json() == again.to_json()
        assert refusal.startswith(f"{path}: ")
        assert len(refusal) < 2000 + len(str(path))

    repeated(examples, survive, damaged([good]))
