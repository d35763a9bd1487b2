"""How the suite compiles, and how users do."""

# Most programs run once in the suite: optimizing them would take half of its time.
QUICK_FLAGS = (
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
)
# What `jax.jit` takes for a program whose bits are to be those that users get.
USERS_KERNELS = {"xla_cpu_use_fusion_emitters": True}
