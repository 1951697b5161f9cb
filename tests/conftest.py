"""What holds for every test."""

import gc


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not go over them again."""
    gc.collect()
    gc.freeze()
