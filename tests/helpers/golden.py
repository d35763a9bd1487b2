"""Words kept in files: a golden file holds what a command, a report or a rule says.

`BARNAX_WRITE_GOLDEN=1 python -m pytest -n0 tests/cli tests/reporting tests/records` writes them
anew; read the difference before you commit it. `RESULT`, which the reports are of, is written by
tests/cli, so run that first.
"""

import os
from pathlib import Path

IS_WRITING = bool(os.environ.get("BARNAX_WRITE_GOLDEN"))
GOLDEN = Path(__file__).parents[1] / "golden"
RESULT = GOLDEN / "result.json"


def require_golden(path: Path, text: str) -> None:
    """The text is what the golden file holds; with BARNAX_WRITE_GOLDEN set it is written there."""
    if IS_WRITING:
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def without_blanks(text: str) -> str:
    """The text without blanks at the ends of its lines, where consoles fill them up."""
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())
