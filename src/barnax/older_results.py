"""Older versions of `result.json`, turned into today's."""

from typing import Any

from .cell.elements import RC, names_of
from .cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION, OHMIC, RATE
from .errors import InputError

Json = dict[str, Any]
SCHEMA_VERSION = 5
# What version 2 held of the constant circuit beside the answer.
CONSTANT_KEYS = (
    "parameters", "answer_source", "at_bound", "global_optimum", "assessment", "other_hold",
    "search", "refined", "bounds", "fixed",
)  # fmt: skip


def upgraded(document: Json, file: str) -> Json:
    """The document in today's version, as far as it is one of an older one.

    Raises `InputError` for version 1, which has not what is needed, and for damaged tables.
    """
    version = document.get("schema_version")
    if version == 1:
        raise InputError(
            f"{file}: this file has schema version 1; run its stored command again to write "
            f"version {SCHEMA_VERSION}"
        )
    if version not in (2, 3, 4):
        return document
    # Warnings were texts until version 3, which `Told` reads.
    document = {**document, "schema_version": SCHEMA_VERSION}
    try:
        if version == 2:
            _split_constant(document)
        for fit in (document.get("tables") or {}).get("fits", ()):
            fit["tables"] = _named(fit["tables"])
    except (AttributeError, KeyError, TypeError, ValueError) as problem:
        reason = f"its tables are damaged ({type(problem).__name__}: {problem})"
        raise InputError(f"{file}: not a barnax result: {reason}") from problem
    return document


def _split_constant(document: Json) -> None:
    constant = {key: document.pop(key) for key in CONSTANT_KEYS if key in document}
    document.pop("expected_tables [V]", None)
    metrics, tables = document.get("metrics"), document.get("tables")
    if isinstance(tables, dict):
        document["metrics"] = tables.pop("metrics", None)
        if isinstance(tables.get("settings"), dict):
            # The correction was free before this was a choice.
            tables["settings"].setdefault("rising_ocv", False)
    own = {"model": document.get("model"), "source": constant.pop("answer_source", None)}
    document["constant"] = own | {"metrics": metrics} | constant


def _named(tables: Json) -> Json:
    """Tables by name, which had their places until version 4."""
    taus_s = tables["tau [s]"]
    names = names_of(tables.get("elements") or (RC.name,) * len(taus_s))
    rows = {OHMIC: tables["r0 [Ohm]"]}
    rows |= dict(zip((own.resistance for own in names), tables["r [Ohm]"], strict=True))
    more = {OCV_CORRECTION: "ocv_correction [V]", HALF_HYSTERESIS: "half_hysteresis [V]"}
    rows |= {name: tables[key] for name, key in more.items() if tables.get(key) is not None}
    scales = dict(zip((own.tau for own in names), taus_s, strict=True))
    if tables.get(RATE) is not None:
        scales[RATE] = tables[RATE]
    kept = {key: tables[key] for key in ("nodes", "visited", "dependence") if key in tables}
    return {"tables": rows, "scales": scales, **kept}
