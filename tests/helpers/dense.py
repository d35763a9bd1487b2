"""Tables over SOC by dense algebra: every column written out, every matrix whole."""

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import t as student

from barnax import TableSettings, Window
from barnax.model.prepared import prepare_record
from barnax.uncertainty.noise import fit_noise
from helpers.made_cell import cell_with_ocv, ocv_v
from helpers.problems import drive_a
from helpers.reference import banded_response, drop_v, make_record

CAPACITY_AH, NODES, TAU_S = 0.5, (0.55, 0.65, 0.75, 0.85), (8.0, 60.0)
SETTINGS = TableSettings(nodes=NODES, folds=0, max_boxes=0, ocv_correction=False)
BOX = {"tau1 [s]": (2.0, 30.0), "tau2 [s]": (20.0, 200.0)}
LOG_SCALES = tuple(np.log(TAU_S).tolist())
# Of a difference by the logarithm of a time constant.
STEP = 1e-4


def made_record(samples=60, seed=0, noise_v=1e-3, start=0.9, interval_s=10.0, scale=1.0, **given):
    """A drive from 90 to 40 % SOC whose errors are correlated."""
    time_s = interval_s * np.arange(samples)
    current_a = scale * drive_a(samples, seed, interval=4)
    current_a[0] = 1.5
    soc = start - np.append(0.0, np.cumsum(current_a[:-1]) * interval_s) / 3600 / CAPACITY_AH
    drop = drop_v(banded_response, time_s, current_a, (0.05, (0.02, 0.03), TAU_S))
    noise = np.random.default_rng(seed).standard_normal(samples)
    noise[1:] += noise[:-1]
    return make_record(time_s, current_a, ocv_v(soc) - drop + noise_v * noise, **given)


def prepared_of(record, circuit="so-rc", soc=0.9):
    return prepare_record(record, cell_with_ocv(CAPACITY_AH), circuit, Window(initial_soc=soc))


def hats(soc, nodes):
    """Each node's share of a straight line between nodes, which goes on level."""
    return np.stack([np.interp(soc, nodes, unit) for unit in np.eye(len(nodes))], axis=1)


def columns_of(prepared, ocv_nodes=(), tau_s=TAU_S):
    """The derivatives of measured minus simulated by every node of R0, every pair's R and an OCV
    table, and the error of none."""
    driven = hats(prepared.soc, NODES) * prepared.current_a[:, None]
    pairs = [
        np.stack([banded_response(prepared.time_s, column, tau) for column in driven.T], axis=1)
        for tau in tau_s
    ]
    ocv = [-hats(prepared.soc, ocv_nodes)] if ocv_nodes else []
    return np.hstack([driven, *pairs, *ocv]), prepared.voltage_v - prepared.source_v


def fitted_tables(columns, penalty, base):
    """The tables that leave the least mean square with their penalty, by one least squares."""
    root = np.sqrt(len(base))
    rows = np.vstack([columns / root, penalty])
    return np.linalg.lstsq(rows, -np.append(base / root, np.zeros(len(penalty))))[0]


def slopes_of(prepared, values):
    """The derivatives of the error by the logarithm of every time constant."""
    slopes = []
    for moves in STEP * np.eye(len(TAU_S)):
        above, below = (columns_of(prepared, (), TAU_S * np.exp(way * moves))[0] for way in (1, -1))
        slopes.append((above - below) @ values[: above.shape[1]] / (2 * STEP))
    return np.stack(slopes, axis=1)


def penalty_of(scale=1.0, ocv_nodes=(), ocv_ridge=0.0):
    """The rows whose squares are added to the mean square: bends, and a ridge at every node."""
    tables = [(NODES, CAPACITY_AH, SETTINGS.resistance_ridge)] * 3
    tables += [(ocv_nodes, 1.0, ocv_ridge)] if ocv_nodes else []
    blocks = []
    for nodes, weight, ridge in tables:
        eye = np.eye(len(nodes))
        bends = np.sqrt(SETTINGS.roughness) * (eye[2:] - 2 * eye[1:-1] + eye[:-2])
        blocks.append(weight * np.sqrt(scale) * np.vstack([bends, np.sqrt(ridge) * eye]))
    return block_diag(*blocks)


def fitted_noise(columns, error, time_s):
    """The noise of some errors, and the unit columns by which it is projected."""
    unit = np.linalg.qr(columns)[0]
    return fit_noise(error, unit, time_s), unit


def covariance_of(columns, error, time_s):
    """G, the covariance of the noise at every two samples."""
    noise, _ = fitted_noise(columns, error, time_s)
    lag_s = np.abs(time_s[:, None] - time_s)
    parts = zip(noise.variance_v2[1:], noise.correlation_s[1:], strict=True)
    correlated = sum(variance_v2 * np.exp(-lag_s / within_s) for variance_v2, within_s in parts)
    return noise.variance_v2[0] * np.eye(len(time_s)) + correlated


def reaches_of(directions, columns, penalty, error, time_s):
    """Standard errors of combinations of what moves the columns, and half their 95 % intervals:
    Student's t times the root of d' H^-1 J' G J H^-1 d."""
    normal = columns.T @ columns / len(time_s) + penalty.T @ penalty
    moved = directions @ np.linalg.solve(normal, columns.T) / len(time_s)
    noise, unit = fitted_noise(columns, error, time_s)
    errors = np.sqrt(np.diag(moved @ covariance_of(columns, error, time_s) @ moved.T))
    freedom = [max(1.0, min(noise.degrees_of_freedom(row), 1e6)) for row in moved @ unit]
    return errors, student.ppf(0.975, freedom) * errors
