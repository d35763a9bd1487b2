"""The public records of the board, where each of them is, and the one split."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import barnax
from barnax import Window

# Published by, under which terms, and where.
CALCE = (
    "CALCE, University of Maryland: INR 18650-20R, open access with reference to Zheng et al. "
    "(2016), no licence stated; https://calce.umd.edu/battery-data"
)
LG = (
    "Kollmeyer, Vidal, Naguib and Skells: LG 18650HG2 Li-ion Battery Data, CC BY 4.0; "
    "https://doi.org/10.17632/cp3473x7xv"
)
PLETT = (
    "Plett: ESC toolbox, A123 26650, terms of the toolbox not stated; "
    "http://mocha-java.uccs.edu/BMS1"
)
HERE = "made with PyBaMM, in this repository"


@dataclass(frozen=True)
class Split:
    """A record to fit to and one that is left out, of one cell at one temperature.

    `ocv` are its OCV tests, `capacity_ah` what both are counted over where the tests do not say.
    """

    name: str
    source: str
    ocv: tuple[Path, ...]
    fitted: tuple[Path, Window]
    left_out: tuple[Path, Window]
    capacity_ah: float | None = None

    @property
    def file_name(self) -> str:
        """What the file of a submitted circuit is called."""
        return self.name.lower().replace(" ", "_").replace(",", "") + ".csv"


def splits(folder: Path | None) -> Iterator[Split]:
    """Every split whose records are here."""
    whole = Window()
    bundled = barnax.bundled_file("ocv_discharge"), barnax.bundled_file("ocv_charge")
    fitted, left_out = barnax.bundled_file("identification"), barnax.bundled_file("validation")
    yield Split("virtual NMC cell", HERE, bundled, (fitted, whole), (left_out, whole))
    if folder is None:
        return
    calce, lg, plett = (
        folder / name for name in ("calce-inr18650-20r", "lg-hg2-18650", "plett-a123-26650")
    )
    test = (calce / "ocv-incremental_25degC_SP20-3.parquet",)
    profile = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
    for degc in (0, 25, 45):
        dst, us06 = (
            (calce / f"{name}_{degc}degC_80soc_SP20-2.parquet", profile) for name in ("dst", "us06")
        )
        yield Split(f"CALCE INR18650-20R, {degc} degC", CALCE, test, dst, us06, 2.0)
    for degc in ("-10", "0", "25"):
        at = f"{degc.replace('-', 'minus')}degC.parquet"
        mixed, us06 = ((lg / f"{name}_{at}", whole) for name in ("mixed1", "us06"))
        yield Split(f"LG HG2, {degc} degC", LG, (lg / f"c20_{at}",), mixed, us06)
    tests = plett / "ocv-s1_25degC.parquet", plett / "ocv-s3_25degC.parquet"
    record, half_s = plett / "dyn-s1_25degC.parquet", 18_000.0
    first = Window(initial_soc=1.0, score_to_s=half_s)
    second = Window(initial_soc=1.0, score_from_s=half_s)
    name = "A123 26650, 25 degC, first and second half"
    yield Split(name, PLETT, tests, (record, first), (record, second))
