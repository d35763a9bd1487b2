"""A good engineer's twenty lines: SciPy's lfilter under SciPy's optimizers."""

import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution, least_squares
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

import barnax

from .sizes import KEY


class Filtered:
    """One problem as plain arrays, searched over logarithms of R0, R1, tau1, R2 and tau2."""

    def __init__(self, problem: barnax.Problem):
        inputs = problem.all_inputs[0]
        self.current_a = np.asarray(inputs.current_a)
        self.base_v = np.asarray(inputs.base_error_v)
        box = problem.log_coordinates
        self.lower, self.upper = np.asarray(box.lower), np.asarray(box.upper)

    def errors(self, point: np.ndarray) -> np.ndarray:
        """Errors of terminal voltage, in V, at every sample."""
        r0, r1, tau1, r2, tau2 = np.exp(point)
        error_v = self.base_v + r0 * self.current_a
        for r, tau in ((r1, tau1), (r2, tau2)):
            decay = np.exp(-1 / tau)
            error_v += lfilter([0, r * (1 - decay)], [1, -decay], self.current_a)
        return error_v

    def rmse(self, point: np.ndarray) -> float:
        """Root mean square error, in V."""
        # Not a dot product, which linear algebra on several threads makes slower here.
        return float(np.sqrt(np.mean(np.square(self.errors(point)))))

    def evolve(self, generations: int, population: int) -> OptimizeResult:
        """SciPy's differential evolution with the same budget, and nothing that stops it early."""
        found = differential_evolution(
            self.rmse,
            list(zip(self.lower, self.upper, strict=True)),
            popsize=population // len(self.lower),
            maxiter=generations - 1,
            tol=0,
            # At zero it would end once all its candidates are one, bit for bit.
            atol=-1,
            polish=False,
            rng=np.random.default_rng(KEY),
        )
        if found.nfev != generations * population:
            raise SystemExit(f"differential evolution spent {found.nfev} evaluations")
        return found

    def descend(self, starts: np.ndarray) -> list[OptimizeResult]:
        """SciPy's bounded least squares from every start, at its defaults."""
        # One thread is as fast for a Jacobian of five columns, and steals from nobody.
        with threadpool_limits(1, "blas"):
            return [
                least_squares(self.errors, start, bounds=(self.lower, self.upper), method="trf")
                for start in starts
            ]
