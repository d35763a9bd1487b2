"""The part of the page on CMA-ES and DE: running times beside those COCO publishes."""

from typing import NamedTuple

import numpy as np

from .agreement import expected_running_time, ratio_interval
from .published import PUBLISHED, Published
from .sizes import COCO_DIMS, COCO_FUNCTIONS, COCO_RUNS, COCO_TARGETS

METHODS = {"cma-es": "CMA-ES (the `cmaes` package)", "de": "DE (SciPy)"}


class RunningTimes(NamedTuple):
    """What one method took on one function: one entry a target."""

    method: str
    function: int
    expected: list[float]
    successes: list[int]
    intervals: list[tuple[float, float]]

    @property
    def published(self) -> list[Published]:
        return [row for row in PUBLISHED if row.method == self.method]

    def are_inside(self, row: Published) -> list[bool]:
        """Whether chance alone could have made each of the published times out of ours."""
        return [
            low <= published / ours <= high
            for published, ours, (low, high) in zip(
                row.running_times(self.function), self.expected, self.intervals, strict=True
            )
        ]


def running_times(task: str, runs: list[dict]) -> RunningTimes:
    """From what the worker printed for the task, such as `cma-es-8`."""
    method, function = task.rsplit("-", 1)
    hits = np.array([run["hits"] for run in runs], float).T
    evaluations = np.array([run["evaluations"] for run in runs])
    return RunningTimes(
        method,
        int(function),
        [float(expected_running_time(row, evaluations)) for row in hits],
        [int(np.isfinite(row).sum()) for row in hits],
        [ratio_interval(row, evaluations) for row in hits],
    )


def coco_verdict(found: list[RunningTimes]) -> str:
    """One sentence."""
    inside = [
        is_in for times in found for row in times.published for is_in in times.are_inside(row)
    ]
    ratios = [
        published / ours
        for times in found
        for row in times.published
        for published, ours in zip(row.running_times(times.function), times.expected, strict=True)
    ]
    return (
        f"CMA-ES and DE on COCO's shifted functions: {sum(inside)} of {len(inside)} published "
        f"running times lie where chance puts 95 % of them; all are {min(ratios):.2f} to "
        f"{max(ratios):.2f} times ours."
    )


def coco_section(found: list[RunningTimes]) -> list[str]:
    """A table a method and function."""
    if not found:
        return []
    lines = [
        "## CMA-ES and DE on COCO's shifted functions",
        "",
        f"The baselines of centre_bias.md, by the packages used there, on COCO's f1 and f8 in "
        f"{COCO_DIMS} dimensions (the functions of the `cma` package, whose optimum lies anywhere "
        f"in the box), {COCO_RUNS} runs, an instance a run. The expected evaluations until an "
        "error is reached (COCO's running time: all evaluations spent over the runs that got "
        "there), beside those in COCO's tables and their ratio to ours, bold where it leaves the "
        "range in which 95 % of the ratios of two such experiments lie, by resampling ours.",
        "",
        "The settings of the published runs are not in the tables. CMA-ES starts uniformly in "
        "[-4, 4] with step 2; the `cmaes` package adapts actively, as the published methods but "
        "the first do. They restart where a run fails, ours does not. DE has SciPy's defaults in "
        "[-5, 5]: 300 candidates, and L-BFGS-B at the end, which is what reaches small errors.",
        "",
        "Sources: "
        + "; ".join(f"{row.name}: {row.source}" for row in PUBLISHED)
        + ". Running times: COCO's archive, https://github.com/numbbo/ppdata-archive, "
        "`pptables.html` of 2009, 2012 and 2019.",
        "",
    ]
    for times in found:
        lines += [
            f"{METHODS[times.method]} on f{times.function}, {COCO_FUNCTIONS[times.function]}:",
            "",
            "| error | " + " | ".join(f"{target:g}" for target in COCO_TARGETS) + " |",
            "|---" * (len(COCO_TARGETS) + 1) + "|",
        ]
        measured = [
            f"{time:.0f} ({successes} of {COCO_RUNS})"
            for time, successes in zip(times.expected, times.successes, strict=True)
        ]
        ranges = [f"{low:.2f} to {high:.2f}" for low, high in times.intervals]
        lines.append("| measured here (runs there) | " + " | ".join(measured) + " |")
        lines.append("| ratios by chance | " + " | ".join(ranges) + " |")
        for row in times.published:
            cells = [
                f"{published:.0f} ({published / ours:.2f})"
                for published, ours in zip(
                    row.running_times(times.function), times.expected, strict=True
                )
            ]
            shown = [
                cell if is_inside else f"**{cell}**"
                for cell, is_inside in zip(cells, times.are_inside(row), strict=True)
            ]
            lines.append(f"| {row.name} | " + " | ".join(shown) + " |")
        lines.append("")
    return lines
