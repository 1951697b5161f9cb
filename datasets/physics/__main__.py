"""Write logs of a suite: ``python -m sysid_datasets.physics --suite singles --seed 3 -o DIR``."""

import argparse
import sys
from pathlib import Path

from sysid_datasets.physics.compiled import NoCompilerError
from sysid_datasets.physics.logs import make, write
from sysid_datasets.physics.suites import SUITES, case


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m sysid_datasets.physics",
        description="Write logs of a machine simulated from physics, and the truth beside them.",
    )
    parser.add_argument("--suite", choices=list(SUITES), default="singles")
    parser.add_argument("--seed", type=int, default=0, metavar="K", help="which case of the suite")
    parser.add_argument(
        "--count", type=int, default=1, metavar="N", help="cases from --seed on, a folder each"
    )
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR")
    options = parser.parse_args(arguments)
    if options.seed < 0 or options.count < 1:
        parser.error("--seed must not be negative and --count at least 1")
    try:
        for seed in range(options.seed, options.seed + options.count):
            made = case(options.suite, seed)
            folder = options.out / made.key if options.count > 1 else options.out
            for file in write(make(made), folder):
                print(file)
    except NoCompilerError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"cannot write to {options.out}: {error.strerror or error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
