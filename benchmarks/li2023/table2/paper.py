"""Table 2 of Li et al. (2023) as printed, beside which ours is set."""

from typing import NamedTuple

from .runs import OPTIMIZERS


class Cell(NamedTuple):
    """Best, mean and standard deviation of the final losses of 30 runs."""

    best: float
    mean: float
    std: float


# Columns in the order of OPTIMIZERS.
_PRINTED = """
F1 best 3.29E-06 2.58E-87 1.09E-13 1.29E-13 5.40E-30 8.72E-96 0.00E+00 0.00E+00
F1 mean 1.19E-04 1.60E-73 1.44E-11 6.71E-11 1.55E-27 6.37E-92 0.00E+00 0.00E+00
F1 std  1.37E-04 6.20E-73 3.54E-11 7.69E-11 2.95E-27 3.33E-91 0.00E+00 0.00E+00
F2 best 3.83E-03 4.80E-58 2.37E-09 6.57E-06 1.22E-17 1.82E-52 2.50E-307 0.00E+00
F2 mean 3.59E-02 2.37E-51 1.87E-08 3.85E-05 9.85E-17 3.48E-51 1.37E-284 0.00E+00
F2 std  4.44E-02 8.82E-51 1.53E-08 3.21E-05 9.42E-17 7.83E-51 0.00E+00 0.00E+00
F3 best 1.05E-05 1.47E-01 2.33E+00 5.12E-08 2.23E-01 2.00E+00 1.34E-01 1.29E-01
F3 mean 1.14E-04 4.33E-01 3.24E+00 1.41E-02 7.41E-01 2.85E+00 5.69E-01 5.36E-01
F3 std  1.13E-04 2.35E-01 5.44E-01 4.45E-02 3.53E-01 3.73E-01 2.85E-01 2.73E-01
F4 best 7.50E-01 4.10E-01 1.85E-05 9.08E-08 6.01E-08 2.13E-37 2.01E-306 0.00E+00
F4 mean 1.09E+00 5.28E+01 4.25E-03 1.29E-06 7.66E-07 5.81E-35 1.66E-285 0.00E+00
F4 std  2.11E-01 2.51E+01 7.76E-03 1.38E-06 1.20E-06 2.42E-34 0.00E+00 0.00E+00
F5 best 6.79E-02 4.28E-05 4.71E-04 1.53E-05 6.98E-04 1.11E-05 2.21E-07 1.56E-08
F5 mean 1.69E-01 4.70E-03 3.00E-03 6.03E-04 1.63E-03 3.49E-04 3.68E-05 2.83E-05
F5 std  6.08E-02 6.91E-03 2.13E-03 4.72E-04 7.60E-04 2.68E-04 3.26E-05 2.19E-05
F6 best 1.33E-06 0.00E+00 1.10E-13 2.12E-15 0.00E+00 0.00E+00 0.00E+00 0.00E+00
F6 mean 5.86E-03 3.87E-03 2.01E-02 3.52E-12 6.53E-03 1.46E-03 0.00E+00 0.00E+00
F6 std  1.03E-02 2.12E-02 2.92E-02 5.71E-12 1.17E-02 4.74E-03 0.00E+00 0.00E+00
F7 best 2.52E+01 0.00E+00 3.41E-13 3.21E-11 6.73E-14 0.00E+00 0.00E+00 0.00E+00
F7 mean 5.68E+01 0.00E+00 2.10E+00 5.02E-07 3.54E+00 0.00E+00 0.00E+00 0.00E+00
F7 std  1.54E+01 0.00E+00 4.40E+00 7.96E-07 4.50E+00 0.00E+00 0.00E+00 0.00E+00
F8 best 5.01E-03 8.88E-16 2.00E+01 1.86E-07 6.43E-14 4.23E-15 8.88E-16 8.88E-16
F8 mean 2.68E-01 4.83E-15 2.00E+01 2.38E-06 2.23E-13 5.78E-15 8.88E-16 8.88E-16
F8 std  5.32E-01 2.62E-15 1.40E-03 2.76E-06 1.42E-14 1.76E-15 4.36E-31 1.00E-31
F9 best 1.63E-07 2.02E-03 1.36E-01 6.63E-10 6.59E-03 1.25E-01 7.45E-03 6.68E-04
F9 mean 1.04E-02 3.12E-02 3.12E-01 1.48E-02 4.99E-02 2.51E-01 1.83E-01 1.35E-02
F9 std  3.16E-02 3.92E-02 1.30E-01 4.23E-02 2.99E-02 1.23E-01 4.11E-01 1.32E-02
"""


def _read(printed: str) -> dict[tuple[str, str], Cell]:
    values = {}
    for line in printed.split("\n"):
        if line:
            function, statistic, *numbers = line.split()
            for optimizer, number in zip(OPTIMIZERS, numbers, strict=True):
                values[function, optimizer, statistic] = float(number)
    names = {(function, optimizer) for function, optimizer, _ in values}
    return {name: Cell(*(values[*name, kind] for kind in Cell._fields)) for name in names}


PAPER = _read(_PRINTED)
