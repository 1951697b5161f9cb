"""What holds for every test."""

import gc
import os

os.environ.pop("COLUMNS", None)  # workers of pytest-xdist are told a width


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not go over them again."""
    gc.collect()
    gc.freeze()
