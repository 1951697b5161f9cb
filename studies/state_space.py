"""State space beside nfoursid and SIPPY: fit on held-out data, bias under feedback, time, coverage.

    python -m studies.state_space --peers PYTHON

PYTHON is one that has nfoursid and sippy_unipi; without it ours stand alone. Two minutes of one
core.
"""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

from studies.records import data_folder
from studies.runner import Study
from sysid.criteria.fit import fit_percent
from sysid.data.io import read_log
from sysid.data.preprocess import Detrend
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array, Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.report.markdown import table
from sysid.structures.state_space.innovations import StateSpace
from sysid.structures.state_space.realization import Realization
from sysid.structures.state_space.structure import _fitted_core

STUDY = Study("state_space", "state_space.md", runs=100, jobs=1)
PEERS = Path(__file__).with_name("state_space_peers.py")
HEAD_SAMPLES = 50
"""Samples of a validation record from which every model's first state is fitted; not counted."""

OWN_SUBSPACE, OWN, OWN_FREE = "sysid, subspace alone", "sysid ss", "sysid ss --focus simulation"

A = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.6]])
B, C = np.array([[1.0], [0.5], [1.0]]), np.array([[1.0, 0.0, 0.5]])
K = np.array([[0.5], [-0.1], [0.3]])
FEEDBACK, NOISE, SAMPLES = 0.25, 1.0, 1000
"""u = r − 0.25 y, standard deviation of e and of r each 1."""

Matrices = Sequence[Any]


def records() -> dict[str, tuple[Record, Record, int]]:
    """Name → estimation and validation records without means, order."""
    folder = data_folder()
    if folder is None:
        return {}
    dryer = read_log(folder / "dryer/dryer.csv")
    winding = read_log(folder / "winding/winding.csv")
    player = read_log(folder / "cdplayer_arm/cdplayer.csv", ReadOptions(ts=1.0))
    made: dict[str, tuple[Record, Record, int]] = {}
    for name, r, n, cut in (
        ("dryer", dryer, 4, ((0, 300), (749, 900))),
        ("winding", winding, 6, ((0, 1250), (1250, 2500))),
        ("cdplayer_arm", player, 8, ((0, 1024), (1024, 2048))),
    ):
        parts = [r.rows(*c) for c in cut]
        mean = Detrend.means(parts[:1])
        made[name] = (mean.remove(parts[0]), mean.remove(parts[1]), n)
    return made


def looped(seed: int, feedback: float) -> Record:
    """A log of the truth, under feedback or not."""
    rng = np.random.default_rng(seed)
    e, r = NOISE * rng.standard_normal(SAMPLES), rng.standard_normal(SAMPLES)
    u, y, x = np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 1)), np.zeros(3)
    for t in range(SAMPLES):
        y[t] = C @ x + e[t]
        u[t] = r[t] - feedback * y[t - 1] * (t > 0)
        x = A @ x + B @ u[t] + K[:, 0] * e[t]
    return Record(u, y, 1.0)


def response(matrices: Matrices) -> Array:
    """G at 60 frequencies."""
    a, b, c, d = (np.asarray(m, dtype=np.float64) for m in matrices)
    z = np.exp(1j * np.geomspace(0.02, np.pi, 60))
    return np.array([c @ np.linalg.solve(p * np.eye(len(a)) - a, b) + d for p in z])[:, 0, 0]


TRUTH = response((A, B, C, np.zeros((1, 1))))


def ours(record: Record, n: int) -> dict[str, list[Any]]:
    """[A, B, C, D, seconds] of the subspace estimate and of the whole fit."""
    s = StateSpace.from_orders({"n": n}, record.nu, record.ny)
    start = process_time()
    looked = s.looked_at([record])
    assert looked is not None
    first = [*looked.matrices(n)[:4], process_time() - start]
    start = process_time()
    model = fit(s, [record], detrend=Detrend.none(record.nu, record.ny))
    whole = [*s.matrices(model.theta), process_time() - start]
    start, options = process_time(), FitOptions(focus=Focus.SIMULATION)
    model = fit(s, [record], options, detrend=Detrend.none(record.nu, record.ny))
    free = [*model.structure.matrices(model.theta), process_time() - start]  # type: ignore[attr-defined]
    return {OWN_SUBSPACE: first, OWN: whole, OWN_FREE: free}


def judged(matrices: Matrices, record: Record) -> list[float]:
    """Free-run fit [%] by output, from a state fitted to the head."""
    a, b, c, d = (np.asarray(m, dtype=np.float64) for m in matrices)
    nu = record.nu
    r = Realization(a, b, c, d, None, tuple(range(nu)), (0,) * nu, nu)
    x0 = _fitted_core(r, record.u[:HEAD_SAMPLES], record.y[:HEAD_SAMPLES])
    with np.errstate(all="ignore"):
        run = r.run(record.u, x0)
        return [float(v) for v in fit_percent([record.y], [run], HEAD_SAMPLES)]


def peers(python: str | None, cases: Mapping[str, tuple[Record, int]]) -> dict[str, Any]:
    """What the other packages make of the cases; nothing without them."""
    if python is None:
        return {name: {} for name in cases}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "cases.npz"
        arrays = {f"{k}/{s}": v for k, (r, n) in cases.items()
                  for s, v in (("u", r.u), ("y", r.y), ("n", n))}  # fmt: skip
        np.savez(path, **arrays)
        done = subprocess.run(
            [python, "-P", "-E", str(PEERS), str(path)], capture_output=True, text=True, check=True
        )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measured_table(python: str | None) -> str:
    """Fits on measured records."""
    every = records()
    others = peers(python, {name: (train, n) for name, (train, _, n) in every.items()})
    rows = []
    for name, (train, test, n) in every.items():
        for who, found in (ours(train, n) | others[name]).items():
            if isinstance(found, str):
                rows.append([name, str(n), who, f"failed: {found}", "–"])
                continue
            fits = judged(found[:4], test)
            shown = ", ".join(f"{v:.1f}" if v > -1e3 else "diverges" for v in fits)
            rows.append([name, str(n), who, shown, f"{found[4]:.2f}"])
    return table(["record", "n", "by", "free-run fit [%], validation", "s"], rows, "lrlrr")


def loop_table(python: str | None, runs: int) -> str:
    """Error of the frequency response, with and without a controller."""
    rows = []
    for words, feedback in (("none", 0.0), ("u = r − 0.25 y", FEEDBACK)):
        logs = {f"{seed:03d}": (looped(seed, feedback), 3) for seed in range(runs)}
        others = peers(python, logs)
        every: dict[str, list[Array]] = {}
        for key, (log, n) in logs.items():
            for who, found in (ours(log, n) | others[key]).items():
                if not isinstance(found, str):
                    every.setdefault(who, []).append(response(found[:4]))
        size = np.sqrt(np.mean(np.abs(TRUTH) ** 2))
        for who, found in every.items():
            off = np.array(found) - TRUTH
            bias = np.sqrt(np.mean(np.abs(off.mean(axis=0)) ** 2)) / size
            spread = np.sqrt(np.mean(np.abs(off) ** 2)) / size
            rows.append([words, who, f"{100 * bias:.1f}", f"{100 * spread:.1f}", str(len(found))])
    return table(["feedback", "by", "bias of G [%]", "RMS error of G [%]", "logs"], rows, "llrrr")


def coverage(runs: int) -> str:
    """How often 95 % intervals of gain and poles hold the truth."""
    from sysid.estimation.assessment.delta_method import estimates
    from sysid.estimation.assessment.step_response import step_responses

    gain = float((C @ np.linalg.solve(np.eye(3) - A, B))[0, 0])
    pole = np.log(np.linalg.eigvals(A)[np.abs(np.linalg.eigvals(A).imag) > 0][0])
    wanted = {"gain": gain, "natural frequency": abs(pole), "damping": -pole.real / abs(pole)}
    held: dict[str, list[bool]] = {}
    for seed in range(runs):
        log = looped(seed, FEEDBACK)
        model = fit(StateSpace.from_orders({"n": 3}, 1, 1), [log], detrend=Detrend.none(1, 1))
        (step,) = step_responses(model)
        found = {"gain": step.gain}
        if step.oscillation is not None:
            found |= dict(zip(("natural frequency", "damping"), step.oscillation, strict=True))
        for name, estimate in found.items():
            inside = abs(estimate.value - wanted[name]) <= estimate.reach
            held.setdefault(name, []).append(inside)
        (entry,) = estimates(model, lambda theta: np.array([theta[-1]]))
        truth = StateSpace.from_orders({"n": 3}, 1, 1).theta_of((A, B, C, np.zeros((1, 1)), K))
        assert truth is not None
        held.setdefault("K3,1", []).append(abs(entry.value - truth[-1]) <= entry.reach)
    rows = [[k, f"{100 * np.mean(v):.1f}", str(len(v))] for k, v in held.items()]
    return table(["number", "95 % intervals that hold it [%]", "logs"], rows, "lrr")


HEAD = f"""# State space beside nfoursid and SIPPY

All of one order, all judged by one piece of code. *s*: processor seconds of the fit. Block rows of
the other packages: 20. The subspace estimate is where the fit of `ss` begins.

## Measured records

Means removed; fitted to the estimation part (dryer: samples 1 … 300, winding and cdplayer_arm: the
first half), judged in free run on the validation part (dryer: 800 … 900, the others: the second
half). The first state is fitted to {HEAD_SAMPLES} samples before what is counted. `ss` minimises
errors one step ahead, so that a fit for free runs (`--focus simulation`) stands beside.

"""

LOOP = f"""
## With and without a controller

{SAMPLES} samples of a plant of three states with coloured noise as large as the input; bias is that
of the mean over the logs.

"""


def main(words: Sequence[str] | None = None) -> None:
    """Write the page."""
    parser = STUDY.parser(__doc__)
    parser.add_argument("--peers", metavar="PYTHON", help="a Python with nfoursid and sippy_unipi")
    asked = parser.parse_args(words)
    text = HEAD + measured_table(asked.peers) + LOOP + loop_table(asked.peers, asked.runs)
    text += "\n## Intervals\n\nThe same plant under feedback.\n\n" + coverage(asked.runs)
    STUDY.write(asked, text)


if __name__ == "__main__":
    main(sys.argv[1:])
