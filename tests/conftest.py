"""What holds for every test."""

import gc
import os

os.environ.pop("COLUMNS", None)  # workers of pytest-xdist are told a width

os.fsync = lambda _: None  # files of a test need not outlive a power cut

gc.set_threshold(100_000, 20, 50)  # full collections are seldom worth their time here


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not go over them again."""
    gc.collect()
    gc.freeze()
