"""Environments of their own for libraries whose pins conflict with ours.

They lie in the system's folder for temporary files, so a later run finds them again.
"""

import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any


class WorkerError(RuntimeError):
    """A library could not be installed, or its worker did not run; says what it wrote last."""


def make_environment(name: str, *requirements: str) -> Path:
    """The Python of the environment `name`, made if it is not there with these requirements.

    Raises `WorkerError` where they cannot be installed.
    """
    folder = Path(tempfile.gettempdir()) / f"barnax-benchmark-{name}"
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    # Written last, so an installation that was broken off is not mistaken for a whole one.
    record = folder / "requirements.txt"
    wanted = "\n".join(requirements)
    if not (python.exists() and record.exists() and record.read_text() == wanted):
        print(f"making an environment for {', '.join(requirements)}", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        _run(python, "-m", "pip", "install", "--quiet", *requirements)
        record.write_text(wanted)
    return python


def run_worker(python: Path, worker: Path, *arguments: str | Path) -> Any:
    """What the last line that `worker` prints says, as JSON.

    Raises `WorkerError` where it fails.
    """
    return json.loads(_run(python, worker, *arguments).splitlines()[-1])


def _run(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        words = (done.stderr or done.stdout).strip().splitlines()
        raise WorkerError(words[-1] if words else f"exit status {done.returncode}")
    return done.stdout
