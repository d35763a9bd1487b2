"""How much of the package the default suite reaches: `python -m benchmarks.branch_coverage`.

Runs the suite under coverage.py, the processes that tests start included, with the settings in
pyproject.toml. Writes benchmarks/results/branch_coverage.md: branches and lines by package, and
every place that nothing reaches. Words after the command go to pytest.
"""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import groupby
from pathlib import Path
from typing import Any

from benchmarks.pages import as_markdown, provenance, save_page

REPOSITORY = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results" / "branch_coverage.md"
PACKAGE = "src/barnax/"


def main() -> None:
    """Run the suite, print the page and write it."""
    if importlib.util.find_spec("pytest_cov") is None:
        sys.exit('this needs pytest-cov: pip install -e ".[test,develop]"')
    start = time.monotonic()
    measured = measure(sys.argv[1:])
    page = render(measured, (time.monotonic() - start) / 60)
    print(page)
    save_page(RESULTS, page)


def measure(words: list[str]) -> dict[str, Any]:
    """Coverage's own report, as JSON."""
    with tempfile.TemporaryDirectory() as folder:
        data = {"COVERAGE_FILE": str(Path(folder, "data")), "COVERAGE_CORE": "ctrace"}

        report = Path(folder, "report.json")
        # What the workers of pytest-xdist reach is lost to coverage.py without its plugin.
        options = ["--cov", f"--cov-report=json:{report}", "-p", "no:cacheprovider"]
        ran = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *words],
            cwd=REPOSITORY,
            env=os.environ | data,
        )
        if ran.returncode:
            sys.exit("the suite fails; what it reaches is not written down")
        return json.loads(report.read_text())


def render(measured: dict[str, Any], minutes: float) -> str:
    """The page of a report."""
    files = {
        name.replace("\\", "/").rpartition(PACKAGE)[2]: each
        for name, each in sorted(measured["files"].items())
    }
    totals = measured["totals"]
    lines = [
        "# What the default suite reaches",
        "",
        f"{share(totals['covered_branches'], totals['num_branches'])} of the branches and "
        f"{share(totals['covered_lines'], totals['num_statements'])} of the lines, processes that "
        f"tests start included. The run took {minutes:.0f} min.",
        "",
        as_markdown(provenance("python -m benchmarks.branch_coverage", 0, "coverage", "pytest")),
        "",
        "| package | lines | reached | branches | reached |",
        "|---|---|---|---|---|",
    ]
    for package, names in groupby(sorted(files, key=package_of), key=package_of):
        sums = [files[name]["summary"] for name in names]
        total = {key: sum(each[key] for each in sums) for key in totals if key in COUNTED}
        lines.append(
            f"| `{package or 'barnax'}` | {total['num_statements']} "
            f"| {share(total['covered_lines'], total['num_statements'])} "
            f"| {total['num_branches']} "
            f"| {share(total['covered_branches'], total['num_branches'])} |"
        )
    lines += [
        "",
        "## Not reached",
        "",
        "Lines, and branches as from line to line (0: the end).",
        "",
    ]
    for name, each in files.items():
        missed = [str(line) for line in each["missing_lines"]]
        branches = [f"{a} to {max(b, 0)}" for a, b in each["missing_branches"]]
        if missed or branches:
            lines.append(f"- `{name}`: {', '.join(missed + branches)}")
    return "\n".join(lines) + "\n"


COUNTED = ("num_statements", "covered_lines", "num_branches", "covered_branches")


def package_of(name: str) -> str:
    return name.rpartition("/")[0]


def share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} %" if whole else "-"


if __name__ == "__main__":
    main()
