"""Reading of large files against Polars alone: CSV of 100 MB in three dialects."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from barnax.checks import check_file
from barnax.records import read_record, read_source

from .row import Row
from .sizes import KEY, Sizes
from .turns import Run, take_turns

AIM = 2.0


def time_reading(sizes: Sizes) -> list[Row]:
    """Tables and checked records from files, each beside the library that parses it."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, above, separator, table in dialects(sizes.rows_read):
            file = Path(folder, "cell.csv")
            file.write_text(above + table.write_csv(separator=separator))
            what = f"{name}, {file.stat().st_size / 1e6:.0f} MB"
            options = {"separator": separator, "skip_rows": above.count("\n")}
            alone = Run(lambda file=file, options=options: pl.read_csv(file, **options))
            rows += _rows(what, file, alone, sizes)
    return rows


def _rows(what: str, file: Path, alone: Run, sizes: Sizes) -> list[Row]:
    runs = {
        "alone": alone,
        "table": Run(lambda: read_source(file)),
        "record": Run(lambda: read_record(file)),
        "check": Run(lambda: check_file(file)),
    }
    taken = take_turns(runs, sizes.turns)
    return [
        Row(
            f"{what}: {words}",
            taken[ours],
            "Polars alone",
            taken["alone"],
            taken.ratio(ours, "alone"),
            "times as long",
            aim,
        )
        for ours, words, aim in (
            ("table", "read", AIM),
            ("record", "read and checked, sign and hold decided", None),
            ("check", "looked through by `barnax check`", None),
        )
    ]


def dialects(rows: int) -> Iterator[tuple[str, str, str, pl.DataFrame]]:
    """Name, lines above, delimiter and table of pulses in three dialects, the same in size."""
    count = np.arange(rows)
    time_s, kind = count * 0.1, (count // 50) % 3 - 1
    current_a = np.array([-1.5, 0.0, 2.0])[kind + 1]
    noise_v = np.random.default_rng(KEY).normal(size=rows)
    voltage_v = np.round(3.7 + 0.05 * current_a + 1e-4 * noise_v, 4)
    charge_ah = np.round(np.cumsum(current_a) * 0.1 / 3600, 6)
    step = count // 5000
    clock = _clock(time_s)
    yield (
        "BDF CSV",
        "",
        ",",
        pl.DataFrame(
            {
                "Test Time / s": time_s.round(1),
                "Current / A": current_a,
                "Voltage / V": voltage_v,
                "Step Index / 1": step,
                "Net Capacity / Ah": charge_ah,
            }
        ),
    )
    some = int(rows / 2)
    words = pl.Series(["CC DChg", "Rest", "CC Chg"])
    yield (
        "Neware CSV with clocks",
        "",
        ",",
        pl.DataFrame(
            {
                "DataPoint": count + 1,
                "Cycle Index": step // 30 + 1,
                "Step Index": step + 1,
                "Step Type": words.gather(kind + 1),
                "Time": _clock(time_s - time_s[5000 * step]),
                "Total Time": clock,
                "Current(A)": current_a,
                "Voltage(V)": voltage_v,
                "Capacity(Ah)": np.abs(charge_ah),
                "Date": pl.Series((1e3 * time_s).astype(int) + 1_700_000_000_000)
                .cast(pl.Datetime("ms"))
                .dt.strftime("%Y-%m-%d %H:%M:%S"),
            }
        ).head(some),
    )
    yield (
        "Maccor text with a column of states",
        "Today's Date\t10/10/2020\n",
        "\t",
        pl.DataFrame(
            {
                "Rec#": count + 1,
                "Cyc#": 0 * count,
                "Step": step,
                "Test Time": "0d " + clock,
                "Step Time": "0d " + clock,
                "Amp-hr": np.abs(charge_ah),
                "Amps": np.abs(current_a),
                "Volts": voltage_v,
                "State": pl.Series(["D", "R", "C"]).gather(kind + 1),
            }
        ).head(int(rows * 0.65)),
    )


def _clock(time_s: np.ndarray) -> pl.Series:
    """Times as hours, minutes and seconds."""
    whole = pl.Series((10 * time_s).round().astype(int))
    return pl.select(
        pl.format(
            "{}:{}:{}.{}",
            (whole // 36000).cast(pl.String).str.zfill(2),
            (whole // 600 % 60).cast(pl.String).str.zfill(2),
            (whole // 10 % 60).cast(pl.String).str.zfill(2),
            whole % 10,
        )
    ).to_series()
