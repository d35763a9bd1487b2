"""The pictures of the guides, drawn with the bundled cell: `python docs/pictures.py`.

They are kept in docs/pictures, where a reader of the files sees them too.
"""

import json
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.figure import Figure
from scipy.signal import lfilter

import barnax
from barnax.fleet.summary import read_fleet
from barnax.life import life_of
from barnax.plots import encode, plot_fleet_life, style
from barnax.plots.cells import plot_distributions

CELLS = 24


@cache
def identified() -> barnax.Result:
    """The answer that the guides show."""
    return barnax.identify()


@cache
def pulse_test() -> barnax.Result:
    validation = barnax.bundled_file("validation")
    return barnax.hppc(barnax.bundled_file("hppc_25degC"), validate=validation, trust="none")


def of_result(name: str) -> Callable[[], Figure]:
    return lambda: identified().figure(name)


def of_pulses(name: str) -> Callable[[], Figure]:
    return lambda: pulse_test().figure(name)


def draw_ocv() -> Figure:
    tests = [
        barnax.read_record(barnax.bundled_file(f"lfp_ocv_{way}")) for way in ("charge", "discharge")
    ]
    return barnax.plots.plot_ocv(barnax.characterize(tests, ocv_fit="interpolated"))


def draw_replay() -> Figure:
    return barnax.plots.plot_soc_replay(
        barnax.replay_soc(identified(), barnax.bundled_file("validation"))
    )


@style.figure_style()
def draw_intervals() -> Figure:
    """Both intervals of every determined parameter, relative to its value."""
    assessment = identified().constant.assessment
    assert assessment is not None
    determined = [e for e in assessment.uncertainty.estimates if e.low is not None]
    figure = style.make_figure(height_in=2.6)
    axes = figure.subplots()
    heights = np.arange(len(determined))[::-1]
    for shift, color, label, ends in (
        (0.14, style.BLUE, "95 % interval", [(e.low, e.high) for e in determined]),
        (-0.14, style.ORANGE, "if the residuals were white noise", [white(e) for e in determined]),
    ):
        low, high = (np.array(ends, float) / [[e.value] for e in determined]).T
        axes.hlines(heights + shift, low, high, color=color, linewidth=4, label=label)
    axes.set_xscale("log")
    style.label_plainly(axes.xaxis)
    axes.axvline(1.0, color=style.BLACK, linewidth=0.7)
    axes.set_yticks(heights, [e.name.split(" ")[0] for e in determined])
    axes.set_xlabel("Multiple of the identified value [-]")
    return style.finish(figure, axes)


def white(estimate) -> tuple[float, float]:
    """The interval that white noise would give."""
    factor = np.exp(1.96 * (estimate.white_noise_relative_error or 0.0))
    return estimate.value / factor, estimate.value * factor


@style.figure_style()
def draw_exported() -> Figure:
    """The OCV and the resistances that `barnax export --to json` writes."""
    written = json.loads(barnax.export.get_exporter("json").write(identified()).content)
    ocv, tables = written["OCV"], dict(written["resistances"])
    soc = tables.pop("SOC")
    figure = style.make_figure(height_in=2.8)
    left, right = figure.subplots(1, 2)
    left.plot(ocv["SOC"], ocv["voltage [V]"], ".-", color=style.BLACK, label="OCV", markersize=3)
    left.set(xlabel=style.SOC_LABEL, ylabel="Voltage [V]")
    for (name, ohm), look in zip(tables.items(), style.row_looks(tables).values(), strict=True):
        shown = {"color": look.color, "marker": look.marker, "markersize": 3}
        right.plot(soc, 1e3 * np.array(ohm), label=name.split(" ")[0], **shown)
    right.set(xlabel=style.SOC_LABEL, ylabel="Resistance [mOhm]", yscale="log")
    style.label_plainly(right.yaxis)
    return style.finish(figure, left, right, columns=4)


@style.figure_style()
def draw_fitted_ocv() -> Figure:
    """The OCV of a drive cycle alone, its intervals, and the OCV test."""
    alone = barnax.identify(barnax.bundled_file("identification"), capacity=2.0, seeds=0)
    assert alone.tables is not None
    determined = [e for e in alone.fit.intervals if e.name == "OCV [V]" and e.low is not None]
    soc, value, low, high = np.array([(e.soc, e.value, e.low, e.high) for e in determined], float).T
    tests = [barnax.read_record(barnax.bundled_file(f"ocv_{w}")) for w in ("discharge", "charge")]
    measured_v = barnax.characterize(tests).average_ocv_v(soc)
    figure = style.make_figure(height_in=2.8)
    left, right = figure.subplots(1, 2)
    left.plot(soc, measured_v, color=style.BLACK, label="OCV test", linewidth=2.4)
    left.plot(soc, value, ".-", color=style.ORANGE, label="from the record", markersize=3)
    left.set(xlabel=style.SOC_LABEL, ylabel="OCV [V]")
    right.fill_between(soc, 1e3 * (low - measured_v), 1e3 * (high - measured_v), alpha=0.3,
                       color=style.ORANGE, label="95 % interval")  # fmt: skip
    right.plot(soc, 1e3 * (value - measured_v), ".-", color=style.ORANGE, markersize=3)
    right.axhline(0.0, color=style.BLACK, linewidth=0.7)
    right.set(xlabel=style.SOC_LABEL, ylabel="Record minus test [mV]")
    return style.finish(figure, left, right)


def simulated_cells() -> Iterator[dict]:
    """Cells of given circuits that carry the bundled record's current."""
    test = barnax.read_record(barnax.bundled_file("ocv_discharge"))
    cell = barnax.characterize([test], ocv_fit="interpolated")
    drive = pl.read_parquet(barnax.bundled_file("identification")).head(3000)
    current_a = -drive["Current / A"].to_numpy()
    soc = 1 - np.cumsum([0.0, *current_a[:-1]]) / 3600 / cell.capacity_ah
    rng = np.random.default_rng(0)
    for number in range(CELLS):
        voltage_v = cell.average_ocv_v(soc) - rng.normal(0.050, 0.002) * current_a
        for r_ohm, tau_s in (rng.normal(0.015, 0.001), 20), (rng.normal(0.020, 0.003), 300):
            decay = np.exp(-1 / tau_s)
            voltage_v = voltage_v - lfilter([0, r_ohm * (1 - decay)], [1, -decay], current_a)
        voltage_v = voltage_v + rng.normal(0, 1e-3, soc.size)
        frame = drive.with_columns(pl.Series("Voltage / V", voltage_v))
        record = barnax.record_from_frame(frame, name=f"cell-{number}")
        problem = barnax.make_problem(record, cell, "so-rc", objective="compressed")
        yield {"id": f"cell-{number}", "problem": problem}


def draw_fleet() -> Figure:
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        barnax.identify_fleet(simulated_cells(), folder, executor=executor)
        rows = read_fleet(folder)
    names = ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]")
    return plot_distributions({name: rows[name].to_numpy() for name in names})


def draw_design() -> Figure:
    return barnax.design(capacity=2.0, max_hours=2.5, max_discharge=2.0, max_charge=1.0).figure()


def draw_pack() -> Figure:
    """Eight cells of one current, of which one has more R0."""
    table = pl.read_parquet(barnax.bundled_file("identification")).head(4000)
    rng = np.random.default_rng(0)
    more_ohm = np.append(rng.normal(0, 2e-4, 7), 0.01)
    cells = {
        f"V{number}": pl.col("Voltage / V") + ohm * pl.col("Current / A")
        for number, ohm in enumerate(more_ohm.tolist(), 1)
    }
    ocv = [barnax.bundled_file(f"ocv_{way}") for way in ("charge", "discharge")]
    frame = table.with_columns(**cells).drop("Voltage / V")
    return barnax.identify_pack(frame, ocv=ocv).figure()


def draw_life() -> Figure:
    """An invented fleet, one cell of which ages faster."""
    rng = np.random.default_rng(0)
    rows = []
    for cell in range(12):
        for years in np.arange(0, 3, 0.5).tolist():
            rate = 0.25 if cell == 5 else 0.1
            row = {"id": f"{cell}-{years}", "error": None, "specimen": f"A{cell}"}
            row |= {"age_years": years, "capacity [A.h]": 2.0, "temperature [degC]": 25.0}
            row |= {"record throughput [A.h]": 4.0, "aged beside OCV": "new"}
            row |= {"aged capacity to empty": True}
            for name, new, change, sd in (
                ("capacity [A.h]", 2.0, -0.3 * rate, 0.003),
                ("R0 [Ohm]", 0.03, rate, 0.006),
                ("R [Ohm]", 0.07, rate, 0.008),
                ("OCV shift [V]", 0.0, 0.0, 0.001),
            ):
                value = new * (1 + change * years + sd * rng.standard_normal())
                value += 0.0 if new else sd * rng.standard_normal()
                half = 2 * sd * (new or 1.0)
                row[f"aged {name}"] = value
                row |= {f"aged {name} low": value - half, f"aged {name} high": value + half}
                row[f"aged {name} by OCV"] = [1e-4 * half]
            rows.append(row)
    return plot_fleet_life(life_of(pl.DataFrame(rows, infer_schema_length=None), age="age_years"))


PICTURES: dict[str, Callable[[], Figure]] = {
    "design": draw_design,
    "pack": draw_pack,
    "life": draw_life,
    "voltage": of_result("identification-voltage"),
    "error": of_result("identification-error"),
    "tables": of_result("tables"),
    "ocv": draw_ocv,
    "intervals": draw_intervals,
    "exported": draw_exported,
    "fitted_ocv": draw_fitted_ocv,
    "replay": draw_replay,
    "fleet": draw_fleet,
    "pulses": of_pulses("pulses"),
    "resistances": of_pulses("resistances"),
}


if __name__ == "__main__":
    for name, draw in PICTURES.items():
        (Path(__file__).with_name("pictures") / f"{name}.png").write_bytes(encode(draw(), dpi=120))
