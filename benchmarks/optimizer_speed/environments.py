"""Environments of their own for libraries whose pins conflict with ours."""

import json
import os
import subprocess
import tempfile
import venv
from pathlib import Path

HERE = Path(__file__).parent
REQUIREMENTS = {"mealpy": "mealpy==3.0.3", "evosax": "evosax==0.3.2"}


def run_worker(library: str, folder: Path | None = None) -> dict:
    """What the worker of `library` prints, run in an environment made for it if need be.

    Raises `subprocess.CalledProcessError` where the library cannot be installed or run.
    """
    folder = folder or Path(tempfile.gettempdir()) / f"barnax-benchmark-{library}"
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        subprocess.run(
            [python, "-m", "pip", "install", "--quiet", REQUIREMENTS[library]], check=True
        )
    worker = HERE / f"{library}_worker.py"
    done = subprocess.run([python, worker], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])
