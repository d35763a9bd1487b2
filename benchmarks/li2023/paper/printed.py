"""What Li et al. (2023) print: Tables 3 to 5, and what they conclude from them."""

from typing import NamedTuple


class Errors(NamedTuple):
    """RMSE in V, R2 by Eq. 24, MAPE in %, CE in V."""

    rmse_v: float
    r2: float
    mape_percent: float
    ce_v: float


# Table 3: R, Rpa, Rpb in ohm, Cpa, Cpb in F. Tables 4 and 5: identification and validation.
TABLE_3 = {
    "ls so-rc": (0.0285, 0.0395, 0.0412, 28.63, 415.76),
    "pso so-rc": (0.0356, 0.0322, 0.0485, 33.14, 390.87),
    "bmo so-rc": (0.0334, 0.0023, 0.0503, 43.31, 488.57),
    "bmo iso-rc": (0.0316, 0.0399, 0.0401, 30.23, 469.93),
    "ibmo iso-rc": (0.0301, 0.0347, 0.0434, 20.00, 377.04),
}
TABLE_4 = {
    "ls so-rc": Errors(0.0547, 0.9495, 0.85, 615.27),
    "pso so-rc": Errors(0.0495, 0.9587, 0.60, 427.81),
    "bmo so-rc": Errors(0.0514, 0.9555, 0.72, 519.90),
    "bmo iso-rc": Errors(0.0467, 0.9634, 0.55, 397.85),
    "ibmo iso-rc": Errors(0.0431, 0.9686, 0.38, 265.89),
}
TABLE_5 = {
    "ls so-rc": Errors(0.0642, 0.9112, 0.96, 637.84),
    "pso so-rc": Errors(0.0587, 0.9311, 0.84, 522.31),
    "bmo so-rc": Errors(0.0612, 0.9224, 0.91, 582.11),
    "bmo iso-rc": Errors(0.0531, 0.9385, 0.75, 443.25),
    "ibmo iso-rc": Errors(0.0483, 0.9494, 0.56, 310.86),
}
# What the paper concludes from Tables 4 and 5: the first row has the lower error.
CLAIMS = (
    ("the hysteresis correction helps BMO", "bmo iso-rc", "bmo so-rc"),
    ("IBMO is better than BMO on the corrected circuit", "ibmo iso-rc", "bmo iso-rc"),
    (
        "IBMO on the corrected circuit is better than PSO on the plain one",
        "ibmo iso-rc",
        "pso so-rc",
    ),
    ("and better than least squares on the plain one", "ibmo iso-rc", "ls so-rc"),
    ("BMO is better than least squares on the plain circuit", "bmo so-rc", "ls so-rc"),
    ("PSO is better than BMO on the plain circuit", "pso so-rc", "bmo so-rc"),
)
