"""Where numbers come from: versions, key, machine, date, command."""

import datetime
import importlib.metadata
import os
import platform

PACKAGES = ("barnax", "jax", "jaxlib", "optimistix", "equinox", "numpy", "scipy")


def provenance(command: str, key: int, *more_packages: str) -> dict[str, str]:
    """What a reader needs to make the same numbers again."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES + more_packages]
    return {
        "command": f"`{command}`",
        "key": str(key),
        "versions": ", ".join([f"Python {platform.python_version()}", *versions]),
        "machine": f"{os.cpu_count()} shared CPU cores, {platform.machine()}, float64",
        "date": datetime.date.today().isoformat(),
    }


def as_markdown(facts: dict[str, str]) -> str:
    """The facts as a list."""
    return "\n".join(f"- {name}: {fact}" for name, fact in facts.items())
