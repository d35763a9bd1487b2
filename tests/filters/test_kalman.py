"""Both filters against plain loops in NumPy, each other, and the truth of simulated cells."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from barnax.cell import CellModel, CircuitParameters, InterpolatedCurve, SegmentedHysteresis
from barnax.execution import in_float64
from barnax.filters import Drive, ErrorModel, make_model, run_filter
from barnax.filters.kalman import PARTS, _parts
from barnax.filters.model import GRID
from barnax.scenarios import examine_innovations, mean_bounds
from helpers.results import make_cell

CIRCUIT = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1000.0, 5000.0), gamma=80.0)
ERRORS = ErrorModel(
    2e-3, (20.0, 900.0), (4e-3, 3e-3),
    soc=(0.2, 0.8), scale=(1.5, 0.7), bias_v=(6e-3, 2e-3), white_s=1.2, axis_sd=4e-3,
)  # fmt: skip
REST_A, SLOW, SLOW_SD = 0.02, ("offset", "capacity"), (0.02, 0.05)
SAMPLES, OF_A_LOOP = 400, 120


def profile(samples=SAMPLES, seed=0, currents_a=(3.0, 1.0, 0.0, -1.5)):
    """Intervals that differ, and currents of both signs, some of them resting."""
    generator = np.random.default_rng(seed)
    interval_s = np.append(0.0, generator.uniform(0.5, 3.0, samples - 1))
    current_a = np.repeat(generator.choice(currents_a, samples // 8), 8)
    return interval_s, current_a


def drive_of(interval_s, current_a, voltage_v):
    held_a = np.append(0.0, current_a[:-1])
    moved = np.where(np.abs(held_a) >= REST_A, held_a, 0.0)
    direction = np.ones_like(held_a)
    for index in range(len(held_a)):
        last = current_a[: index + 1][np.abs(current_a[: index + 1]) >= REST_A]
        direction[index] = -np.sign(last[-1]) if len(last) else 1.0
    arrays = (interval_s, held_a, moved, current_a, direction, voltage_v)
    return Drive(*(jnp.asarray(each) for each in arrays))


class Plain:
    """The same cell written out once more: loops, analytic slopes, LAPACK's Cholesky factor."""

    def __init__(self, circuit, cell):
        self.circuit, self.cell = circuit, cell
        self.is_dynamic = circuit == "esc"
        self.first_error = 3 + self.is_dynamic
        # Two parts that last, and the bias.
        self.count = self.first_error + 3
        step = GRID[1] - GRID[0]
        # OCV, half the hysteresis voltage, the scale of errors, the bias; and the chords of each.
        self.on_grid = []
        for curve in (
            self.cell.average_ocv_v,
            self.half_gap_v,
            lambda soc: np.interp(soc, ERRORS.soc, ERRORS.scale),
            lambda soc: np.interp(soc, ERRORS.soc, ERRORS.bias_v),
        ):
            ahead, behind = (np.asarray(curve(GRID + by)) for by in (step, -step))
            self.on_grid.append((curve(GRID), (ahead - behind) / (2 * step)))

    def curves(self, soc):
        """OCV, half the hysteresis voltage, the scale of errors, the bias, and slopes of each:
        between points of the grid those of chords over two of its steps."""
        for values, chords in self.on_grid:
            yield np.interp(soc, GRID, values), np.interp(soc, GRID, chords)

    def half_gap_v(self, soc):
        """Half of the segments' gap, or with a hysteresis of its own half of the branches'."""
        if self.circuit == "so-rc":
            return 0 * soc
        of_cell = self.cell.branch_gap_v if self.is_dynamic else self.cell.hysteresis_v
        return of_cell(soc) / 2

    def advance(self, x, dt, held, turning):
        offset, capacity_as = x[-2], 3600 * 2.0 * np.exp(x[-1])
        slope = np.eye(len(x))
        new = x.copy()
        new[0] -= dt * (held - offset) / capacity_as
        slope[0, -2], slope[0, -1] = dt / capacity_as, dt * (held - offset) / capacity_as
        for pair, (r, tau_s) in enumerate(zip(CIRCUIT.r, CIRCUIT.tau_s, strict=True), 1):
            gain = 1 - np.exp(-dt / tau_s)
            new[pair] += gain * (r * (held - offset) - x[pair])
            slope[pair, pair], slope[pair, -2] = 1 - gain, -gain * r
        if self.is_dynamic:
            passed = abs(turning) * dt / (3600 * 2.0)
            left = np.exp(-CIRCUIT.gamma * passed)
            toward = -np.sign(turning)
            new[3] = toward + left * (x[3] - toward)
            slope[3, 3] = left
        for place, (tau_s, _) in enumerate(self.lasting(held), self.first_error):
            new[place] = slope[place, place] = np.exp(-dt / tau_s)
            new[place] *= x[place]
        place = self.count - 1
        slope[place, place] = self.bias_left(dt, held)
        new[place] = slope[place, place] * x[place]
        return new, slope

    def lasting(self, held):
        """How long each error lasts, and its size; at rest an hour at least, and thrice it."""
        for tau_s, sd in zip(ERRORS.correlation_s, ERRORS.sd_v, strict=True):
            yield (max(tau_s, 3600.0), 3 * sd) if abs(held) < REST_A else (tau_s, sd)

    def bias_left(self, dt, held):
        return np.exp(-abs(held) * dt / (3600 * 2.0) / 0.05)

    def voltage(self, x, dt, current, direction, near):
        """The sizes of errors are those at the SOC `near`, whatever the state's own."""
        (ocv, ocv_slope), (half, half_slope), *_ = self.curves(x[0])
        (scale, _), (bias, _) = list(self.curves(near))[2:]
        h = {"so-rc": 0.0, "iso-rc": direction, "esc": x[3]}[self.circuit]
        errors = slice(self.first_error, self.count - 1)
        slope = np.zeros(len(x))
        slope[0] = ocv_slope + h * half_slope
        slope[self.count - 1] = bias
        slope[1:3], slope[errors], slope[-2] = -1.0, scale, CIRCUIT.r0
        if self.is_dynamic:
            slope[3] = half
        drop = CIRCUIT.r0 * (current - x[-2]) + x[1] + x[2]
        missed = scale * x[errors].sum() + bias * x[self.count - 1]
        often = max(1.0, 1.2 / dt) if dt else 1.0
        return ocv + h * half - drop + missed, slope, (scale * 2e-3) ** 2 * often

    def walk(self, dt, held):
        q = np.zeros(self.count + 2)
        q[0] = (REST_A / 5 * dt / 3600 / 2.0) ** 2
        for index, (tau_s, sd) in enumerate(self.lasting(held), self.first_error):
            q[index] = sd**2 * (1 - np.exp(-2 * dt / tau_s))
        q[self.count - 1] = 1 - self.bias_left(dt, held) ** 2
        q[-2:] = np.array(SLOW_SD) ** 2 * dt / 360_000
        return np.diag(q)

    def points(self, x, p):
        root = np.linalg.cholesky(p) * np.sqrt(len(x) + 1)
        weights = np.full(2 * len(x) + 1, 0.5 / (len(x) + 1))
        weights[0] = 1 / (len(x) + 1)
        return np.concatenate([x[None], x + root.T, x - root.T]), weights

    def run(self, kind, x, p, drive):
        actual, rejected_s = [], 0.0
        for dt, held, turning, current, direction, measured in zip(*drive, strict=True):
            if kind == "ekf":
                x, slope = self.advance(x, dt, held, turning)
                p = slope @ p @ slope.T + self.walk(dt, held)
                v, slope, r = self.voltage(x, dt, current, direction, x[0])
                with_state, variance = p @ slope, slope @ p @ slope
            else:
                points, w = self.points(x, p)
                moved = np.array([self.advance(each, dt, held, turning)[0] for each in points])
                x = w @ moved
                p = (w[:, None] * (moved - x)).T @ (moved - x) + self.walk(dt, held)
                points, w = self.points(x, p)
                seen = [self.voltage(each, dt, current, direction, x[0])[0] for each in points]
                v, r = w @ seen, self.voltage(x, dt, current, direction, x[0])[2]
                seen = np.array(seen)
                with_state = (w * (seen - v)) @ (points - x)
                variance = w @ (seen - v) ** 2
            s = variance + r
            is_near = abs(measured - v) <= 10 * np.sqrt(s)
            if is_near or rejected_s > 60:
                x = x + with_state / s * (measured - v)
                p = p - np.outer(with_state, with_state) / s
                rejected_s = 0.0 if is_near else rejected_s
            else:
                rejected_s += dt
            actual.append((x[0], np.sqrt(p[0, 0] + 4e-3**2), *x[-2:], measured - v, np.sqrt(s)))
        return np.array(actual)


@pytest.mark.parametrize(
    ("kind", "circuit"),
    [
        ("ekf", "so-rc"),
        ("ukf", "esc"),
        *(pytest.param("ekf", name, marks=pytest.mark.slow) for name in ("iso-rc", "esc")),
        *(pytest.param("ukf", name, marks=pytest.mark.slow) for name in ("so-rc", "iso-rc")),
    ],
)
def test_a_filter_is_a_plain_loop_in_numpy(circuit, kind):
    cell = make_cell()
    voltage_v = np.random.default_rng(1).normal(3.75, 0.05, OF_A_LOOP)
    drive = drive_of(*profile(OF_A_LOOP), voltage_v)
    actual, plain = both(cell, circuit, kind, drive)
    for index, name in enumerate(("soc", "soc_sd")):
        assert np.abs(getattr(actual, name) - plain[:, index]).max() < 1e-10
    assert np.abs(actual.slow - plain[:, 2:4]).max() < 1e-10
    assert np.abs(actual.innovation_v - plain[:, 4]).max() < 1e-10
    assert np.abs(actual.innovation_sd_v - plain[:, 5]).max() < 1e-10


@in_float64
def both(cell, circuit, kind, drive):
    drive = jax.tree.map(lambda each: jnp.asarray(np.asarray(each), float), drive)
    model = make_model(
        cell, circuit, CIRCUIT, ERRORS, rest_current_a=REST_A, slow=SLOW, slow_sd=SLOW_SD
    )
    # LAPACK's factor needs a variance everywhere.
    state, variance = model.start(0.6, 0.1, 1.0, 0.3)
    actual = jax.jit(run_filter, static_argnums=3)(model, (state, variance), drive, kind)
    x = np.concatenate([state, np.zeros(2)])
    p = np.diag(np.concatenate([variance, np.array(SLOW_SD) ** 2]))
    plain = Plain(circuit, cell).run(kind, x, p, [np.asarray(each) for each in drive[:6]])
    return jax.tree.map(np.asarray, actual), plain


LASTING = ErrorModel(2e-3, (60.0,), (3e-3,))
BIASED = ErrorModel(2e-3, (60.0,), (3e-3,), bias_v=(1e-2,))


def straight_cell(ocv_v=lambda soc: 3.2 + soc):
    """OCV straight over SOC: with known parameters everything is linear."""
    soc = np.linspace(0.0, 1.0, 21)
    cell = make_cell()
    line = InterpolatedCurve.fit(soc, ocv_v(soc))
    return CellModel(
        2.0, "given", line, line, SegmentedHysteresis.zero(), cell.charge_points, (), errors={}
    )


@in_float64
def straight_model(slow=(), slow_sd=(), **changed):
    given = {"rest_current_a": REST_A, "slow": slow, "slow_sd": slow_sd} | changed
    errors, cell = given.pop("errors", LASTING), given.pop("cell", None) or straight_cell()
    return make_model(cell, "so-rc", CIRCUIT, errors, **given)


@in_float64
def filtered(model, drive, kind, soc=0.6, sd=0.1):
    start = model.start(soc, sd, 1.0, 0.0)
    return jax.tree.map(
        np.asarray, jax.jit(run_filter, static_argnums=3)(model, start, drive, kind)
    )


@in_float64
def simulated(model, key, soc, samples=SAMPLES, **given):
    """A record of the model itself, with every noise that it speaks of, and the SOC behind it."""
    interval_s, current_a = profile(samples, **given)
    quiet = drive_of(interval_s, current_a, 0 * current_a)
    voltage_v, truth = walked(model, key, soc, quiet)
    return quiet._replace(voltage_v=voltage_v), truth


@jax.jit
def walked(model, key, soc, quiet):
    start, variance = model.start(soc, 0.1, 1.0, 0.0)
    start_key, walk_key, white_key = jax.random.split(key, 3)
    state = start + jnp.sqrt(variance) * jax.random.normal(start_key, start.shape)
    slow = jnp.zeros(0)

    def step(state, sample):
        drive, walk, white = sample
        moved = model.advance(state, slow, drive)
        moved = moved + jnp.sqrt(model.walk(drive)[0]) * walk
        voltage_v = model.voltage(moved, slow, drive)
        return moved, (
            voltage_v + jnp.sqrt(model.noise_v2(moved[0], drive.interval_s)) * white,
            moved[0],
        )

    samples = len(quiet.held_a)
    walks = jax.random.normal(walk_key, (samples, len(start)))
    whites = jax.random.normal(white_key, (samples,))
    return jax.lax.scan(step, state, (quiet, walks, whites))[1]


def test_estimation_errors_and_innovations_are_as_large_as_the_filter_says():
    """Over 100 runs of a cell with known noise, at seven times; the seed is the first tried."""
    model, runs = straight_model(), 100

    @in_float64
    def all_runs():
        def one(key):
            drive, truth = simulated(model, key, 0.6)
            actual = run_filter(model, model.start(0.6, 0.1, 1.0, 0.0), drive)
            return (
                actual.soc - truth
            ) / actual.soc_sd, actual.innovation_v / actual.innovation_sd_v

        return jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(3), runs))

    errors, innovations = (np.asarray(each) for each in all_runs())
    low, high = mean_bounds(runs)
    mean_square = np.mean(errors[:, [0, 10, 50, 100, 200, 300, -1]] ** 2, axis=0)
    assert np.all((mean_square > low) & (mean_square < high))
    low, high = mean_bounds(innovations.size)
    assert low < np.mean(innovations**2) < high
    tested = [examine_innovations(each) for each in innovations]
    # One in twenty is refused by chance.
    assert np.mean([each.are_white for each in tested]) > 0.88


@pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.slow), "dual"])
@in_float64
def test_estimates_converge_to_the_truth(kind):
    """A current offset of 20 mA and R0 three tenths too low; errors of rests hide neither."""
    truth_model, restless = straight_model(), (3.0, 1.0, 0.5, -1.5)
    drive, truth = simulated(truth_model, jax.random.key(1), 0.7, samples=4000, currents_a=restless)
    wrong = CircuitParameters.constant(0.7 * CIRCUIT.r0, CIRCUIT.r, CIRCUIT.c)
    shifted = drive._replace(held_a=drive.held_a.at[1:].add(0.02), current_a=drive.current_a + 0.02)

    believed = make_model(
        straight_cell(), "so-rc", wrong, ErrorModel(2e-3, (60.0,), (3e-3,)),
        rest_current_a=REST_A, slow=("offset", "R0"), slow_sd=(0.02, 0.3),
    )  # fmt: skip
    actual = filtered(believed, shifted, kind, soc=0.7)
    assert np.exp(actual.slow[-1, 1]) == pytest.approx(1 / 0.7, rel=0.02)
    if kind != "dual":
        # A dual filter looks one interval ahead, where an offset has moved no SOC yet.
        assert actual.slow[-1, 0] == pytest.approx(0.02, abs=0.01)
        assert abs(actual.soc[-1] - truth[-1]) < 0.01


@in_float64
def test_where_segments_of_the_ocv_meet_rounding_decides_nothing():
    """A full cell, whose OCV goes on with another slope, and the nodes of a table of it."""
    model = make_model(make_cell(), "iso-rc", CIRCUIT, ERRORS)
    for soc in (0.0, 0.2, 0.5, 0.9, 1.0):
        below, above = (model.rise(jnp.asarray(soc + by)) for by in (-1e-9, 1e-9))
        assert np.abs(below - above).max() < 1e-6


@in_float64
def test_a_gaussian_sum_is_the_mixture_that_bayes_gives():
    """In closed form: all voltages at once, of each part a normal distribution."""
    model, samples = straight_model(errors=BIASED), 32
    drive, _ = simulated(straight_model(), jax.random.key(4), 0.6)
    drive = jax.tree.map(lambda array: array[:samples], drive)
    split = jax.jit(lambda: _parts(*model.start(0.6, 0.1, 1.0, 0.0), PARTS))
    parts, _, weights = jax.tree.map(np.asarray, split())
    assert weights @ parts.mean[:, 0] == pytest.approx(0.6)
    spread = parts.covariance[:, 0, 0] + (parts.mean[:, 0] - 0.6) ** 2
    assert weights @ spread == pytest.approx(0.01, rel=0.05)

    @jax.jit
    def along(drawn):
        """The last SOC and all voltages, of a start and of what walks add."""

        def step(state, sample_and_walk):
            sample, walk = sample_and_walk
            state = model.advance(state, jnp.zeros(0), sample) + walk
            return state, model.voltage(state, jnp.zeros(0), sample)

        state, voltages_v = jax.lax.scan(step, drawn[0], (drive, drawn[1:]))
        return jnp.append(state[0], voltages_v)

    none = np.zeros((1 + samples, model.states))
    slopes = np.asarray(jax.jit(jax.jacfwd(along))(none)).reshape(1 + samples, -1)
    walks_v2 = np.asarray(jax.jit(jax.vmap(lambda each: model.walk(each)[0]))(drive))
    of_parts = []
    for mean, covariance in zip(parts.mean, parts.covariance, strict=True):
        drawn_v2 = np.concatenate([np.diag(covariance)[None], walks_v2]).ravel()
        both_v2 = slopes * drawn_v2 @ slopes.T
        both_v2[1:, 1:] += (2e-3) ** 2 * np.eye(samples)
        expected = np.asarray(along(np.concatenate([mean[None], none[1:]])))
        gain = np.linalg.solve(both_v2[1:, 1:], both_v2[1:, 0])
        missed_v = np.asarray(drive.voltage_v) - expected[1:]
        evidence = multivariate_normal(cov=both_v2[1:, 1:]).logpdf(missed_v)
        soc, left = expected[0] + gain @ missed_v, both_v2[0, 0] - gain @ both_v2[1:, 0]
        of_parts.append((soc, left, evidence))
    soc, left, evidence = np.array(of_parts).T
    weights = weights * np.exp(evidence - evidence.max())
    weights /= weights.sum()
    actual = filtered(model, drive, "sum")
    assert actual.soc[-1] == pytest.approx(weights @ soc, abs=1e-9)
    variance = weights @ (left + (soc - weights @ soc) ** 2)
    assert actual.soc_sd[-1] == pytest.approx(np.sqrt(variance), rel=1e-6)


@pytest.mark.parametrize(
    "kind", ["sum", *(pytest.param(each, marks=pytest.mark.slow) for each in ("ekf", "ukf"))]
)
@in_float64
def test_a_long_rest_tells_no_more_than_the_bias_leaves(kind):
    """The bias of 10 mV stands still at rest: with a slope of 1 V a variance of 1e-4 beside that of
    the start, and of the axis, whatever the number of samples."""
    errors = ErrorModel(2e-3, bias_v=(1e-2,), axis_sd=4e-3)
    model, rest = straight_model(errors=errors), np.zeros(20_000)
    voltage_v = 3.8 + np.random.default_rng(0).normal(0, 2e-3, len(rest))
    actual = filtered(model, drive_of(rest + 1, rest, voltage_v), kind)
    expected = np.sqrt(1 / (1 / 0.1**2 + 1 / 0.01**2) + 4e-3**2)
    assert actual.soc_sd[-1] == pytest.approx(expected, rel=0.02)


def flat_ocv_v(soc):
    """Steep ends and 20 mV between them, as of LFP."""
    return 3.3 + 0.02 * soc - 0.3 * np.exp(-soc / 0.06) + 0.2 * np.exp((soc - 1) / 0.04)


@pytest.mark.slow
@in_float64
def test_on_a_flat_ocv_the_band_of_a_gaussian_sum_holds_the_soc():
    """Over 40 runs of a cell with known errors, from starts 10 % off as a standard deviation."""
    cell = straight_cell(flat_ocv_v)
    model = straight_model(errors=BIASED, cell=cell)

    def one(key, kind):
        drive, truth = simulated(model, key, 0.6)
        actual = run_filter(model, model.start(0.6, 0.1, 1.0, 0.0), drive, kind)
        return jnp.mean(jnp.abs(actual.soc - truth) < 1.96 * actual.soc_sd)

    keys = jax.random.split(jax.random.key(5), 40)
    held = np.asarray(jax.jit(jax.vmap(lambda key: one(key, "sum")))(keys))
    assert np.mean(held) > 0.9


@pytest.mark.parametrize(
    ("circuit", "slow"),
    [("esc", SLOW), pytest.param("iso-rc", ("R0", "R1", "tau2"), marks=pytest.mark.slow)],
)
@in_float64
def test_many_cells_in_one_call_are_each_cell_alone(circuit, slow):
    interval_s, current_a = profile(80)
    voltage_v = np.random.default_rng(1).normal(3.75, 0.05, 80)
    drive = drive_of(interval_s, current_a, voltage_v)
    model = make_model(
        make_cell(), circuit, CIRCUIT, ERRORS,
        rest_current_a=REST_A, slow=slow, slow_sd=(0.02, 0.05, 0.1)[: len(slow)],
    )  # fmt: skip

    def one(capacity_ah, soc):
        other = eqx.tree_at(lambda each: each.capacity_ah, model, capacity_ah)
        return run_filter(other, other.start(soc, 0.1, 1.0, 0.3), drive)

    capacities_ah, soc = jnp.linspace(1.8, 2.2, 6), jnp.linspace(0.1, 0.9, 6)
    together, alone = jax.jit(jax.vmap(one))(capacities_ah, soc), jax.jit(one)
    for cell in (0, 5 - 1):
        for one_by_one, each in zip(alone(capacities_ah[cell], soc[cell]), together, strict=True):
            np.testing.assert_allclose(each[cell], one_by_one, rtol=0, atol=1e-12)


@in_float64
def test_a_noisier_voltage_is_believed_less():
    model = straight_model()
    drive, _ = simulated(model, jax.random.key(0), 0.6)
    noisier = eqx.tree_at(lambda each: each.white_sd_v, model, 5 * model.white_sd_v)
    quiet, noisy = (filtered(each, drive, "ekf", soc=0.5) for each in (model, noisier))
    assert np.all(noisy.soc_sd > quiet.soc_sd)
    # The first voltage brings a start that is 10 % off less near to the truth.
    assert abs(noisy.soc[0] - 0.5) < abs(quiet.soc[0] - 0.5)


def test_correlated_innovations_are_not_white():
    noise = np.random.default_rng(0).normal(size=2001)
    assert not examine_innovations(noise[1:] + 0.3 * noise[:-1]).are_white
    assert examine_innovations(noise).are_white


FAULTS = {
    "0 V": {"voltage_v": 0.0},
    "no number for V": {"voltage_v": np.nan},
    "infinite V": {"voltage_v": np.inf},
    "no number for I": {"held_a": np.nan, "current_a": np.nan},
    "5 V ten times": {"voltage_v": 5.0},
}


@in_float64
def with_fault(model, drive, fault, samples):
    """The drive with some values of other quantities from sample 200 on."""
    here = slice(200, 200 + samples)
    changed = {name: getattr(drive, name).at[here].set(value) for name, value in fault.items()}
    return filtered(model, drive._replace(**changed), "sum")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_measurement_corrects_nothing(fault):
    model = straight_model()
    drive, _ = simulated(model, jax.random.key(3), 0.6)
    model = straight_model(SLOW, SLOW_SD)
    plain = filtered(model, drive, "sum")
    samples = 10 if "ten" in fault else 1
    faulty = with_fault(model, drive, FAULTS[fault], samples)
    apart = np.abs(faulty.soc - plain.soc)
    assert np.all(apart[:200] == 0.0)
    assert np.isfinite(faulty.soc).all()
    # A single sample less tells hardly less; ungated, one of 0 V is worth a tenth of the charge.
    assert apart.max() < 2e-3
    assert np.abs(faulty.soc_sd / plain.soc_sd - 1)[-1] < 0.05


def test_a_start_that_is_wrong_is_corrected_although_it_looks_like_a_fault():
    model = straight_model()
    drive, truth = simulated(model, jax.random.key(4), 0.6)
    wrong = filtered(model, drive, "ekf", soc=0.2, sd=0.02)
    passed_s = np.cumsum(np.asarray(drive.interval_s))
    late = passed_s > 120
    assert abs(wrong.soc[0] - 0.2) < 0.02
    assert np.abs(wrong.soc[late] - np.asarray(truth)[late]).max() < 0.03
