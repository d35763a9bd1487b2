"""Paths of the virtual cells that ship with barnax, as Parquet files.

The files are simulated, not measured, as `data/virtual_cell/README.md` describes. An installed
wheel contains them beside this module, an editable install reads them from the repository.
"""

from pathlib import Path
from typing import Final, final

from .errors import InputError

BUNDLED_NAMES: Final = ("identification", "validation", "ocv_charge", "ocv_discharge")
HPPC_NAMES: Final = ("hppc_10degC", "hppc_25degC", "hppc_40degC")
# The same four files for a cell of lithium iron phosphate, with strong hysteresis on a flat curve.
LFP_NAMES: Final = tuple(f"lfp_{name}" for name in BUNDLED_NAMES)
CELL_FOLDER: Final = "virtual_cell"


def bundled_file(name: str) -> Path:
    """The path of one bundled file.

    Args:
        name: Its name without the suffix: one of `BUNDLED_NAMES`, `HPPC_NAMES` and `LFP_NAMES`.

    Raises `InputError` for another name, and if the installation lacks the file.

    >>> bundled_file("ocv_charge").name
    'ocv_charge.parquet'
    """
    names = (*BUNDLED_NAMES, *HPPC_NAMES, *LFP_NAMES)
    if name not in names:
        raise InputError(f"no bundled file is called {name!r}; the names are {', '.join(names)}")
    here = Path(__file__).resolve()
    in_wheel, in_repository = here.parent / "data", here.parents[2] / "data"
    candidates = [data / CELL_FOLDER / f"{name}.parquet" for data in (in_wheel, in_repository)]
    for path in candidates:
        if path.is_file():
            return path
    raise InputError(
        f"the bundled file {name}.parquet is missing from this installation (looked for "
        f"{' and '.join(str(path) for path in candidates)}); reinstall barnax"
    )


@final
class BundledCell:
    """The paths of the bundled cell by their role, looked up on access.

    >>> [path.name for path in BUNDLED.ocv]
    ['ocv_charge.parquet', 'ocv_discharge.parquet']
    """

    @property
    def record(self) -> Path:
        """The record to identify on."""
        return bundled_file("identification")

    @property
    def validation(self) -> Path:
        """The record to validate on."""
        return bundled_file("validation")

    @property
    def ocv(self) -> tuple[Path, Path]:
        """The OCV tests: charge, then discharge."""
        return bundled_file("ocv_charge"), bundled_file("ocv_discharge")

    @property
    def hppc(self) -> tuple[Path, ...]:
        """The pulse tests at 10, 25 and 40 degC."""
        return tuple(bundled_file(name) for name in HPPC_NAMES)


BUNDLED: Final = BundledCell()
