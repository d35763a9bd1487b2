"""Read every file of a folder in a process of little memory: `python read_under_limits.py FOLDER`.

Prints one line of JSON a file as it goes, so that the file that ended the process can be named.
"""

import json
import resource
import sys
import time
from pathlib import Path

from barnax.errors import InputError
from barnax.records import read_record

MOST_MEMORY = 6_000_000_000


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    for path in sorted(Path(sys.argv[1]).iterdir()):
        print(json.dumps({"file": path.name}), flush=True)
        start = time.perf_counter()
        outcome = "read"
        try:
            read_record(path)
        except InputError as problem:
            outcome = str(problem)
        spent = {
            "outcome": outcome,
            "seconds": time.perf_counter() - start,
            "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        }
        print(json.dumps({"file": path.name} | spent), flush=True)


if __name__ == "__main__":
    main()
