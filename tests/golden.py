"""Golden files: what a screen or a report says, word for word.

`BARNAX_GOLDEN=write python -m pytest -n0 tests/reporting tests/cli` writes them anew; read the
difference before you commit it. `golden/result.json`, which the reports are of, is that of
`tests/cli`, so write that folder's first.
"""

import os
from pathlib import Path

FOLDER = Path(__file__).parent / "golden"
RESULT = FOLDER / "result.json"
IS_WRITING = os.environ.get("BARNAX_GOLDEN") == "write"


def require_golden(name: str, text: str) -> None:
    """Compare a text with the golden file of that name, but for blanks at the ends of lines."""
    text = "".join(f"{line.rstrip()}\n" for line in text.splitlines())
    if IS_WRITING:
        (FOLDER / name).write_text(text, encoding="utf-8")
    assert text == (FOLDER / name).read_text(encoding="utf-8")
