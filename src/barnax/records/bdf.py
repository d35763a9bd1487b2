"""A record written as a table of the Battery Data Format, for whoever goes on elsewhere.

Names and units are the format's preferred labels (battery-data-alliance/battery-data-format);
charge is positive, as it asks.
"""

import io
import json
from typing import Any

import numpy as np
import polars as pl

from .. import __version__
from .record import Record


def bdf_table(record: Record) -> pl.DataFrame:
    """The record's samples under the format's labels, charge positive.

    The format has no word for when a sample's current flowed. Where it flowed before the sample
    and no counters prove it, the net capacity is the integral that does.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> bdf_table(read_record(bundled_file("identification"))).columns
    ['Test Time / s', 'Current / A', 'Voltage / V']
    """
    net_ah = record.discharged_ah if _is_unproved(record) else record.charge_ah
    columns = {
        "Test Time / s": record.time_s,
        # Adding zero makes the -0.0 of a rest a plain zero.
        "Current / A": 0.0 - record.current_a,
        "Voltage / V": record.voltage_v,
        "Surface Temperature / degC": record.temperature_degc,
        "Step Index / 1": record.step,
        "Cycle Count / 1": record.cycle,
        "Net Capacity / Ah": None if net_ah is None else 0.0 - net_ah,
    }
    return pl.DataFrame({name: np.array(own) for name, own in columns.items() if own is not None})


def _is_unproved(record: Record) -> bool:
    return record.hold.value != "forward" and record.hold.strength != "strong"


def provenance(record: Record) -> dict[str, Any]:
    """The file that the record is of, and what was decided and changed on the way."""
    return {
        "written by": f"barnax {__version__}",
        "source": record.name,
        "source sha256": record.sha256,
        "current sign in the source": record.sign.value,
        "reason": record.sign.reason,
        "current flows": f"{record.hold.value} from a sample ({record.hold.strength})",
        "net capacity": "integrated" if _is_unproved(record) else "the tester's",
        "warnings": [str(found) for found in (*record.notes, *record.warnings)],
    }


def bdf_files(record: Record, name: str) -> dict[str, bytes]:
    """The files by name: Parquet that holds its provenance, or CSV with a JSON file beside it."""
    table = bdf_table(record)
    origin = json.dumps(provenance(record), indent=1, ensure_ascii=False)
    if not name.lower().endswith(".csv"):
        parquet = io.BytesIO()
        table.write_parquet(parquet, metadata={"provenance": origin})
        return {name: parquet.getvalue()}
    return {name: table.write_csv().encode(), f"{name[:-4]}.json": f"{origin}\n".encode()}
