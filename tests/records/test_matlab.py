"""MATLAB files as laboratories publish them, of both of MATLAB's formats, and what is none."""

import io

import numpy as np
import pytest
from scipy.io import savemat

from barnax.cell import read_ocv_test
from barnax.records.readers import matlab
from helpers.records import CURRENT, TIME, VOLTAGE, pulse_frame, read, refusal, remarks

FRAME = pulse_frame(300)
TIMES, AMPS, VOLTS = (FRAME[name].to_numpy() for name in (TIME, CURRENT, VOLTAGE))
AH = np.cumsum(AMPS) / 3600


def structs(cells):
    """An array of structures."""
    array = np.empty((1, len(cells)), dtype=[(name, object) for name in cells[0]])
    for index, cell in enumerate(cells):
        for name, value in cell.items():
            array[0, index][name] = value
    return array


def cycle(kind, hour, **data):
    date = np.array([2008.0, 4, 2, hour, 8, 17.5])
    return {"type": kind, "ambient_temperature": 24.0, "time": date, "data": data}


def nasa():
    measured = {
        "Voltage_measured": VOLTS,
        "Current_measured": AMPS,
        "Temperature_measured": VOLTS * 0 + 24,
    }
    impedance = {"Battery_impedance": np.ones(48) * 1j, "Re": 0.05}
    cycles = [
        cycle("charge", 13, **measured, Voltage_charge=VOLTS, Time=TIMES),
        cycle("impedance", 14, **impedance),
        cycle("discharge", 15, **measured, Capacity=1.8, Time=TIMES),
    ]
    return {"B0005": {"cycle": structs(cycles)}}


def script(**more):
    return {
        "time": TIMES,
        "current": -AMPS,
        "voltage": VOLTS,
        "chgAh": 0 * TIMES,
        "disAh": -AH,
        **more,
    }


KOLLMEYER = {
    "Time": TIMES, "Voltage": VOLTS, "Current": AMPS, "Ah": AH, "Wh": 3.7 * AH,
    "Power": VOLTS * AMPS, "Battery_Temp_degC": 25 + 0 * TIMES,
}  # fmt: skip
PLETT = {"DYNData": {"script1": script(), "script2": script(step=TIMES), "script3": script()}}
FILES = {
    "Kollmeyer": {"meas": KOLLMEYER},
    "Plett": PLETT,
    "vectors": {"time": TIMES, "current": AMPS, "voltage": VOLTS, "note": "by hand"},
    "another language": {"messung": {"Zeit": TIMES, "Strom": AMPS, "Spannung": VOLTS}},
}


def matlab_5(tree, **options):
    content = io.BytesIO()
    savemat(content, tree, oned_as="column", **options)
    return content.getvalue()


def matlab_73(tree):
    """The same as MATLAB writes it with -v7.3: HDF5 behind a block of its own."""
    h5py = pytest.importorskip("h5py")
    content = io.BytesIO()
    with h5py.File(content, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")

        def put(group, name, value):
            if isinstance(value, dict):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, each in value.items():
                    put(made, key, each)
            elif isinstance(value, np.ndarray) and value.dtype.names:
                made = group.create_group(name)
                for key in value.dtype.names:
                    field = made.create_dataset(key, (value.size, 1), dtype=h5py.ref_dtype)
                    for index, each in enumerate(value[key].ravel()):
                        field[index, 0] = put(refs, f"{len(refs)}", each).ref
            elif isinstance(value, str):
                made = group.create_dataset(name, data=np.array([[ord(each)] for each in value]))
                made.attrs["MATLAB_class"] = np.bytes_("char")
            else:
                made = group.create_dataset(name, data=np.atleast_2d(value).real)
                made.attrs["MATLAB_class"] = np.bytes_("double")
            return made

        for key, each in tree.items():
            put(file, key, each)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM"
    return head + content.getvalue()[128:]


WRITERS = {
    "v5": matlab_5,
    "v5 compressed": lambda tree: matlab_5(tree, do_compression=True),
    "v7.3": matlab_73,
}
# Compression is undone by SciPy, whatever is inside.
by_format = pytest.mark.parametrize("writer", ["v5", "v7.3"])


@pytest.fixture(autouse=True)
def untried(monkeypatch):
    """Without the trial in a process of its own, which takes half a second: test_room.py and the
    test of damaged files have it."""
    monkeypatch.setattr(matlab, "require_trial", lambda *_: None)


@by_format
@pytest.mark.parametrize("name", FILES)
def test_a_structure_of_columns_is_a_record(tmp_path, writer, name):
    record = read(tmp_path, WRITERS[writer](FILES[name]))
    np.testing.assert_array_equal(record.time_s, TIMES)
    np.testing.assert_array_equal(record.current_a, -AMPS)
    np.testing.assert_array_equal(record.voltage_v, VOLTS)
    assert (record.temperature_degc is not None) == (name == "Kollmeyer")
    note = "the record is 'DYNData.script1'; DYNData.script2, DYNData.script3 not used"
    assert any(note in each for each in remarks(record)) == (name == "Plett")


@by_format
def test_the_cycles_of_nasa_are_joined_by_their_dates(tmp_path, writer):
    record = read(tmp_path, WRITERS[writer](nasa()))
    np.testing.assert_allclose(record.time_s, np.concatenate([TIMES, TIMES + 7200]))
    np.testing.assert_array_equal(record.voltage_v, np.tile(VOLTS, 2))
    np.testing.assert_array_equal(np.unique(record.cycle), [1, 3])
    assert "2 cycles of 'B0005.cycle' joined" in " ".join(remarks(record))


@by_format
def test_a_structure_is_chosen_by_where_its_columns_stand(tmp_path, writer):
    tree = {"cellA": script(), "cellB": script(voltage=VOLTS - 0.1)}
    said = refusal(tmp_path, WRITERS[writer](tree))
    assert "2 records (cellA, cellB)" in said
    names = ",".join(f"{each}=cellB.{each}" for each in ("time", "current", "voltage"))
    record = read(tmp_path, WRITERS[writer](tree), columns=names)
    np.testing.assert_array_equal(record.voltage_v, VOLTS - 0.1)
    odd = {"m": {"a": TIMES, "b": AMPS}, "other": {"c": VOLTS}}
    names = "time=m.a:s,current=m.b:A,voltage=other.c:V"
    np.testing.assert_array_equal(
        read(tmp_path, WRITERS[writer](odd), columns=names).voltage_v, VOLTS
    )


@by_format
@pytest.mark.parametrize(
    ("tree", "held"),
    [
        ({"data": np.stack([TIMES, AMPS, VOLTS], 1)}, "data (300 x 3)"),
        ({"m": {"a": TIMES, "b": AMPS, "c": VOLTS}}, "m.a ("),
        ({"time": TIMES, "current": AMPS[:7], "voltage": VOLTS}, "current ("),
        ({"note": "nothing"}, "no arrays of numbers"),
    ],
    ids=["a matrix", "other names", "lengths that differ", "text"],
)
def test_what_is_no_record_is_refused_by_what_it_holds(tmp_path, writer, tree, held):
    tree = {**tree, "kind": "x"}
    said = refusal(tmp_path, WRITERS[writer](tree))
    assert said.startswith("cell.csv: a MATLAB file without a structure of columns")
    assert held in said or writer == "v7.3"


def test_a_table_of_ocv_is_one(tmp_path):
    soc = np.linspace(0, 1, 20)
    (tmp_path / "ocv.mat").write_bytes(matlab_5({"model": {"SOC": soc, "OCV": 3 + soc}}))
    assert len(read_ocv_test(tmp_path / "ocv.mat").branches[0]) == 20


def test_dates_in_days_are_recognized(tmp_path):
    tree = {"Time": 738_000 + TIMES / 86_400, "Current": AMPS, "Voltage": VOLTS}
    record = read(tmp_path, matlab_5(tree))
    assert "its numbers are dates, as MATLAB days" in " ".join(map(str, record.notes))
    named = read(tmp_path, matlab_5(tree), columns="time=Time:d")
    for one in (record, named):
        np.testing.assert_allclose(np.diff(one.time_s), 1, atol=1e-4)


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("share", [pytest.param(0.3, marks=pytest.mark.slow), 0.9])
def test_a_damaged_file_is_refused(tmp_path, writer, share, monkeypatch):
    # With the trial that `untried` leaves out.
    monkeypatch.undo()
    content = WRITERS[writer]({"meas": KOLLMEYER})
    assert "damaged or cut short" in refusal(tmp_path, content[: int(share * len(content))])


def test_a_file_that_reaches_into_others_is_refused_or_read_without_them(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(b"12345678" * 300)
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["time"], file["current"] = TIMES, AMPS
        outside = [(str(tmp_path / "secret"), 0, 2400)]
        file.create_dataset("voltage", (300,), "f8", external=outside)
    assert "refers to other files" in refusal(tmp_path, content.getvalue())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["voltage"] = VOLTS
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["time"], file["current"] = TIMES, AMPS
        file["voltage"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/voltage")
    assert "without a structure" in refusal(tmp_path, content.getvalue())


def test_what_refers_to_itself_ends(tmp_path):
    h5py = pytest.importorskip("h5py")
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        loop = file.create_dataset("loop", (30, 1), dtype=h5py.ref_dtype)
        for index in range(30):
            loop[index, 0] = loop.ref
        file["time"], file["current"], file["voltage"] = TIMES, AMPS, VOLTS
        file["again"] = h5py.SoftLink("/")
    np.testing.assert_array_equal(read(tmp_path, content.getvalue()).voltage_v, VOLTS)
