"""Where the errors are: along time, by state of charge, by current and by temperature."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..model.inputs import PreparedRecord
from ..search.refine import Refinement
from .linearization import Linearization
from .noise import Noise

SOC_EDGES = np.linspace(0, 1, 11)
# Multiples of the current that empties the cell in an hour.
RATE_EDGES = (0.2, 1.0, 2.0)
TEMPERATURE_STEPS = (1.0, 2.0, 5.0, 10.0)
MOST_TEMPERATURES = 8
# A band is worth a sentence where its share of the squared error is this many times its samples'.
NOTABLE = 2.0
NOTABLE_SHARE = 0.2


@dataclass(frozen=True)
class Band:
    """Errors of the samples in one band; `share` is their part of the summed squared error.

    `mean_v` is measured minus simulated.
    """

    label: str
    samples: int
    rmse_v: float
    mean_v: float
    share: float


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """How the errors hang together and where they are large.

    `autocorrelation` holds the residuals' correlation at `lags_s`. `integrated_time_s` is the time
    over which the noise, with what the fit followed of it, is as good as one sample.
    """

    lags_s: Float[np.ndarray, "lags"]
    autocorrelation: Float[np.ndarray, "lags"]
    integrated_time_s: float
    effective_samples: float
    samples: int
    by_soc: tuple[Band, ...]
    by_current: tuple[Band, ...]
    by_temperature: tuple[Band, ...] | None

    @property
    def words(self) -> str:
        sentences = [
            f"Errors stay alike for {self.integrated_time_s:.3g} s: about a constant, "
            f"{self.samples} samples tell as much as {max(self.effective_samples, 1):.3g} "
            "independent ones."
        ]
        for bands, where in (
            (self.by_soc, "SOC"),
            (self.by_current, ""),
            (self.by_temperature, ""),
        ):
            sentences += _notable(bands or (), where)
        return " ".join(sentences)

    def to_dict(self) -> dict[str, Any]:
        def bands(given: Sequence[Band] | None):
            return None if given is None else [_stored(band) for band in given]

        return {
            "lags [s]": self.lags_s.tolist(),
            "autocorrelation": self.autocorrelation.tolist(),
            "integrated_time [s]": self.integrated_time_s,
            "effective_samples": self.effective_samples,
            "by_soc": bands(self.by_soc),
            "by_current": bands(self.by_current),
            "by_temperature": bands(self.by_temperature),
            "words": self.words,
        }


def diagnostics(refinement: Refinement, linearization: Linearization, noise: Noise) -> Diagnostics:
    """The residuals of a refined answer over the scored samples of its records."""
    problem = refinement.search.problem
    prepared_records = problem.prepared_records
    capacity_ah = problem.cell.capacity_ah
    interval_s = float(np.median(np.diff(linearization.time_s)))
    time_s = noise.integrated_time(interval_s)
    rest_c = max(prepared.rest_current_a for prepared in prepared_records) / capacity_ah
    rate = _scored(prepared_records, "current_a") / capacity_ah
    return Diagnostics(
        lags_s=noise.lags_s,
        autocorrelation=noise.autocorrelation,
        integrated_time_s=time_s,
        effective_samples=linearization.samples * interval_s / max(time_s, interval_s),
        samples=linearization.samples,
        by_soc=_soc_bands(_scored(prepared_records, "soc"), linearization.error_v),
        by_current=_current_bands(rate, linearization.error_v, rest_c),
        by_temperature=_temperature_bands(prepared_records, linearization.error_v),
    )


def _scored(prepared_records: Sequence[PreparedRecord], name: str) -> Float[np.ndarray, "scored"]:
    return np.concatenate(
        [getattr(prepared, name)[prepared.scored] for prepared in prepared_records]
    )


def _soc_bands(soc: np.ndarray, error_v: np.ndarray) -> tuple[Band, ...]:
    edges = SOC_EDGES.copy()
    edges[[0, -1]] = -np.inf, np.inf  # measured SOC may leave 0 to 1 a little
    labels = [
        f"{100 * low:.0f} to {100 * high:.0f} %" for low, high in itertools.pairwise(SOC_EDGES)
    ]
    return _bands(soc, error_v, edges, labels)


def _current_bands(rate: np.ndarray, error_v: np.ndarray, rest_c: float) -> tuple[Band, ...]:
    ends = [rest_c, *(edge for edge in RATE_EDGES if edge > rest_c)]
    ranges = [f"{low:.2g} to {high:.2g} C" for low, high in itertools.pairwise(ends)]
    ranges.append(f"above {ends[-1]:.2g} C")
    labels = [f"charge {text}" for text in reversed(ranges)]
    labels += ["rest", *(f"discharge {text}" for text in ranges)]
    edges = np.array([-np.inf, *(-end for end in reversed(ends)), *ends, np.inf])
    return _bands(rate, error_v, edges, labels)


def _temperature_bands(
    prepared_records: Sequence[PreparedRecord], error_v: np.ndarray
) -> tuple[Band, ...] | None:
    measured = [prepared.record.temperature_degc for prepared in prepared_records]
    parts = [
        each[prepared.span][prepared.scored]
        for each, prepared in zip(measured, prepared_records, strict=True)
        if each is not None
    ]
    if len(parts) < len(prepared_records):
        return None
    temperature = np.concatenate(parts)
    low, high = np.nanmin(temperature), np.nanmax(temperature)
    step = next(
        (step for step in TEMPERATURE_STEPS if (high - low) / step <= MOST_TEMPERATURES),
        (high - low) / MOST_TEMPERATURES,
    )
    edges = step * np.arange(np.floor(low / step), np.floor(high / step) + 2)
    labels = [f"{first:g} to {second:g} degC" for first, second in itertools.pairwise(edges)]
    return _bands(temperature, error_v, edges, labels)


def _bands(
    quantity: np.ndarray, error_v: np.ndarray, edges: np.ndarray, labels: Sequence[str]
) -> tuple[Band, ...]:
    """The bands that hold samples; each includes its lower end."""
    total = float(error_v @ error_v)
    place = np.digitize(quantity, edges) - 1
    bands = []
    for index, label in enumerate(labels):
        inside = error_v[place == index]
        if len(inside):
            squares = float(inside @ inside)
            bands.append(
                Band(
                    label=label,
                    samples=len(inside),
                    rmse_v=float(np.sqrt(squares / len(inside))),
                    mean_v=float(np.mean(inside)),
                    share=squares / total if total > 0 else 0.0,
                )
            )
    return tuple(bands)


def _notable(bands: Sequence[Band], where: str) -> list[str]:
    samples = sum(band.samples for band in bands)
    return [
        f"{100 * band.share:.0f} % of the squared error lies at {f'{where} ' if where else ''}"
        f"{band.label}, {100 * band.samples / samples:.0f} % of the samples (RMSE "
        f"{1e3 * band.rmse_v:.3g} mV, mean {1e3 * band.mean_v:+.3g} mV)."
        for band in bands
        if band.share > NOTABLE_SHARE and band.share > NOTABLE * band.samples / samples
    ]


def _stored(band: Band) -> dict[str, Any]:
    stored = asdict(band)
    return {
        {"rmse_v": "rmse [V]", "mean_v": "mean [V]"}.get(name, name): value
        for name, value in stored.items()
    }
