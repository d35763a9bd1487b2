"""The figure and the screen of the README: `python -m benchmarks.readme`.

Runs `barnax identify` as a user would, on the bundled cell, and keeps what it printed and its
summary figure in benchmarks/results/.
"""

import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

from benchmarks.pages import publish, save_file

RESULTS = Path(__file__).parent / "results"


def main() -> None:
    """Run the command, print the page and write it."""
    command = ["barnax", "identify"]
    with tempfile.TemporaryDirectory() as folder:
        ran = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=folder,
            env=os.environ | {"COLUMNS": "80"},
            check=True,
            capture_output=True,
            text=True,
        )
        figure = Path(folder) / "barnax-out" / "figures" / "summary.png"
        save_file(RESULTS / "readme.png", figure.read_bytes())
    screen = "".join(f"{line.rstrip()}\n" for line in ran.stdout.strip("\n").splitlines())
    page = (
        "# What the README shows\n\n"
        f"Printed by `python -m benchmarks.readme` on {date.today()}: the output of "
        f"`{' '.join(command)}`.\n\n```\n{screen}```\n"
    )
    publish(RESULTS / "readme.md", page)


if __name__ == "__main__":
    main()
