"""F1 to F9 without noise in NumPy: the objectives of libraries that call one point at a time.

Imported by workers, whose environments have neither JAX nor barnax.
"""

import numpy as np


def sphere(x):
    return x @ x


def schwefel_222(x):
    size = np.abs(x)
    return size.sum() + size.prod()


def smooth_step(x):
    return ((x + 0.5) ** 2).sum()


def schwefel_221(x):
    return np.abs(x).max()


def quartic(x):
    return _ordinals(x) @ x**4


def griewank(x):
    return x @ x / 4000 - np.cos(x / np.sqrt(_ordinals(x))).prod() + 1


def rastrigin(x):
    return (x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum()


def ackley(x):
    ripple = np.cos(2 * np.pi * x).mean()
    return -20 * np.exp(-0.2 * np.sqrt(x @ x / len(x))) - np.exp(ripple) + 20 + np.e


def penalized(x):
    y = 1 + (x + 1) / 4
    waves = (y[:-1] - 1) ** 2 * (1 + 10 * np.sin(np.pi * y[1:]) ** 2)
    inner = 10 * np.sin(np.pi * y[0]) ** 2 + waves.sum() + (y[-1] - 1) ** 2
    return np.pi / len(x) * inner + 100 * (np.maximum(np.abs(x) - 10, 0) ** 4).sum()


def _ordinals(x):
    return np.arange(1, len(x) + 1)


FUNCTIONS = {
    "F1": sphere,
    "F2": schwefel_222,
    "F3": smooth_step,
    "F4": schwefel_221,
    "F5": quartic,
    "F6": griewank,
    "F7": rastrigin,
    "F8": ackley,
    "F9": penalized,
}
