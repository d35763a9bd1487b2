"""What errors below 10 % SOC count for in a fit of tables."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LowEnd:
    """How samples below 10 % SOC count, where they would decide the time constants of all others.

    Attributes:
        weight: What each of their errors is multiplied by.
        times: How many times as large as above 10 % SOC they are in a fit that counts them evenly.
        evenly_tau_s: The time constants of that fit.
    """

    weight: float
    times: float
    evenly_tau_s: tuple[float, ...]
