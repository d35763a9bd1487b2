"""How the suite compiles, and how users do."""

from importlib.metadata import version

# The older of two sets of kernels compiles faster. JAX 0.11 has the newer one only, and its XLA
# ends a process that is given a flag it does not know.
_HAS_OLD_KERNELS = tuple(map(int, version("jax").split(".")[:2])) < (0, 11)
# Most programs run once in the suite: optimizing them would take half of its time.
QUICK_FLAGS = (
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
    "--xla_cpu_parallel_codegen_split_count=1"
) + (" --xla_cpu_use_fusion_emitters=false" if _HAS_OLD_KERNELS else "")
# What `jax.jit` takes for a program whose bits are to be those that users get.
USERS_KERNELS = {"xla_cpu_use_fusion_emitters": True} if _HAS_OLD_KERNELS else {}
