"""`barnax pack`: every cell of a pack from one file."""

from pathlib import Path
from typing import Any

from ..errors import InputError
from .options import INPUT, Files, RecordOptions, Tables, argument, flag, group, option
from .output import Output
from .session import as_flags, use_compilation_cache

FOLDER = Path("barnax-pack")


@group
class OfPack:
    """The file of a pack, and how its cells are told."""

    record: Path = argument("FILE", "Record with one current and many cell voltages.")
    cells: str | None = option(
        INPUT,
        "'V*'",
        "Columns of the cell voltages, as patterns with commas between several (default: "
        "those that are numbered alike).",
    )
    own_time_constants: bool = flag(
        INPUT, "--own-time-constants", "Let every cell have its own, instead of the mean cell's."
    )


def pack(
    on: OfPack, files: Files, of_records: RecordOptions, tables: Tables, output: Output
) -> None:
    """Identify every cell of a pack: resistances, capacity and SOC beside the mean, the odd ones.

    Writes cells.csv, a fleet's dataset of them, a figure, and the mean cell's
    result.json.
    """
    if files.validate:
        raise InputError("`validate` does nothing for a pack, whose record is the only one")
    inputs = [on.record, *(files.ocv or ())]
    session, folder = output.begun(FOLDER, inputs)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..fleet.rows import pack_rows
        from ..pack import identify_pack
        from ..reporting.pack import cells_csv, pack_document
        from ..reporting.terminal import to_terminal

    given: dict[str, Any] = {"ocv": files.ocv or (), "window": of_records.windows()}
    given |= {**files.cell, **files.read, **tables.chosen(), "watch": session.watch}
    given.pop("over", None)
    found = identify_pack(
        on.record, cells=on.cells, own_time_constants=on.own_time_constants, **given
    )
    session.show(to_terminal(pack_document(found).with_option_names(as_flags)))

    def draw() -> dict[str, bytes]:
        from ..fleet.dataset import rows_bytes
        from ..plots.pictures import encode

        return {
            "cells.parquet": rows_bytes(pack_rows(found, on.record.stem)),
            "figures/cells.png": encode(found.figure()),
        }

    document = found.result.to_json()
    beside = {"cells.csv": cells_csv(found)}
    folder, _ = output.deliver(session, folder, "result.json", document, draw, beside)
    if folder is not None:
        names = ["cells.csv", "cells.parquet", "result.json", "figures"]
        session.show_written(folder, names)
    session.warn(found.result.warnings)
