"""What feedback does to fits without a noise model, and what two stages do about it.

    python -m studies.closed_loop [--loops 60] [--out FILE]

Loops by a simulator of its own: a plant of second order, stepped by its matrix exponential; a
proportional-integral controller of the sampled output; the reference a sequence of levels; the
disturbance white, or slow (a first-order lag of a third of the plant's). The error is that of the
plant's frequency response within its bandwidth, against that of the truth.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

import sysid
from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.estimation import pem
from sysid.estimation.two_stage import inputs_by_reference
from sysid.methods.table import method_of

STRUCTURES: dict[str, tuple[dict[str, Any], dict[str, str]]] = {
    "oe": ({"nb": 2, "nf": 2, "nk": 1}, {}),
    "tf": ({"np": 2, "nz": 0}, {"delay": "none"}),
    "process": ({}, {"type": "P2"}),
}

DISTURBANCES = {"white": 0.0, "slow": 0.97}
"""Pole of the disturbance, per sample."""


def loop(rng: np.random.Generator, pole: float, n: int) -> tuple[Record, Any]:
    """A log with its reference, and G(jω) of the truth."""
    dt = 0.05
    gain, slow = float(np.exp(rng.uniform(-1, 1))), float(rng.uniform(0.6, 1.5))
    fast = slow * float(rng.uniform(0.15, 0.4))
    bottom = np.array([slow * fast, slow + fast, 1.0])
    A = np.array([[0.0, 1.0], [-1.0 / bottom[0], -bottom[1] / bottom[0]]])
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[1, 2] = A, gain / bottom[0]
    power = expm(whole * dt)
    kp, ki = 1.5 / gain, 1.5 / gain / slow
    r = np.repeat(rng.uniform(-1, 1, n // 30 + 1), 30)[:n]
    r[:30] = 0.0
    white = rng.standard_normal(n)
    v = np.zeros(n)
    for k in range(n):
        v[k] = pole * v[k - 1] * (k > 0) + white[k]
    v *= 0.25 * np.std(r) / np.std(v)
    x, integral = np.zeros(2), 0.0
    u, y = np.zeros(n), np.zeros(n)
    for k in range(n):
        y[k] = x[0] + v[k]
        integral += ki * dt * (r[k] - y[k])
        u[k] = kp * (r[k] - y[k]) + integral
        x = power[:2, :2] @ x + power[:2, 2] * u[k]
    record = Record(u[:, None], y[:, None], dt, references=r[:, None], reference_names=("wish",))

    def truth(w: Any) -> Any:
        """Of the samples, the input held."""
        z = np.exp(1j * w * dt)
        return np.array(
            [np.linalg.solve(q * np.eye(2) - power[:2, :2], power[:2, 2])[0] for q in z]
        )

    return record, truth


def errors_of(record: Record, truth: Any, name: str) -> dict[str, Any]:
    """G's error by the direct fit, by two stages and by what ``fit`` chooses, and what it chose."""
    orders, options = STRUCTURES[name]
    made = sysid.structure(record, name, orders, options)
    w = np.logspace(-1, 0.5, 12)
    exact = truth(w)

    def relative(model: Any) -> Any:
        return (model.bode(w)[1][:, 0, 0] - exact) / np.abs(exact)

    chosen = sysid.fit(record, made)
    direct = pem.fit(made, [record], solver=method_of(made).fit)
    staged = inputs_by_reference([record])
    assert staged is not None
    second = pem.fit(made, staged, solver=method_of(made).fit)
    switched = any("two stages" in s for s in chosen.warnings)
    return {
        "direct": relative(direct),
        "two stages": relative(second),
        "chosen": relative(chosen),
        "switched": switched,
        "seen": LogFacts((record,)).closed_loop,
    }


def open_loop(rng: np.random.Generator, kind: str, pole: float, n: int) -> Record:
    """A log without a controller in which somebody's wish is a column, too."""
    wish = np.repeat(rng.uniform(-1, 1, n // 30 + 1), 30)[:n]
    u = {
        "the input itself": 2.0 * wish,
        "filtered to the input": 1.5 * lfilter([0.3], [1.0, -0.7], wish),
        "apart from the input": np.repeat(rng.uniform(-1, 1, n // 20 + 1), 20)[:n],
        "the input and noise": 1.5 * wish + 0.1 * rng.standard_normal(n),
    }[kind]
    y = lfilter([0.0, 0.05, 0.03], [1.0, -1.6, 0.66], u)
    v = lfilter([1.0], [1.0, -pole], rng.standard_normal(n))
    y = y + 0.2 * np.std(y) / np.std(v) * v
    return Record(u[:, None], y[:, None], 0.05, references=wish[:, None], reference_names=("wish",))


def false_alarms(seed: int, logs: int, samples: int = 1500) -> list[str]:
    """Rows of a table: how often feedback is seen where there is none."""
    rows = [
        "",
        f"How often feedback is seen in open loop beside a recorded wish, {logs} logs a number"
        f" ({samples} samples, seed {seed}), by the pole of the disturbance:",
        "",
        "| the wish is | 0 | 0.9 | 0.97 |",
        "|---|---|---|---|",
    ]
    kinds = ("the input itself", "filtered to the input", "apart from the input")
    for kind in (*kinds, "the input and noise"):
        seen = []
        for pole in (0.0, 0.9, 0.97):
            some = (
                open_loop(np.random.default_rng([seed, 99, k]), kind, pole, samples)
                for k in range(logs)
            )
            seen.append(str(sum(LogFacts((r,)).closed_loop for r in some)))
        rows.append(f"| {kind} | {' | '.join(seen)} |")
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Run the study and write its page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--loops", type=int, default=60)
    parser.add_argument("--samples", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("reports/closed_loop.md"))
    given = parser.parse_args()
    lines = [
        "# Closed loops: bias with and without the reference",
        "",
        f"{given.loops} loops a row, {given.samples} samples each (seed {given.seed}), a"
        " disturbance a quarter of the reference; `python -m studies.closed_loop`. Bias: size of"
        " the mean of the relative errors of G(jω); error: their root mean square;"
        " both in %, over 0.1 to 3 rad/s.",
        "",
        "| disturbance | structure | bias, direct | bias, two stages | bias, chosen | error, "
        "direct | error, two stages | error, chosen | feedback seen | two stages chosen |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, pole in DISTURBANCES.items():
        for name in STRUCTURES:
            runs = []
            for k in range(given.loops):
                record, truth = loop(np.random.default_rng([given.seed, k]), pole, given.samples)
                runs.append(errors_of(record, truth, name))
            cells = []
            ways = ("direct", "two stages", "chosen")
            each = {way: np.array([run[way] for run in runs]) for way in ways}
            cells += [
                f"{100 * np.sqrt(np.mean(np.abs(e.mean(axis=0)) ** 2)):.1f}" for e in each.values()
            ]
            cells += [f"{100 * np.sqrt(np.mean(np.abs(e) ** 2)):.1f}" for e in each.values()]
            cells += [
                f"{sum(run[key] for run in runs)} of {len(runs)}" for key in ("seen", "switched")
            ]
            lines.append(f"| {kind} | {name} | " + " | ".join(cells) + " |")
            print(lines[-1], flush=True)
    lines += false_alarms(given.seed, 2 * given.loops)
    text = "\n".join(lines) + "\n"
    given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
