"""Do the intervals of tables over SOC hold the truth? `python -m benchmarks.table_coverage`.

Known tables on the bundled cell's current, simulated by the scan under a noise that is correlated
over tens and hundreds of seconds, and fitted again. Counts how often each visited node's 95 %
interval holds its true value. Truths bend over SOC as measured tables do, and lie between the nodes
of the fit: every truth is a random smooth curve, not a table. Writes
benchmarks/results/table_coverage.md. `python -m benchmarks.table_coverage 40` takes fewer truths.
"""

import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from barnax.bundled import BUNDLED
from barnax.cell import CircuitParameters, characterize
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.model.reference import simulate_circuit
from barnax.over_soc import TableSettings, fit_tables
from barnax.records import read_record
from benchmarks.coverage.simulated import Noise
from benchmarks.pages import as_markdown, provenance, publish

RESULTS = Path(__file__).parent / "results" / "table_coverage.md"
TRUTHS, SEED = 200, 15
# A measured cell's residuals are about so: a few millivolts over minutes, little of it white.
NOISE = Noise("20 s, 1 mV and 300 s, 1 mV and white, 0.5 mV", ((20, 1e-3), (300, 1e-3), (0, 5e-4)))
FINE = np.linspace(-0.05, 1.0, 211)
TAU_S = (15.0, 150.0)
# Ohm at half full, how much a truth differs from it by a random curve, and how it rises when empty.
LEVELS = {"R0": (0.05, 0.1, 0.3), "R1": (0.015, 0.2, 1.0), "R2": (0.025, 0.2, 1.0)}
CORRECTION_V = 5e-3
EMPTY_SOC = 0.08
WAVINESS = {"R0 varies by 10 %, R1 and R2 by 20 %": 1.0, "Twice as much": 2.0}


def main(arguments: Sequence[str]) -> None:
    """Measure, print the page and write it."""
    truths = int(arguments[0]) if arguments else TRUTHS
    cell = characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="polynomial")
    prepared = prepare_record(read_record(BUNDLED.record), cell, "so-rc", Window())
    lines = [
        "# Do the intervals of tables over SOC hold?",
        "",
        as_markdown(provenance(f"python -m benchmarks.table_coverage {truths}", SEED)),
        "",
        f"{truths} random truths on the bundled cell's current, {int(prepared.scored.sum())} "
        f"samples each, noise of {NOISE.name}. Shares of truths that the 95 % interval of a node "
        "holds.",
        "",
    ]
    for name, waviness in WAVINESS.items():
        lines += _section(name, prepared, truths, waviness)
    publish(RESULTS, "\n".join(lines))


def _section(title: str, prepared: PreparedRecord, truths: int, waviness: float) -> list[str]:
    hits, reaches, biased = defaultdict(list), defaultdict(list), []
    for number in range(truths):
        rng = np.random.default_rng([SEED, number])
        truth = _truth(rng, waviness)
        fit = fit_tables([_measured(prepared, truth, rng)], TableSettings(folds=0, max_boxes=0))
        for each in fit.intervals:
            if each.soc is None:
                value = truth.constants[each.name]
            else:
                value = float(truth.at(each.name, np.array([each.soc]))[0])
            low, high = each.low, each.high
            is_held = low is not None and high is not None and low <= value <= high
            hits[each.name, each.soc].append(is_held)
            biased.append(each.is_biased)
            if low is not None and high is not None:
                reaches[each.name].append((high - low) / 2)
        print(number, {name: np.mean(held) for name, held in hits.items()}, file=sys.stderr)
    shares = {name: float(np.mean(held)) for name, held in hits.items()}
    nodes = {name: share for name, share in shares.items() if name[1] is not None}
    worst, lowest = min(nodes.items(), key=lambda each: each[1])
    tables = list(dict.fromkeys(name for name, soc in nodes))
    at = sorted({soc for _, soc in nodes})
    lines = [
        f"## {title}",
        "",
        f"{100 * np.mean(list(nodes.values())):.1f} % over all nodes, "
        f"at worst {100 * lowest:.1f} %, {worst[0]} at {worst[1]:g} SOC. Smoothing and straight "
        f"lines may have moved {100 * np.mean(biased):.0f} % of the values further than their "
        "standard error.",
        "",
        f"| table | half an interval (median) | {' | '.join(f'{soc:g}' for soc in at)} |",
        f"|---|---|{'---|' * len(at)}",
    ]
    for table in tables:
        cells = [f"{100 * nodes[table, soc]:.0f} %" if (table, soc) in nodes else "-" for soc in at]
        unit = "mV" if table.endswith("[V]") else "mOhm"
        reach = f"{1e3 * np.median(reaches[table]):.2g} {unit}"
        lines.append(f"| {table} | {reach} | {' | '.join(cells)} |")
    held = [f"{name} {100 * share:.1f} %" for (name, soc), share in shares.items() if soc is None]
    return [*lines, "", f"Time constants: {', '.join(held)}.", ""]


def _truth(rng: np.random.Generator, waviness: float) -> CircuitParameters:
    """Smooth random curves over SOC, resistances rising toward empty."""
    empty = np.exp(-np.maximum(FINE, 0.0) / EMPTY_SOC)
    curves = {
        name: level
        * (np.exp(waviness * spread * curve(rng)) + rise * rng.uniform(0.5, 1.5) * empty)
        for name, (level, spread, rise) in LEVELS.items()
    }
    return CircuitParameters.over_soc(
        nodes=tuple(FINE.tolist()),
        tau_s=TAU_S,
        r0_ohm=tuple(curves["R0"].tolist()),
        r_ohm=tuple(tuple(curves[name].tolist()) for name in ("R1", "R2")),
        ocv_correction_v=tuple((CORRECTION_V * curve(rng)).tolist()),
    )


def curve(rng: np.random.Generator) -> np.ndarray:
    """A few waves over SOC with random phases, about one in size."""
    waves = np.arange(1, 5)
    sizes, phases = rng.normal(size=4) / waves, rng.uniform(0, 2 * np.pi, 4)
    return sizes @ np.sin(np.pi * waves[:, None] * FINE + phases[:, None])


def _measured(
    prepared: PreparedRecord, truth: CircuitParameters, rng: np.random.Generator
) -> PreparedRecord:
    """The record with the voltage of a truth under noise."""
    voltage_v = prepared.record.voltage_v.copy()
    simulated_v = simulate_circuit(prepared, truth)
    voltage_v[prepared.span] = simulated_v + NOISE.draw(rng, 1, len(simulated_v))[0]
    return replace(prepared, record=replace(prepared.record, voltage_v=voltage_v))


if __name__ == "__main__":
    main(sys.argv[1:])
