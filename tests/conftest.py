"""What holds for every test."""

import gc
import os

os.environ.pop("COLUMNS", None)  # workers of pytest-xdist are told a width

# What tests compile runs once and briefly: most of their time with JAX is XLA's, so it optimises
# little, as ``sysid.runners.compiled`` has it for steps.
XLA = "xla_backend_optimization_level=0", "xla_cpu_use_fusion_emitters=false"
os.environ.setdefault("XLA_FLAGS", " ".join(f"--{flag}" for flag in XLA))

os.fsync = lambda _: None  # files of a test need not outlive a power cut

gc.set_threshold(100_000, 20, 50)  # full collections are seldom worth their time here


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not go over them again."""
    gc.collect()
    gc.freeze()
