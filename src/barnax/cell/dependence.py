"""Resistances that depend on more than the state of charge: temperature, self-heating, current, and
its direction."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..display import Brief
from ..records.lag import lagged
from ..records.quantities import KELVIN
from ..settings import CELL_DEGC

BETA, KAPPA, HEATING, ONSET = "beta [1/K]", "kappa [1/A2]", "heating tau [s]", "i0 [A]"
CHARGE = "charge ratio"
FIELDS = {
    BETA: "beta_per_k",
    KAPPA: "kappa_per_a2",
    HEATING: "heating_tau_s",
    ONSET: "onset_a",
    CHARGE: "charge_ratio",
}
Samples = Float[np.ndarray, "samples"]
Intervals = Float[np.ndarray, "intervals"]


@dataclass(frozen=True, repr=False)
class Dependence(Brief):
    """Dependence of a circuit's resistances on more than SOC, with one number for all of them.

    R(s) is a resistance at `reference_degc`, or of a cell with the average self-heating of the
    identification records. At every sample it becomes R(s) exp(-beta (T - T_ref)), with T measured;
    without a temperature, R(s) exp(-kappa (h - h_ref)), with the heating h: tau dh/dt = i^2 - h,
    and h = 0 at the start of the record. The current through the RC pairs is i0 asinh(i / i0) in
    place of i, after Butler and Volmer with transfer coefficients of one half (Plett, Battery
    Management Systems, Vol. I, 2015, Sec. 3.11). If resistances on charge are rho times those on
    discharge, they are R(s) sqrt(rho) and R(s) / sqrt(rho).

    Attributes:
        beta_per_k: Relative decrease of resistances per kelvin; 0 without a temperature.
        reference_degc: The temperature of the tables.
        kappa_per_a2: Likewise per low-passed square of the current.
        heating_tau_s: Its time constant; None without self-heating.
        reference_a2: The low-passed square of the tables.
        onset_a: i0, the current from which on the resistances of pairs fall; None if they do not.
        charge_ratio: rho; None if resistances are equal in both directions.
    """

    beta_per_k: float = 0.0
    reference_degc: float | None = None
    kappa_per_a2: float = 0.0
    heating_tau_s: float | None = None
    reference_a2: float = 0.0
    onset_a: float | None = None
    charge_ratio: float | None = None

    @property
    def numbers(self) -> dict[str, float]:
        """Its numbers by name with unit; all positive."""
        values = {name: getattr(self, field) for name, field in FIELDS.items()}
        return {name: value for name, value in values.items() if value}

    @property
    def usual(self) -> Mapping[str, "Usual"]:
        """Prior knowledge of some of its numbers."""
        priors = {HEATING: Usual(math.log(USUAL_HEATING_S), 1.0, 0.02)}
        if self.reference_degc is not None:
            priors[BETA] = Usual(math.log(arrhenius_beta(self.reference_degc)), 0.4, 0.3)
        return {name: value for name, value in priors.items() if name in self.numbers}

    def with_numbers(self, numbers: Mapping[str, float]) -> "Dependence":
        """A copy with other numbers, by name."""
        return replace(self, **{FIELDS[name]: value for name, value in numbers.items()})

    def factor(self, time_s: Samples, between_a: Intervals, degc: Samples | None) -> Samples:
        """The factor of resistances at every sample of a record, with the currents between them."""
        exponent = np.zeros(len(time_s))
        if degc is not None and self.reference_degc is not None:
            exponent -= self.beta_per_k * (degc - self.reference_degc)
        if self.heating_tau_s is not None:
            heat_a2 = heat_of(time_s, between_a, self.heating_tau_s)
            exponent -= self.kappa_per_a2 * (heat_a2 - self.reference_a2)
        return np.exp(exponent)

    def through_pairs(self, current_a: Samples) -> Samples:
        """The effective current of the RC pairs."""
        if self.onset_a is not None:
            current_a = self.onset_a * np.arcsinh(current_a / self.onset_a)
        return self.by_direction(current_a)

    def by_direction(self, current_a: Samples) -> Samples:
        """The current, discharge positive, scaled by the ratio of resistances in its direction."""
        if self.charge_ratio is None:
            return current_a
        return current_a * self.charge_ratio ** np.where(current_a < 0, 0.5, -0.5)


@dataclass(frozen=True)
class Usual:
    """The usual logarithm of a number, its standard deviation among cells, and its pull: a
    logarithm off by one has to lower the squared error by this share. Within one record temperature
    rises as SOC falls, and nearly any beta fits."""

    logarithm: float
    sd: float
    pull: float


def between(
    cold: Dependence | None, warm: Dependence | None, degc: float, share: float
) -> Dependence | None:
    """The dependence at a share of the way from a cold temperature to a warm one: beta, kappa, 1 /
    i0 and the logarithm of rho are linear in it, and zero without a dependence."""
    if cold is None and warm is None:
        return None
    first, second = (end or Dependence() for end in (cold, warm))

    def mixed(cold_value: float, warm_value: float) -> float:
        return (1 - share) * cold_value + share * warm_value

    rate = mixed(*(1 / end.onset_a if end.onset_a else 0.0 for end in (first, second)))
    taus_s = [end.heating_tau_s for end in (first, second) if end.heating_tau_s]
    beta_per_k = mixed(first.beta_per_k, second.beta_per_k)
    ratio = math.exp(mixed(*(math.log(end.charge_ratio or 1.0) for end in (first, second))))
    return Dependence(
        beta_per_k=beta_per_k,
        reference_degc=degc if beta_per_k else None,
        kappa_per_a2=mixed(first.kappa_per_a2, second.kappa_per_a2),
        heating_tau_s=mixed(taus_s[0], taus_s[-1]) if taus_s else None,
        reference_a2=mixed(first.reference_a2, second.reference_a2),
        onset_a=1 / rate if rate else None,
        charge_ratio=None if ratio == 1 else ratio,
    )


# Typical of a lithium-ion cell's resistances, from 20 to 50 kJ/mol.
USUAL_ACTIVATION_J_PER_MOL, GAS_J_PER_MOL_K = 35e3, 8.314
# The time in which a cell's temperature follows its losses: typically 10 minutes to 2 hours.
USUAL_HEATING_S = 1800.0


def arrhenius_beta(degc: float) -> float:
    """beta in 1/K of resistances with a typical activation energy, around a temperature."""
    return USUAL_ACTIVATION_J_PER_MOL / (GAS_J_PER_MOL_K * (degc - KELVIN.offset) ** 2)


def filled(time_s: Samples, degc: Samples) -> Samples | None:
    """Temperatures with missing or impossible ones interpolated from their neighbors; None if none
    is known."""
    is_plausible = (degc > CELL_DEGC[0]) & (degc < CELL_DEGC[1])
    if not np.any(is_plausible):
        return None
    return np.interp(time_s, time_s[is_plausible], degc[is_plausible])


def heat_of(time_s: Samples, between_a: Intervals, tau_s: float) -> Samples:
    """The low-passed square of the current between samples, in A^2."""
    return lagged(np.append(between_a**2, 0.0), tau_s, np.diff(time_s))
