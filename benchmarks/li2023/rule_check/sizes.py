"""The experiment, the same for every library."""

POPULATION, ITERATIONS, RUNS = 30, 80, 30
# Particles cost little in every library, ours cost little altogether: more of them make the
# comparisons sharper.
PARTICLE_RUNS, OUR_RUNS = 120, 200
# Beside all nine functions as they are, these with their optimum away from the center.
SHIFTED = ("F1", "F7", "F8")
POINTS = 20

# What COCO's tables hold: 20 dimensions, 15 runs, these errors to reach.
COCO_DIMS, COCO_RUNS = 20, 15
COCO_TARGETS = (1e1, 1e0, 1e-1, 1e-2, 1e-3, 1e-5, 1e-7)
COCO_FUNCTIONS = {1: "sphere", 8: "Rosenbrock"}
