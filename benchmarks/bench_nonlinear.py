"""How fast and how right: wavelet NARX and Hammerstein–Wiener against packages for the same job.

    python benchmarks/bench_nonlinear.py [NAME ...] [--out FILE] [--limit SECONDS]

5 000 samples of a robot with two tracks (dead zones, sticking friction, saturation, noise of 1 %),
judged by free runs on 2 000 others. Every contestant fits in a process of its own, in the same run
on the same data. Writes ``reports/benchmark_nonlinear.md``; ends with 1 when a target is missed.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any

REPORT = Path(__file__).resolve().parent.parent / "reports" / "benchmark_nonlinear.md"
SAMPLES, TEST_SAMPLES = 5_000, 2_000
QUICK = 60.0
"""A fit that took less is run once more, for the time without compiling."""

COMMANDS = {
    "narx": ("--structure", "narx-wavelet", "--orders", "na=2 nb=2 nk=1", "--option", "units=20"),
    "hw": (
        "--structure", "hammerstein-wiener", "--orders", "nb=2 nf=2 nk=1",
        "--option", "input=dead-zone", "--option", "output=identity",
    ),
}  # fmt: skip
"""What a user would type for two of the contestants."""

TARGETS = (
    ("wavelet NARX, cold command", "narx", "command", 15.0),
    ("wavelet NARX, compiled fit", "narx", "again", 3.0),
    ("Hammerstein-Wiener, compiled fit", "hw", "again", 2.0),
)

HEAD = """# Speed and accuracy of nonlinear estimation

Times belong to the machine and its load, ratios much less so.
{machine}.

{samples} samples of the bundled robot's twin under random levels (two tracks that act on each
other, dead zones, friction that sticks, saturation, encoder noise of 1 % of the speeds' spread),
judged on {tests} other samples in free run: only the inputs and the first samples are given. *RMSE*
is against the noise-free speeds, mean of both tracks. *First* is the first fit of a process,
compiling included, *again* the same fit once more in that process; imports count in neither.
*Command* is the whole `sysid fit` from a cold start, disk caches as they are. Ratios are to the
wavelet NARX of the same run: a number above 1 is slower, or wrong by so many times. No package was
tuned to this record beyond scaling; jax-sysid 1.0.1 is the newest that takes the SciPy and JAX of
this environment.
"""


def make_data(folder: Path) -> None:
    """The two records as arrays, and the first as a log for the command."""
    import numpy as np
    from sysid_datasets.generate import OMEGA_SIGMA
    from sysid_datasets.schedules import multilevel
    from sysid_datasets.twin import simulate_truth

    arrays: dict[str, Any] = {}
    for part, seed, samples in (("est", 91, SAMPLES), ("val", 92, TEST_SAMPLES)):
        rng = np.random.default_rng(seed)
        truth = simulate_truth(multilevel(rng, 0.1 * samples - 1.0, 64, 8, (0.8, 2.5)), steps=20)
        y = truth.omega + OMEGA_SIGMA * rng.standard_normal(truth.omega.shape)
        arrays |= {f"u_{part}": truth.pwm.astype(float), f"y_{part}": y, f"w_{part}": truth.omega}
    np.savez(folder / "data.npz", **arrays)
    t = 0.1 * np.arange(len(arrays["u_est"]))
    rows = np.column_stack([t, arrays["u_est"], arrays["y_est"]])
    heads = "t,pwm_l,pwm_r,omega_l,omega_r"
    np.savetxt(folder / "est.csv", rows, "%.6g", ",", header=heads, comments="")


def measure(name: str, folder: Path) -> dict[str, Any]:
    """Fit and judge one contestant, in this process."""
    import numpy as np
    from nonlinear_peers import CONTESTANTS, HEAD
    from peers import quiet

    with np.load(folder / "data.npz") as data:
        u, y, u_test, y_test, truth = (
            data[k] for k in ("u_est", "y_est", "u_val", "y_val", "w_val")
        )
    times: list[float] = []
    with quiet():
        estimate = CONTESTANTS[name].load()
        while not times or (len(times) < 3 and sum(times) < QUICK):
            start = perf_counter()
            run = estimate(u, y)
            times.append(perf_counter() - start)
        found = run(u_test, y_test)
    error = np.asarray(found)[HEAD:] - truth[HEAD:]
    spread = truth[HEAD:] - truth[HEAD:].mean(axis=0)
    rms = np.sqrt(np.mean(error**2, axis=0))
    fit = 100.0 * (1.0 - np.linalg.norm(error, axis=0) / np.linalg.norm(spread, axis=0))
    return {
        "first": times[0],
        "again": statistics.median(times[1:]) if times[1:] else None,
        "rmse": float(np.mean(rms)),
        "fit": float(np.mean(fit)),
    }


def contest(name: str, folder: Path, limit: float) -> dict[str, Any]:
    """One contestant in a process of its own, and its command where it has one."""
    command = [sys.executable, __file__, "--one", name, "--folder", str(folder)]
    found: dict[str, Any]
    try:
        done = subprocess.run(command, timeout=limit, capture_output=True, text=True, check=False)
    except subprocess.TimeoutExpired:
        return {"error": f"given up after {limit:g} s"}
    if done.returncode:
        return {"error": (done.stderr.strip().splitlines() or ["broke down"])[-1]}
    found = json.loads(done.stdout.splitlines()[-1])
    if name in COMMANDS:
        found["command"] = command_seconds(name, folder)
    return found


def command_seconds(name: str, folder: Path) -> float:
    """Wall time of ``sysid fit`` from a cold start."""
    code = "import sys; from sysid_cli.app import main; sys.exit(main(sys.argv[1:]))"
    place = folder / f"workspace-{name}"
    line = [sys.executable, "-c", code, "fit", str(folder / "est.csv"), *COMMANDS[name]]
    start = perf_counter()
    done = subprocess.run(
        [*line, "--workspace", str(place)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"sysid fit ended with {done.returncode}: {done.stderr.strip()}")
    return perf_counter() - start


def page(results: dict[str, dict[str, Any]]) -> tuple[str, list[str]]:
    """(the report, names of the targets that were missed)."""
    from nonlinear_peers import CONTESTANTS

    from sysid.report.markdown import table

    reference = results.get("narx", {})
    rows = []
    for name, found in results.items():
        c = CONTESTANTS[name]
        error = found.get("error")
        rows.append(
            [
                c.title,
                f"{c.words}; {error}" if error else c.words,
                *(_seconds(found.get(k)) for k in ("first", "again", "command")),
                _number(found.get("fit"), 2),
                _number(found.get("rmse"), 3),
                _ratio(found.get("first"), reference.get("first")),
                _ratio(found.get("rmse"), reference.get("rmse")),
            ]
        )
    heads = [
        "package", "asked for", "first s", "again s", "command s", "fit %", "RMSE rad/s",
        "time ×", "error ×",
    ]  # fmt: skip
    missed, goals = [], []
    for what, name, key, limit in TARGETS:
        value = results.get(name, {}).get(key)
        met = value is not None and value < limit
        goals.append([what, _seconds(value), f"< {limit:g}", "yes" if met else "no"])
        if not met:
            missed.append(what)
    head = HEAD.format(machine=machine(), samples=SAMPLES, tests=TEST_SAMPLES)
    targets = table(["what", "measured s", "target s", "met"], goals, "lrrl")
    return "\n".join([head, targets, table(heads, rows, "llrrrrrrr")]), missed


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}" if value < 10.0 else f"{value:.0f}"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _ratio(value: float | None, reference: float | None) -> str:
    return "–" if value is None or not reference else f"{value / reference:.2g}"


def machine() -> str:
    """Processor and versions."""
    from nonlinear_peers import CONTESTANTS
    from peers import processor

    names = ["numpy", "scipy", "jax", *dict.fromkeys(
        c.distribution for c in CONTESTANTS.values() if c.distribution)]  # fmt: skip
    packages = ", ".join(_version(n) for n in names)
    return f"{processor()}; {packages}"


def _version(name: str) -> str:
    try:
        return f"{name} {version(name)}"
    except PackageNotFoundError:
        return f"{name} (not installed)"


def main(arguments: Sequence[str]) -> int:
    """Measure everything and write the report."""
    from nonlinear_peers import CONTESTANTS

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(CONTESTANTS))
    parser.add_argument("--out", type=Path, default=REPORT, metavar="FILE")
    parser.add_argument("--limit", type=float, default=900.0, metavar="SECONDS")
    parser.add_argument("--one", metavar="NAME", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    if asked.one:
        print(json.dumps(measure(asked.one, asked.folder)))
        return 0
    from sysid.data.files import write_atomic
    from sysid.report.markdown import foot

    results = {}
    with tempfile.TemporaryDirectory() as place:
        make_data(Path(place))
        for name in asked.names or CONTESTANTS:
            results[name] = contest(name, Path(place), asked.limit)
            print(f"{name:15s} {results[name]}", flush=True)
    text, missed = page(results)
    write_atomic(asked.out, text + foot("make bench", "91, 92"))
    print(f"Written to {asked.out}; missed: {', '.join(missed) or 'none'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
