"""The page: the table, growth and start-up."""

from collections.abc import Sequence

from .growth import Length, slope
from .row import Row, seconds
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
