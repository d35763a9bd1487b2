"""The baseline that is hard to beat: thirty lines of C, candidates in SIMD lanes, one core."""

import ctypes
import platform
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

import barnax

SOURCE = Path(__file__).parent / "squared_errors.c"
# Of the C code; candidates are filled up to a multiple. With registers as wide as there are, twice
# or half as many lanes are slower.
LANES = 16

Kernel = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def compile_kernel(folder: Path) -> tuple[str, Kernel]:
    """What the kernel is called, and squared errors of (circuits, current, base error).

    Raises `SystemExit` where there is no C compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise SystemExit("the baseline needs a C compiler; install one")
    library = folder / "squared_errors.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
    if platform.machine() in ("x86_64", "AMD64"):
        flags.append("-mprefer-vector-width=512")
    subprocess.run([compiler, *flags, str(SOURCE), "-o", str(library)], check=True)
    kernel = ctypes.CDLL(str(library)).squared_errors
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    kernel.argtypes = [pointer, ctypes.c_size_t, pointer, pointer, ctypes.c_size_t, pointer]
    kernel.restype = None

    def run(circuits: np.ndarray, current_a: np.ndarray, base_v: np.ndarray) -> np.ndarray:
        total = np.empty(circuits.shape[1])
        kernel(circuits, circuits.shape[1], current_a, base_v, len(current_a), total)
        return total

    return "C kernel", run


def lanes_of(problem: barnax.Problem, points: np.ndarray) -> np.ndarray:
    """Circuits as the kernel takes them, one a column, filled up to full lanes."""
    circuits = jax.vmap(problem.objective.coordinates.decode)(points)
    r0, (r1, r2), (tau1, tau2) = jax.tree.map(np.asarray, (circuits.r0, circuits.r, circuits.tau))
    decay1, decay2 = np.exp(-1 / tau1), np.exp(-1 / tau2)
    table = np.stack([decay1, (1 - decay1) * r1, decay2, (1 - decay2) * r2, r0])
    return np.pad(table, ((0, 0), (0, -table.shape[1] % LANES)), mode="edge")
