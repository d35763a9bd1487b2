"""`python -m benchmarks.schema` writes the JSON Schema of results, and the page of all codes."""

import json
from pathlib import Path

from barnax.notices import Kind, kinds
from barnax.results import Result

DIALECT = "https://json-schema.org/draft/2020-12/schema"
DOCS = Path(__file__).parents[1] / "docs"
HEAD = """# Notices

What does a warning mean, and how does a program act on it? Every warning, finding and refusal has a
code, in `InputError.code` or a `barnax.Notice`, which prints as its sentence. `result.json` and
`barnax check --json` hold code, file, row, numbers and words; a fleet's dataset has the columns
`warning codes` and `error code`.

```python
import barnax

checked = barnax.check_file(barnax.bundled_file("identification"))
for notice in checked.findings:
    print(notice.code, notice.row, notice.values)
    print(notice)
```

A finding in many samples may be more severe than usual. Click on a heading to sort the table.

| code | usually | what it means |
|---|---|---|
"""


def usual_severity(kind: Kind) -> str:
    """The severity of a code; of one that goes by a value, each that it has."""
    by_value = kind.words.get(kind.severity.strip("{}"), {"": kind.severity})
    return " or ".join(sorted(set(by_value.values())))


def notices_page() -> str:
    """Every code with its meaning, in the order of `notices.toml`."""
    return HEAD + "".join(
        f"| `{kind.code}` | {usual_severity(kind)} | {kind.means} |\n" for kind in kinds().values()
    )


def main() -> None:
    schema = {"$schema": DIALECT, **Result.json_schema()}
    text = json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
    (DOCS / "result.schema.json").write_text(text, encoding="utf-8")
    (DOCS / "notices.md").write_text(notices_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
