"""The page: the table, growth, start-up and peers."""

from collections.abc import Sequence

from .growth import Length, slope
from .peers import whole_fit_s
from .row import Row, seconds
from .sizes import POPULATION, Sizes
from .startup import IMPORTS, Start


def work_table(rows: Sequence[Row]) -> list[str]:
    """The rows of the issue, with aim, measured ratio and verdict."""
    lines = [
        "| work | ours | baseline in the same run | baseline | aim | measured | verdict |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.work} | {seconds(row.ours_s)} | {row.baseline} | {seconds(row.baseline_s)} "
        f"| {row.aim_text} | {row.ratio:.3g} {row.kind} | {row.verdict} |"
        for row in rows
    ]
    notes = [f"- {row.work}: {row.note}." for row in rows if row.note]
    return [*lines, "", *dict.fromkeys(notes)]


def length_table(lengths: Sequence[Length]) -> list[str]:
    """Time and memory against record length."""
    lines = [
        "| samples | reduction | NumPy's most in it [MiB] | process grew by [MiB] "
        "| compressed search | one generation, scan |",
        "|---|---|---|---|---|---|",
    ]
    for each in lengths:
        scan = "-" if each.scan_s is None else seconds(each.scan_s)
        lines.append(
            f"| {each.samples:,} | {seconds(each.reduction_s)} | {each.numpy_mib:.1f} "
            f"| {each.process_mib:.0f} | {seconds(each.search_s)} | {scan} |"
        )
    samples = [float(each.samples) for each in lengths]
    reduction = slope(samples, [each.reduction_s for each in lengths])
    searches = [each.search_s for each in lengths]
    return [
        *lines,
        "",
        f"From the last but one length to the last the reduction grows with the power "
        f"{reduction:.2f} of the length. The slowest search takes "
        f"{max(searches) / min(searches):.2f} times as long as the fastest.",
    ]


def seed_table(counts: Sequence[tuple[int, float]]) -> list[str]:
    """Time against seeds."""
    lines = ["| seeds | time | each |", "|---|---|---|"]
    return lines + [
        f"| {count:,} | {seconds(taken)} | {seconds(taken / count)} |" for count, taken in counts
    ]


def start_table(starts: Sequence[Start]) -> list[str]:
    """Start-up of the command."""
    lines = [
        "`barnax identify --quiet` on the bundled cell, a fresh process: thirty seeds, intervals, "
        f"figures. The ratio is to the processor time of `{IMPORTS}` in the same minute.",
        "",
        "| compiled programs | wall | processor time | ratio | aim |",
        "|---|---|---|---|---|",
    ]
    return lines + [
        f"| {each.cache} | {each.wall_s:.1f} s | {each.cpu_s:.1f} s | {each.ratio:.2f} "
        f"| {each.verdict} |"
        for each in starts
    ]


def peer_table(measured: dict, why_not: str, fit_s: float, generation_s: float, sizes: Sizes):
    """One simulation and one full fit by tools that solve the circuit as differential equations.

    `fit_s` is our search with the reduction, `generation_s` one generation of the scan.
    """
    evaluations = POPULATION * sizes.generations
    if not measured:
        return [f"PyBOP and PyBaMM could not be run in an environment of their own: {why_not}"]
    lines = [
        f"| tool | one simulation | of ours | {evaluations:,} evaluations | of ours |",
        "|---|---|---|---|---|",
    ]
    each_s = generation_s / POPULATION
    lines.append(f"| barnax | {seconds(each_s)} | 1 | {seconds(fit_s)} | 1 |")
    for name in ("PyBaMM", "PyBOP"):
        one_s, all_s = measured[name]["simulation_s"], whole_fit_s(measured, name, sizes)
        lines.append(
            f"| {name} | {seconds(one_s)} | {one_s / each_s:,.0f} | {all_s / 3600:.1f} h, "
            f"extrapolated | {all_s / fit_s:,.0f} |"
        )
    versions = ", ".join(f"{name} {each}" for name, each in measured["versions"].items())
    spent = measured["PyBOP"]["evaluations"]
    return [
        *lines,
        "",
        f"{versions}, in an environment of their own; two RC pairs without hysteresis on the same "
        "record, solvers at their defaults (PyBaMM with IDAKLU, PyBOP with the solver it "
        f"recommends). PyBOP's fit was stopped after {spent} evaluations and "
        f"{measured['PyBOP']['fit_s']:.0f} s; the whole is that in proportion, PyBaMM's its "
        "simulation times the evaluations. Ours: a simulation is one of the "
        f"{POPULATION} of a scan's generation, the fit a compressed search with the reduction. "
        f"PyBaMM reads the current linearly between samples and solves for temperature too; its "
        f"voltage is {1e3 * measured['PyBaMM']['difference_v']:.2f} mV rms from ours.",
    ]
