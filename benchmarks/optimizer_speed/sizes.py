"""The experiment, the same for every library: the sphere function in 30 dimensions."""

DIMS, HALF_WIDTH = 30, 100.0
POPULATION, ITERATIONS, RUNS = 30, 500, 30
REPEATS = 3
