"""A fleet's ageing in words: the screen, the page of the fleet, the page of a cell, and the
tables."""

import json
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from ..life import QUANTITIES, SHIFT
from .document import Page, Picture
from .wording import document, sentences
from .words import quantity_name

if TYPE_CHECKING:
    from ..life import Life

MOST_ROWS = 50
MOST_FAULTS, MOST_CAUSES = 10, 3


def life_lines(life: "Life") -> list[str]:
    """The screen."""
    more = len(life.faults) - MOST_FAULTS
    faults = sentences("life.faults", life, life.faults[:MOST_FAULTS], more)
    return [
        *sentences("life.screen", life, _quantities(life), _is_judged(life)),
        *(f"  {fault}" for fault in faults),
        *sentences("life.failed", _causes(life)[:MOST_CAUSES]),
    ]


def life_document(life: "Life", drawn: Sequence[Picture]) -> Page:
    """The page of the fleet."""
    facts: dict[str, Any] = {"quantities": _quantities(life), "is_judged": _is_judged(life)}
    facts |= {"most": MOST_ROWS, "last": _last, "causes": _causes(life)[:MOST_ROWS]}
    facts["shown"] = {quantity: _shown(quantity) for quantity in QUANTITIES}
    return document("life_page", drawn, life=life, **facts)


def cell_document(life: "Life", cell: str, drawn: Sequence[Picture]) -> Page:
    """The page of a cell."""
    trends = {
        quantity: (_shown(quantity), trend)
        for quantity in QUANTITIES
        for trend in life.of(quantity, cell)
        if trend.estimates
    }
    missing = [quantity_name(quantity) for quantity in QUANTITIES if quantity not in trends]
    return document("cell_page", drawn, life=life, cell=cell, missing=missing, trends=trends)


def life_json(life: "Life") -> str:
    """Everything but the models, as JSON; null if not determined."""
    contents = {
        "age unit": life.unit,
        "cell years": life.exposure,
        "false alarms a cell and year": life.false_alarms,
        "reference temperature [degC]": life.reference_degc,
        "equivalent full cycles": life.cycles,
        "equivalent full cycles are complete": life.counts_cycles,
        "spread": {name: vars(judged.fit.spread) for name, (_, judged) in life.judged.items()},
        "thresholds": {
            name: judged.threshold if np.isfinite(judged.threshold) else None
            for name, (_, judged) in life.judged.items()
        },
        "faults": [vars(fault) for fault in life.faults],
        "failed": [{"cell": name, "error": error} for name, error in life.failed],
        "trends": life_frame(life).to_dicts(),
    }
    return json.dumps(contents, indent=1) + "\n"


def life_frame(life: "Life") -> pl.DataFrame:
    """One row per quantity of each record: estimate and trend, with intervals."""
    numbers = ("estimate", "estimate low", "estimate high", "trend", "trend low", "trend high")
    schema: dict[str, Any] = {"cell": pl.String, "quantity": pl.String}
    schema |= dict.fromkeys((f"age [{life.unit}]", *numbers), pl.Float64)
    rows = [
        (trend.cell, trend.quantity, *row)
        for trend in life.trends
        for row in np.column_stack([trend.age, trend.measured, trend.smooth]).tolist()
    ]
    return pl.DataFrame(rows, schema, orient="row").with_columns(pl.col(*numbers).fill_nan(None))


def _quantities(life: "Life") -> list[dict[str, Any]]:
    """For each quantity the number of cells and rows that determine it, and the median change from
    first to last in percent; for the OCV, its shift at the end in mV."""
    quantities = []
    for quantity in QUANTITIES:
        trends, is_shift = life.of(quantity), quantity == SHIFT
        determined = [trend for trend in trends if trend.estimates]
        change = None
        if determined:
            smooth = [trend.smooth[np.isfinite(trend.smooth[:, 0]), 0] for trend in determined]
            first, last = np.array([values[[0, -1]] for values in smooth]).T
            change = 1e3 * np.median(last) if is_shift else 100 * (np.median(last / first) - 1)
        quantities.append(
            {
                "name": quantity_name(quantity),
                "is_shift": is_shift,
                "change": change,
                "cells": len(determined),
                "missing": len(life.cells) - len(determined),
                "rows": sum(len(trend.age) for trend in trends),
                "determined": sum(trend.estimates for trend in trends),
            }
        )
    return quantities


def _is_judged(life: "Life") -> bool:
    return any(np.isfinite(judged.threshold) for _, judged in life.judged.values())


def _causes(life: "Life") -> list[tuple[str, int]]:
    """Errors of failed rows with the number of rows, the most common first."""
    return Counter(error for _, error in life.failed).most_common()


def _last(life: "Life", quantity: str, cell: str) -> tuple[float, float] | None:
    """The trend at the last record that determines it, and the half-width of its interval, as
    displayed."""
    (trend,) = life.of(quantity, cell)
    if not trend.estimates:
        return None
    value, low, high = _shown(quantity)[1] * trend.smooth[np.isfinite(trend.smooth[:, 0])][-1]
    return value, (high - low) / 2


def _shown(quantity: str) -> tuple[str, float]:
    """A quantity's name with the displayed unit, and the factor to that."""
    return (quantity, 1.0) if "[A.h]" in quantity else (quantity.replace(" [", " [m"), 1e3)
