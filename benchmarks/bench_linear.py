"""How fast, how small and how right: linear estimation against plain SciPy and other packages.

    python benchmarks/bench_linear.py [file]

Every ratio is taken in one run on the same data: the contestants take turns, and the median of
their times counts. Errors are computed by one yardstick (``references.Row``) on a fresh record, as
a fast wrong answer is no win. Writes ``reports/benchmark_linear.md``; ends with 1 when a target is
missed. About ten minutes, most of them spent by the others.
"""

import os
import sys
from importlib.metadata import version
from pathlib import Path

REPORT = Path(__file__).resolve().parent.parent / "reports" / "benchmark_linear.md"

HEAD = """# Speed and memory of linear estimation

Times belong to the machine and its load, ratios much less so.
{machine}.

Each line's contestants took turns on the same data, one BLAS thread each, and the median counts.
*One step* is the RMS prediction error on a fresh record, whose noise has a standard deviation of
0.1: nothing can be better. *Free run* is the RMS distance of the simulated from the noise-free
output on that record; with the right structure it tends to 0. The whole fit of sysid includes every
start, covariance and criteria. The bare search is `scipy.optimize.least_squares(method="lm")` on
gradients by `lfilter` with zero initial conditions, from the same start and with the same
tolerances. SARIMAX is given the lags of the output as regressors, which makes it exactly ARMAX, row
by row. FROLS chooses four of the five terms itself.
"""


def main(target: Path) -> int:
    """Measure everything and write the report."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # before NumPy, for every contestant alike
    from linear_studies import STUDIES, Ledger

    from sysid.data.files import write_atomic
    from sysid.report.markdown import foot, table

    ledger = Ledger()
    parts = []
    for title, (headers, align, measure) in STUDIES.items():
        print(f"{title} …", flush=True)
        parts.append(f"## {title}\n\n{table(headers, measure(ledger), align)}")
    targets = table(["what", "measured", "target", "met"], ledger.rows, "lrrl")
    write_atomic(
        target,
        "\n".join(
            [
                HEAD.format(machine=machine()),
                targets,
                *parts,
                foot("make bench", "those of linear_studies.py"),
            ]
        ),
    )
    print(f"Written to {target}; missed: {', '.join(ledger.missed) or 'none'}")
    return 1 if ledger.missed else 0


def machine() -> str:
    """Processor and versions."""
    from peers import PEERS, processor

    base = f"NumPy {version('numpy')}, SciPy {version('scipy')}"
    packages = ", ".join(peer.label for peer in PEERS)
    return f"{processor()}; {base}; {packages}"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else REPORT))
