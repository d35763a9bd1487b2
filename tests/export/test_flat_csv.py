"""The flat CSV, read back line by line."""

import csv
import re

import numpy as np
import pytest

from barnax.export import EXPORTERS
from barnax.export.tables import tables_of
from helpers.results import CIRCUITS, GAMMA, PAIRS, PAIRS_OF, make_result

every_circuit = pytest.mark.parametrize("circuit", CIRCUITS)


def rows(circuit: str) -> list[dict[str, str]]:
    content = EXPORTERS["csv"].write(make_result(circuit)).content.decode()
    return list(csv.DictReader(content.splitlines()))


@every_circuit
def test_every_value_is_a_number_with_a_unit_under_a_name_of_its_own(circuit):
    found = rows(circuit)
    assert all(np.isfinite(float(row["value"])) for row in found)
    assert {row["unit"] for row in found} == {"Ohm", "F", "s", "A", "A.h", "V", "1"}
    assert len({row["name"] for row in found}) == len(found)


@every_circuit
def test_the_circuit_comes_back_as_it_was_identified(circuit):
    found = {row["name"]: (float(row["value"]), row["unit"]) for row in rows(circuit)}
    assert found["R0"] == (0.0511, "Ohm")
    for k, (r, c) in enumerate(PAIRS[: PAIRS_OF[circuit]], start=1):
        assert found[f"R{k}"] == (r, "Ohm")
        assert found[f"C{k}"] == (c, "F")
        assert found[f"tau{k}"] == (r * c, "s")
    assert found["capacity"] == (2.0, "A.h")
    assert found["initial SOC"] == (0.9, "1")
    assert found["rest current"] == (0.035, "A")
    assert found.get("gamma") == ((GAMMA, "1") if circuit == "esc" else None)


@pytest.mark.parametrize("name", ["OCV", "W"])
def test_a_curve_comes_back_point_by_point(name):
    matches = [(re.fullmatch(rf"{name}\((.+)\)", row["name"]), row) for row in rows("esc")]
    points = [(float(match[1]), float(row["value"])) for match, row in matches if match]
    tables = tables_of(make_result("esc"))
    table = tables.ocv if name == "OCV" else tables.hysteresis
    np.testing.assert_array_equal(np.array(points), np.stack([table.soc, table.voltage_v], axis=1))
