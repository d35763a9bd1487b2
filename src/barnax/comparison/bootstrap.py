"""The stationary block bootstrap of correlated series."""

import math

import numpy as np
from jaxtyping import Float

REPLICATES = 1000
# Rows of drawn blocks in memory at a time, in blocks.
_HELD = 2_000_000


def block_length(series: Float[np.ndarray, "samples"]) -> tuple[int, bool]:
    """Samples per block, and whether the rule's cap decided it.

    The automatic rule of Politis and White, Econometric Reviews 23 (2004) 53, with the correction
    of Patton, Politis and White, 28 (2009) 372, for blocks of fixed length: autocovariances are
    summed under a flat-top window that ends at twice the lag from which on correlation is
    negligible, and the length is (2 G^2 / D)^(1/3) n^(1/3), at most 3 sqrt(n) and a third of n.
    """
    samples = len(series)
    run = max(5, math.ceil(math.sqrt(math.log10(samples))))
    widest = min(math.ceil(math.sqrt(samples)) + run, samples - 1)
    covariance = _autocovariance(series, widest)
    # Rounding of a constant is not correlation.
    if covariance[0] <= (1e-12 * np.max(np.abs(series), initial=0.0)) ** 2:
        return 1, False
    negligible = 2 * math.sqrt(math.log10(samples) / samples)
    is_small = np.abs(covariance[1:] / covariance[0]) < negligible
    starts = np.flatnonzero(np.convolve(is_small, np.ones(run), "valid") == run)
    window = min(2 * max(int(starts[0]), 1), widest) if len(starts) else widest
    lag = np.arange(1, window + 1)
    weight = np.clip(2 * (1 - lag / window), 0.0, 1.0)
    slope = 2 * np.sum(weight * lag * covariance[1 : window + 1])
    level = covariance[0] + 2 * np.sum(weight * covariance[1 : window + 1])
    cap = max(1, math.ceil(min(3 * math.sqrt(samples), samples / 3)))
    if level == 0:
        return cap, True
    length = max(1, math.ceil((1.5 * (slope / level) ** 2 * samples) ** (1 / 3)))
    # If the correlation does not end, the sums above are truncated, and so is the length.
    return min(length, cap), length > cap or not len(starts)


def resampled_means(
    series: Float[np.ndarray, "series samples"], length: int, generator: np.random.Generator
) -> Float[np.ndarray, "series replicates"]:
    """Means of all series over the same randomly drawn blocks (Kuensch, 1989).

    Blocks overlap, and as many are drawn as cover the series. It is closed to a circle (Politis and
    Romano, 1992): otherwise its two ends, where models err most, would be drawn least.
    """
    samples = series.shape[1]
    closed = np.concatenate([np.zeros((len(series), 1)), series, series[:, : length - 1]], axis=1)
    totals = np.cumsum(closed, axis=1)
    block_means = (totals[:, length:] - totals[:, :-length]) / length
    blocks = math.ceil(samples / length)
    held = max(1, _HELD // blocks)
    means = []
    for first in range(0, REPLICATES, held):
        shape = (min(held, REPLICATES - first), blocks)
        drawn = generator.integers(0, samples, shape)
        means.append(np.stack([np.mean(block[drawn], axis=1) for block in block_means]))
    return np.concatenate(means, axis=1)


def _autocovariance(series: Float[np.ndarray, "samples"], lags: int) -> np.ndarray:
    """Autocovariance from lag 0 to `lags`, divided by the number of samples."""
    centered = series - np.mean(series)
    padded = 1 << (len(series) + lags).bit_length()
    power = np.abs(np.fft.rfft(centered, padded)) ** 2
    return np.fft.irfft(power, padded)[: lags + 1] / len(series)
