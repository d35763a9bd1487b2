"""`python -m benchmarks.schema` writes `docs/result.schema.json`, the JSON Schema of results."""

import json
from pathlib import Path

from barnax.results import Result

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def main() -> None:
    place = Path(__file__).parents[1] / "docs" / "result.schema.json"
    schema = {"$schema": DIALECT, **Result.json_schema()}
    place.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
