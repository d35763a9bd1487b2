"""A good engineer's lines: lfilter under SciPy's optimizers, CMA-ES, mealpy's and a grid."""

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
            error_v += self.answer(tau, r)
        return error_v

    def answer(self, tau_s: float, r_ohm: float = 1.0) -> np.ndarray:
        """Voltage across an RC pair at every sample, one a second, in V."""
        decay = np.exp(-1 / tau_s)
        return lfilter([0, r_ohm * (1 - decay)], [1, -decay], self.current_a)

    def rmse(self, point: np.ndarray) -> float:
        """Root mean square error, in V."""
        # Not a dot product, which linear algebra on several threads makes slower here.
        return float(np.sqrt(np.mean(np.square(self.errors(point)))))

    def evolve(self, generations: int, population: int) -> OptimizeResult:
        """SciPy's differential evolution with the same budget, and nothing that stops it early."""
        evolved = differential_evolution(
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
        if evolved.nfev != generations * population:
            raise SystemExit(f"differential evolution spent {evolved.nfev} evaluations")
        return evolved

    def descend(self, starts: np.ndarray) -> list[OptimizeResult]:
        """SciPy's bounded least squares from every start, at its defaults."""
        # One thread is as fast for a Jacobian of five columns, and steals from nobody.
        with threadpool_limits(1, "blas"):
            return [
                least_squares(self.errors, start, bounds=(self.lower, self.upper), method="trf")
                for start in starts
            ]

    def adapt(self) -> OptimizeResult:
        """CMA-ES at its defaults in the box scaled to one, from a random point, until it stops."""
        # Only who times it needs the extra `benchmark`.
        from cmaes import CMA

        width = self.upper - self.lower
        start = np.random.default_rng(KEY).uniform(size=len(width))
        limits = np.array([[0.0, 1.0]] * len(width))
        search, tried = CMA(start, sigma=0.3, bounds=limits, seed=KEY), []
        while not search.should_stop():
            points = [search.ask() for _ in range(search.population_size)]
            losses = [(point, self.rmse(self.lower + width * point)) for point in points]
            search.tell(losses)
            tried += losses
        point, least = min(tried, key=lambda one: one[1])
        return OptimizeResult(x=self.lower + width * point, fun=least, nfev=len(tried))

    def mate(self, generations: int, population: int) -> OptimizeResult:
        """mealpy's barnacles mating optimizer at its defaults, with the same budget."""
        from mealpy import FloatVar
        from mealpy.bio_based.BMO import OriginalBMO

        bounds = FloatVar(lb=tuple(self.lower), ub=tuple(self.upper))
        problem = {"obj_func": self.rmse, "bounds": bounds, "minmax": "min", "log_to": None}
        best = OriginalBMO(epoch=generations, pop_size=population).solve(problem, seed=KEY)
        return OptimizeResult(x=best.solution, fun=best.target.fitness)

    def project(self, nodes: int = 64) -> OptimizeResult:
        """Variable projection: the best resistances of every two time constants of a grid, from one
        Gram matrix, and a descent from the best (Golub and Pereyra, 1973). Nothing is proved."""
        log_tau = np.linspace(self.lower[2], self.upper[2], nodes)
        signals = [self.current_a, *map(self.answer, np.exp(log_tau)), self.base_v]
        fast, slow = np.triu_indices(nodes, 1)
        columns = np.stack([np.zeros_like(fast), fast + 1, slow + 1], axis=1)
        # One thread, as for the descent.
        with threadpool_limits(1, "blas"):
            gram = np.matmul(signals, np.transpose(signals))
            products = gram[columns[:, :, None], columns[:, None, :]]
            with_base = gram[columns, -1]
            # Neighbors on the grid are nearly one signal.
            damping = 1e-10 * gram[0, 0] * np.eye(3)
            ohm = np.linalg.solve(products + damping, -with_base[:, :, None])[:, :, 0]
        resistances = [0, 1, 3]
        ohm = ohm.clip(np.exp(self.lower[resistances]), np.exp(self.upper[resistances]))
        squares = np.einsum("pi,pij,pj->p", ohm, products, ohm)
        best = np.argmin(squares + 2 * np.einsum("pi,pi->p", ohm, with_base))
        start = np.empty(5)
        start[resistances] = np.log(ohm[best])
        start[[2, 4]] = log_tau[[fast[best], slow[best]]]
        (descended,) = self.descend(start.clip(self.lower + 1e-6, self.upper - 1e-6)[None])
        return descended
