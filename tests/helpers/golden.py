"""Words kept in files: a golden file holds what a command or a rule says."""

import os
from pathlib import Path


def require_golden(path: Path, text: str) -> None:
    """The text is what the golden file holds; with BARNAX_WRITE_GOLDEN set it is written there."""
    if os.environ.get("BARNAX_WRITE_GOLDEN"):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")
