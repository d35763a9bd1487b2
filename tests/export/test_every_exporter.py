"""What holds for every registered exporter and every circuit."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.export import EXPORTERS
from helpers.results import WITH_GAMMA, make_cell, make_result, make_table_result, with_constant

from .conftest import every_circuit, every_exporter

# What each file's notes are written with, where its format has comments.
COMMENTED = ("pybamm", "thevenin", "simscape")


def words_of(content: bytes) -> str:
    """The content as one line of words, without what marks a comment."""
    text = content.decode("utf-16-le" if b"b\0a\0r\0n\0a\0x\0" in content else "latin-1")
    return " ".join(word for word in text.replace("\0", " ").split() if word not in ("#", "*", "-"))


@every_exporter
@pytest.mark.parametrize("circuit", ["so-rc", "esc"])
def test_equal_results_give_equal_bytes_and_another_gives_others(exporter, circuit):
    result = make_result(circuit)
    other = result.constant.parameters.with_tables({"R0 [Ohm]": [np.nextafter(0.0511, 1)]})
    changed = with_constant(result, parameters=other)
    written = exporter.write(result)
    assert written == exporter.write(make_result(circuit))
    assert written.content != exporter.write(changed).content


@every_exporter
def test_the_capacity_is_the_one_the_record_was_simulated_with(exporter):
    result = make_result("esc")
    larger = replace(result.cell, capacity_ah=2.2)
    expected = exporter.write(result.model_copy(update={"cell": larger}))
    assert exporter.write(make_result("esc", capacity_ah=2.2)) == expected
    assert exporter.write(result) != expected


@every_exporter
@every_circuit
def test_caveats_stand_in_the_file_too(exporter, circuit):
    content, caveats = exporter.write(make_result(circuit))
    assert (exporter.name in COMMENTED) == bool(caveats)
    if exporter.name != "simscape":  # its notes are read back in test_files
        words = words_of(content)
        assert all(caveat in words for caveat in caveats)


@pytest.mark.parametrize("name", ["pybamm", "simscape"])
@every_circuit
def test_a_hysteresis_that_a_tool_cannot_hold_is_named(name, circuit):
    caveats = " ".join(EXPORTERS[name].write(make_result(circuit)).caveats)
    assert ("hysteresis voltage" in caveats) == (circuit in ("iso-rc", "esc"))
    assert ("gamma of 87.25" in caveats) == (circuit in WITH_GAMMA)
    if circuit in ("iso-rc", "esc"):
        cell = make_cell()
        gap_v = cell.branch_gap_v if circuit in WITH_GAMMA else cell.hysteresis_v
        largest_mv = 1e3 * max(gap_v(np.linspace(0, 1, 101)))
        assert f"up to {largest_mv:.3g} mV" in caveats


@every_exporter
def test_a_capacity_that_only_a_record_tells_is_named(exporter):
    result = make_table_result()
    own = [replace(point, row=0) for point in result.cell.charge_points]
    cell = replace(result.cell, charge_points=tuple(own), discharge_points=tuple(own))
    assert "capacity" not in "".join(
        exporter.write(result.model_copy(update={"cell": cell})).caveats
    )
    spanned = replace(cell, capacity_origin="the charge that cycle.csv spans")
    caveat = exporter.write(result.model_copy(update={"cell": spanned})).caveats[0]
    assert caveat.startswith("The capacity, 2 Ah, is only the charge that cycle.csv spans: ")


@every_exporter
def test_nodes_near_no_sample_are_named(exporter):
    caveats = exporter.write(make_table_result()).caveats
    assert caveats[0].startswith("No sample is near the nodes at SOC -0.05, 0:")


@every_exporter
def test_every_export_names_the_measured_temperatures(exporter, over_temperature):
    content, caveats = exporter.write(over_temperature)
    told = " ".join(caveats)
    if exporter.name == "c-filter":
        assert "all of it is for 25 degC, and nothing identified at 0, 45" in told
        alone = exporter.write(over_temperature.at_temperature(25.0)).content
        assert alone.count(b"\n") < content.count(b"\n")
        return
    assert "Identified at 0, 25, 45 degC" in told
    assert "at 0, 25, 45 degC it was 1.9, 2, 2.1 Ah" in told
