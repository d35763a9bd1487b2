"""Measured records of which the design picks a quarter without seeing the voltage."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np

from barnax.cell import CellModel, characterize
from barnax.experiment.belief import believed_of_fit
from barnax.experiment.earlier import by_second
from barnax.experiment.information import (
    Believed,
    Information,
    Width,
    columns_along,
    information_of,
    widths_of,
)
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc import TableFit, errors_on, fit_tables
from barnax.records import read_record
from barnax.reporting.design import reached_half
from barnax.search.evaluate import evaluate

from .virtual import SETTINGS, TABLES

PIECE_S, QUARTER = 60, 4
# Records that span so much of the state of charge are picked of.
LONG = 0.6
SCORED = Window(initial_soc=1.0, start_after_step=3, score_steps=(7, 8))


def without(whole: Information, own: Information) -> Information:
    """What the rest tells where a piece is left out."""
    return Information(
        whole.samples - own.samples, whole.normal - own.normal, whole.noise - own.noise
    )


def measured(folder: Path) -> dict[str, tuple[CellModel, dict[str, PreparedRecord]]]:
    """Cells by name, with their drive cycles at 25 degC."""
    lg, calce = folder / "lg-hg2-18650", folder / "calce-inr18650-20r"
    found = {}
    cell = characterize([read_record(lg / "c20_25degC.parquet")], ocv_fit="interpolated")
    known = Window(initial_soc=1.0)
    files = {name: lg / f"{name}_25degC.parquet" for name in ("us06", "mixed1", "la92")}
    found["LG 18650HG2"] = (
        cell,
        {
            name: each_second(prepare_record(read_record(path), cell, "so-rc", known))
            for name, path in files.items()
        },
    )
    test = read_record(calce / "ocv-incremental_25degC_SP20-3.parquet")
    cell = replace(characterize([test], ocv_fit="interpolated"), capacity_ah=2.0)
    found["CALCE INR18650-20R"] = (
        cell,
        {
            f"{name} {soc}": prepare_record(
                read_record(
                    calce / f"{name}_25degC_{soc}soc_SP20-2.parquet", current_hold="backward"
                ),
                cell,
                "so-rc",
                SCORED,
            )
            for name in ("dst", "us06")
            for soc in (80, 50)
        },
    )
    return found


def each_second(prepared: PreparedRecord) -> PreparedRecord:
    """A record of which a voltage a second counts, as a test would log it."""
    # In its middle: currents change where it begins.
    second = np.floor(prepared.time_s - prepared.time_s[0] + 0.5)
    is_first = np.append(True, np.diff(second) > 0)
    return replace(prepared, scored=prepared.scored & is_first)


def picked(believed: Believed, prepared: PreparedRecord) -> tuple[np.ndarray, tuple[Width, ...]]:
    """The pieces that are left where the one without which the error on the whole record is
    predicted to grow least is left out, again and again; and the widths that are promised."""
    seconds = by_second(prepared)
    columns, _ = columns_along(believed, seconds.current_a, seconds.soc)
    columns = columns * seconds.counted[:, None]
    drive = columns.T @ columns / seconds.counted.sum()
    piece = np.arange(len(columns)) // PIECE_S
    pieces = {
        number: information_of(believed, columns[piece == number])
        for number in np.unique(piece[seconds.counted]).tolist()
    }
    whole: Information = sum(list(pieces.values())[1:], next(iter(pieces.values())))
    count = len(pieces) // QUARTER
    while len(pieces) > count:
        left_v = {}
        for number, own in pieces.items():
            others = without(whole, own)
            left_v[number] = others.left_on(believed, others.inverse(believed), drive)
        least = min(left_v, key=left_v.__getitem__)
        whole = without(whole, pieces.pop(least))
    chosen = np.array([*pieces])
    told = information_of(believed, columns * np.isin(piece, chosen)[:, None])
    return chosen, widths_of(believed, replace(told, samples=len(pieces) * PIECE_S))


def quarter_rows(
    cell: CellModel, records: Mapping[str, PreparedRecord], fits: Mapping[str, TableFit]
) -> list[list[float | str]]:
    """What each other record leads to pick of each record, and what that is worth."""
    rows: list[list[float | str]] = []
    long = [name for name, own in records.items() if np.ptp(own.soc[own.scored]) > LONG]
    for known, name in permutations(long, 2):
        seen = evaluate(records[known], fits[known].tables)
        believed = believed_of_fit(
            fits[known], SETTINGS, cell, fits[known].errors[0].rmse_v, [seen]
        )
        prepared = records[name]
        chosen, promised = picked(replace(believed, earlier=()), prepared)
        piece = ((prepared.time_s - prepared.time_s[0]) // PIECE_S).astype(int)
        scored = np.unique(piece[prepared.scored])
        parts = {"picked": chosen, "every fourth": scored[QUARTER // 2 :: QUARTER]}
        found = {
            what: fit_tables(
                [replace(prepared, scored=prepared.scored & np.isin(piece, pieces))], SETTINGS
            )
            for what, pieces in parts.items()
        }
        found["whole"] = fits[name]
        ratios = [
            float(
                np.median(
                    [
                        reached / width.alone
                        for width in promised
                        if width.name == f"{table} [Ohm]"
                        and width.soc is not None
                        and 0.1 <= width.soc <= 0.9
                        and (reached := reached_half(found["picked"], width)) is not None
                    ]
                )
            )
            for table in TABLES
        ]
        others = [record for other, record in records.items() if other not in (name, known)]
        errors_v = [
            float(np.sqrt(np.mean([errors_on(o, fit.tables).rmse_v ** 2 for o in others])))
            for fit in found.values()
        ]
        rows.append([known, name, *ratios, *errors_v])
        print(*rows[-1], file=sys.stderr, flush=True)
    return rows


def quarter_lines(folder: Path) -> list[str]:
    """The section of measured records."""
    lines = [
        "## A quarter of a measured record",
        "",
        "At 25 degC, OCV tests known. From one record of a cell, tables and error are known; "
        f"of another, the quarter of its pieces of {PIECE_S} s is picked with which the error on "
        "the whole record is predicted to be least, by its current alone. Half the intervals "
        "reached by that quarter over promised, and the RMSE on the records that neither knew, of "
        "that quarter, of every fourth piece and of the whole record.",
        "",
        "| cell | known | picked of | R0 | R1 | R2 | picked [mV] | every fourth [mV] | whole [mV] "
        "|",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows: list[Sequence[float | str]] = []
    for name, (cell, records) in measured(folder).items():
        fits = {own: fit_tables([prepared], SETTINGS) for own, prepared in records.items()}
        found = quarter_rows(cell, records, fits)
        rows += found
        for known, own, *numbers in found:
            ratios = " | ".join(f"{number:.2f}" for number in numbers[:3])
            errors = " | ".join(f"{1e3 * float(number):.2f}" for number in numbers[3:])
            lines.append(f"| {name} | {known} | {own} | {ratios} | {errors} |")
    table = np.array([row[2:] for row in rows], float)
    near = np.mean(np.abs(np.log(table[:, :3])) <= np.log(1.2), axis=0)
    share = [np.mean(table[:, 3] <= factor * table[:, 5]) for factor in (1.0, 1.1)]
    every = np.mean(table[:, 4] <= 1.1 * table[:, 5])
    return [
        *lines,
        "",
        f"Of {len(rows)} pairs: within 20 % of promised R0 in {100 * near[0]:.0f} %, R1 in "
        f"{100 * near[1]:.0f} %, R2 in {100 * near[2]:.0f} %; the error of the quarter picked no "
        f"larger than the whole record's in {100 * share[0]:.0f} %, up to a tenth larger in "
        f"{100 * share[1]:.0f} % (every fourth piece: {100 * every:.0f} %).",
        "",
    ]
