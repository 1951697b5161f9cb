"""Search guided by coverage where atheris is installed: ``with_atheris.py PARSER [-runs=N]``.

The bytes that it makes are the file itself, or the seed of a drawn fault where they are eight.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

import atheris  # type: ignore[import-not-found]
from trials import drawn, fault, valid


def main() -> None:
    """Search until something is wrong, or for as many runs as asked."""
    name = sys.argv.pop(1)
    with tempfile.TemporaryDirectory() as folder:
        with atheris.instrument_imports(include=["sysid"]):  # parsers import where they begin
            valid(name, Path(folder))

        def one(data: bytes) -> None:
            content = drawn(name, int.from_bytes(data, "big")) if len(data) == 8 else data
            if why := fault(name, content, Path(folder)):
                raise AssertionError(why)

        atheris.Setup(sys.argv, one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
