"""Measured records of which the design picks a quarter without seeing the voltage."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from pathlib import Path

import numpy as np

from barnax.cell import CellModel, characterize
from barnax.experiment.belief import believed_of_fit, by_second, counting
from barnax.experiment.information import (
    Believed,
    Columns,
    Information,
    columns_along,
    information_of,
    widths_of,
)
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc.fit import TableFit, fit_tables, pooled_errors
from barnax.over_soc.registration import register
from barnax.records import read_record
from barnax.reporting.design import reached_half
from barnax.search.evaluate import evaluate

from .virtual import SETTINGS, TABLES

PIECE_S, QUARTER = 60, 4
PICKED, EVERY, WHOLE = "quarter picked", "every fourth piece", "whole record"
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


def columns_of(believed: Believed, prepared: PreparedRecord) -> tuple[Columns, np.ndarray]:
    """The columns of every second of a record, none of those that do not count; and its piece, -1
    where it does not."""
    seconds = by_second(prepared)
    columns, _ = columns_along(believed, seconds.current_a, seconds.soc)
    piece = np.where(seconds.counted, np.arange(len(columns)) // PIECE_S, -1)
    return columns * seconds.counted[:, None], piece


def picked(believed: Believed, prepared: PreparedRecord) -> np.ndarray:
    """The pieces that are left where the one without which the error on the whole record is
    predicted to grow least is left out, again and again."""
    columns, piece = columns_of(believed, prepared)
    drive = columns.T @ columns / np.count_nonzero(piece >= 0)
    pieces = {
        number: information_of(believed, columns[piece == number])
        for number in np.unique(piece[piece >= 0]).tolist()
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
    return np.array([*pieces])


def reached_over_promised(
    believed: Believed, prepared: PreparedRecord, pieces: np.ndarray, fit: TableFit
) -> list[float]:
    """Of R0, R1 and R2, the median over the nodes from 10 to 90 % SOC."""
    columns, piece = columns_of(believed, prepared)
    is_told = np.isin(piece, pieces)
    told = information_of(believed, columns * is_told[:, None])
    promised = widths_of(believed, replace(told, samples=int(is_told.sum())))
    return [
        float(
            np.median(
                [
                    reached / width.after
                    for width in promised
                    if width.name == f"{table} [Ohm]"
                    and width.soc is not None
                    and 0.1 <= width.soc <= 0.9
                    and (reached := reached_half(fit, width)) is not None
                ]
            )
        )
        for table in TABLES
    ]


def believed_by(cell: CellModel, records: Sequence[PreparedRecord], fit: TableFit) -> Believed:
    """The belief that the fit of some records leaves, which count for the next."""
    seen = [evaluate(prepared, fit.tables) for prepared in records]
    return counting(believed_of_fit(fit, SETTINGS, cell, fit.errors[0].rmse_v), seen)


def alone_by(cell: CellModel, prepared: PreparedRecord, fit: TableFit) -> Believed:
    """The belief that a record's fit leaves, of which none counts for the next."""
    return replace(believed_by(cell, [prepared], fit), earlier=())


def errors_mv(fit: TableFit, records: Sequence[PreparedRecord]) -> tuple[float, float]:
    """The RMS of the errors on records, and of those above 10 % SOC."""
    errors = [pooled_errors([record], fit.tables) for record in records]
    squares = [(e.rmse_v**2, e.rmse_v**2 if e.above_v is None else e.above_v**2) for e in errors]
    whole, above = (1e3 * np.sqrt(np.mean(squares, axis=0))).tolist()
    return whole, above


@dataclass(frozen=True)
class Pair:
    """What one record leads to pick of another, and what that is worth.

    Attributes:
        known: The record that is known.
        name: The record that is picked of.
        ratios: Reached over promised of R0, R1 and R2, by what was identified on and what promised.
        errors_mv: On the records that neither knew, whole and above 10 % SOC.
    """

    known: str
    name: str
    ratios: dict[str, list[float]]
    errors_mv: dict[str, tuple[float, float]]


def pairs_of(
    cell: CellModel, records: Mapping[str, PreparedRecord], fits: Mapping[str, TableFit]
) -> Iterator[Pair]:
    """Every long record after every other."""
    long = [name for name, own in records.items() if np.ptp(own.soc[own.scored]) > LONG]
    beliefs = {name: alone_by(cell, records[name], fits[name]) for name in long}
    for known, name in permutations(long, 2):
        prepared, believed = records[name], beliefs[known]
        piece = ((prepared.time_s - prepared.time_s[0]) // PIECE_S).astype(int)
        scored = np.unique(piece[prepared.scored])
        parts = {PICKED: picked(believed, prepared), EVERY: scored[QUARTER // 2 :: QUARTER]}
        only = {
            what: replace(prepared, scored=prepared.scored & np.isin(piece, pieces))
            for what, pieces in parts.items()
        }
        found = {what: fit_tables([part], SETTINGS) for what, part in only.items()}
        own = alone_by(cell, only[PICKED], found[PICKED])
        parts[WHOLE], found[WHOLE] = scored, fits[name]
        promises = {
            f"{PICKED}: by the known record": (PICKED, believed),
            f"{PICKED}: by the whole of its record": (PICKED, beliefs[name]),
            f"{PICKED}: by itself": (PICKED, own),
            f"{EVERY}: by the known record": (EVERY, believed),
            f"{EVERY}: by the whole of its record": (EVERY, beliefs[name]),
            f"{WHOLE}: by the known record": (WHOLE, believed),
        }
        others = [record for other, record in records.items() if other not in (name, known)]
        yield Pair(
            known,
            name,
            {
                who: reached_over_promised(belief, prepared, parts[what], found[what])
                for who, (what, belief) in promises.items()
            },
            {what: errors_mv(fit, others) for what, fit in found.items()},
        )


def quarter_lines(folder: Path) -> list[str]:
    """The section of measured records."""
    lines = [
        "## A quarter of a measured record",
        "",
        "At 25 degC, OCV tests known. From one record of a cell, tables and error are known; "
        f"of another, the quarter of its pieces of {PIECE_S} s is picked with which the error on "
        "the whole record is predicted to be least, by its current alone. Half the intervals "
        "reached by that quarter over promised, and the RMSE on the records that neither knew "
        "(above 10 % SOC), of that quarter, of every fourth piece and of the whole record.",
        "",
        "| cell | known | picked of | R0 | R1 | R2 | picked [mV] | every fourth [mV] | whole [mV] "
        "|",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    pairs: list[Pair] = []
    for cell_name, (cell, records) in measured(folder).items():
        fits = {own: fit_tables([prepared], SETTINGS) for own, prepared in records.items()}
        for pair in pairs_of(cell, records, fits):
            print(pair, file=sys.stderr, flush=True)
            pairs.append(pair)
            ratios = " | ".join(f"{ratio:.2f}" for ratio in next(iter(pair.ratios.values())))
            errors = " | ".join(
                f"{own:.2f} ({above:.2f})" for own, above in pair.errors_mv.values()
            )
            lines.append(f"| {cell_name} | {pair.known} | {pair.name} | {ratios} | {errors} |")
    lines += [
        "",
        f"How many of the {len(pairs)} pairs reach what was promised within 20 %, and the lowest "
        "and highest of reached over promised. A promise by another record has the error and time "
        "constants of that record's fit.",
        "",
        "| identified on: promised | R0 | R1 | R2 |",
        "|---|---|---|---|",
    ]
    for who in pairs[0].ratios:
        ratios = np.array([pair.ratios[who] for pair in pairs])
        cells = [
            f"{100 * np.mean(np.abs(np.log(own)) <= np.log(1.2)):.0f} % "
            f"({own.min():.2f} to {own.max():.2f})"
            for own in ratios.T
        ]
        lines.append(f"| {who} | {' | '.join(cells)} |")
    errors = np.array([[*pair.errors_mv.values()] for pair in pairs])
    near = 100 * np.mean(errors[:, :2] <= 1.1 * errors[:, 2:], axis=0)
    (whole, above), (every, every_above) = near.tolist()
    return [
        *lines,
        "",
        f"Of {len(pairs)} pairs, the error is up to a tenth larger than the whole record's in "
        f"{whole:.0f} %, above 10 % SOC in {above:.0f} % (every fourth piece: {every:.0f} and "
        f"{every_above:.0f} %).",
        "",
    ]


def together_lines(folder: Path) -> list[str]:
    """The section of measured records that are identified together."""
    rows: list[tuple[str, str, str, list[float]]] = []
    for cell_name, (cell, records) in measured(folder).items():
        fits = {own: fit_tables([prepared], SETTINGS) for own, prepared in records.items()}
        beliefs = {own: believed_by(cell, [records[own]], fits[own]) for own in records}
        for names in combinations(records, 2):
            both = register([records[own] for own in names], SETTINGS)
            fit = fit_tables(both, SETTINGS)
            error = believed_by(cell, both, fit).error
            for known, name in (names, names[::-1]):
                believed, prepared = beliefs[known], records[name]
                _, piece = columns_of(believed, prepared)
                pieces = np.unique(piece[piece >= 0])
                ratios = reached_over_promised(believed, prepared, pieces, fit)
                grown = error.rmse_v / believed.error.rmse_v
                rows.append((cell_name, known, name, [*ratios, grown]))
                print(rows[-1], file=sys.stderr, flush=True)
    columns = np.array([values for *_, values in rows])
    medians = " | ".join(f"{median:.2f}" for median in np.median(columns, axis=0))
    ends = zip(columns.min(axis=0), columns.max(axis=0), strict=True)
    spans = " | ".join(f"{low:.2f} to {high:.2f}" for low, high in ends)
    return [
        "## Two measured records together",
        "",
        "From one record of a cell, tables and error are known; another's current is given, and "
        "what both will tell together is promised. Then both are identified, their starts and "
        "capacities registered. Half the intervals reached over promised, and the error that both "
        "leave over that of the one known.",
        "",
        "| cell | known | new | R0 | R1 | R2 | error |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {' | '.join(names)} | {' | '.join(f'{value:.2f}' for value in values)} |"
            for *names, values in rows
        ),
        f"| median of {len(rows)} | | | {medians} |",
        f"| lowest to highest | | | {spans} |",
        "",
    ]
