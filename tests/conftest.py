"""What holds for every test."""

import gc


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not go over them again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)
