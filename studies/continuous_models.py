"""Do the intervals of process models hold the truth?

    python -m studies.continuous_models [--logs 280] [--out FILE]

Logs by a simulator that shares nothing with the code under test: each plant is stepped by its
matrix exponential on a grid twenty times finer than the samples, its dead time a whole number of
those steps; white noise is added. Plants are slow or fast against the sample time and stiff or not;
inputs are random levels held for random times.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import sysid

KINDS = {
    "P1D": ("K", "T1", "Td"),
    "P2D": ("K", "T1", "T2", "Td"),
    "P2DU": ("K", "Tw", "zeta", "Td"),
    "P2DZ": ("K", "T1", "T2", "Tz", "Td"),
}


def plant(kind: str, rng: np.random.Generator, dt: float) -> dict[str, float]:
    """True numbers [s]: time constants of 2 to 80 samples, dead times of up to 12."""
    fine = dt / 20.0
    slow = dt * float(np.exp(rng.uniform(np.log(6.0), np.log(80.0))))
    truth = {"K": float(rng.choice([-1, 1]) * np.exp(rng.uniform(-2, 2)))}
    if kind == "P2DU":
        truth |= {"Tw": slow / 2.0, "zeta": float(rng.uniform(0.1, 0.8))}
    else:
        truth["T1"] = slow
    if kind in ("P2D", "P2DZ"):
        truth["T2"] = slow * float(rng.uniform(0.1, 0.6))
    if kind == "P2DZ":
        truth["Tz"] = slow * float(rng.choice([-0.6, 1.8]))
    return truth | {"Td": fine * int(rng.integers(0, 240))}


def simulated(p: dict[str, float], rng: np.random.Generator, dt: float, n: int) -> "np.ndarray":
    """(u, y) of n samples, without noise."""
    per, bottom = 20, np.ones(1)
    for name in ("T1", "T2"):
        if name in p:
            bottom = np.convolve([p[name], 1.0], bottom)
    if "Tw" in p:
        bottom = np.array([p["Tw"] ** 2, 2.0 * p["zeta"] * p["Tw"], 1.0])
    top = p["K"] * np.array([p.get("Tz", 0.0), 1.0])
    order = len(bottom) - 1
    A = np.eye(order, k=1)
    A[-1] = -bottom[:0:-1] / bottom[0]
    B, C = np.zeros((order, 1)), np.zeros(order)
    B[-1, 0] = 1.0 / bottom[0]
    C[: min(2, order)] = top[::-1][: min(2, order)]
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[:order, order:] = A, B
    power = expm(whole * dt / per)
    slowest = p.get("T1", p.get("Tw", dt)) / dt
    u, level = np.zeros(n), 0.0
    k = int(5 + 2 * slowest) if slowest < 20 else 20
    while k < n:
        hold = int(np.ceil(rng.exponential(max(slowest, 2.0))))
        level = float(rng.uniform(-1, 1))
        u[k : k + hold] = level
        k += hold
    fine = np.concatenate([np.zeros(round(p["Td"] / dt * per)), np.repeat(u, per)])[: n * per]
    x, y = np.zeros(order), np.zeros(n)
    for k in range(n * per):
        if k % per == 0:
            y[k // per] = C @ x
        x = power[:order, :order] @ x + power[:order, order] * fine[k]
    return np.column_stack([u, y])


def main() -> None:
    """Run the study and write its page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--logs", type=int, default=280)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("reports/continuous_models.md"))
    given = parser.parse_args()
    rows: dict[tuple[str, str], list[float]] = {}
    lost = 0
    for k in range(given.logs):
        rng = np.random.default_rng([given.seed, k])
        kind, dt = list(KINDS)[k % len(KINDS)], float(np.exp(rng.uniform(np.log(1e-3), 0.0)))
        truth = plant(kind, rng, dt)
        u, y = simulated(truth, rng, dt, 1000).T
        y = y + 0.05 * np.std(y) * rng.standard_normal(len(y)) + 2.0
        record = sysid.Record(u[:, None], y[:, None], dt)
        made = sysid.structure(record, "process", {}, {"type": kind})
        model = sysid.fit(record, made)
        found = {p.name: p for p in model.parameter_table()}
        far = 0.0
        for name in KINDS[kind]:
            p = found[name]
            z = abs(p.value - truth[name]) / p.std_error if p.std_error else np.inf
            far = max(far, z)
            rows.setdefault((kind, name), []).append(z)
        lost += far > 20.0
    lines = ["# Process models: do the intervals hold the truth?", ""]
    lines += [
        f"{given.logs} logs of 1 000 samples, 5 % noise (seed {given.seed}); `python -m "
        "studies.continuous_models`. T1 is the larger time constant."
    ]
    lines += [
        "",
        "| kind | number | logs | in 95 % interval | within 3 errors |",
        "|---|---|---|---|---|",
    ]
    every: list[float] = []
    for (kind, name), z in rows.items():
        a = np.array(z)
        every += z
        inside, three = 100 * np.mean(a < 1.96), 100 * np.mean(a < 3.0)
        lines.append(f"| {kind} | {name} | {len(a)} | {inside:.0f} % | {three:.0f} % |")
    a = np.array(every)
    lines += [
        f"| all | all | {len(a)} | {100 * np.mean(a < 1.96):.1f} % "
        f"| {100 * np.mean(a < 3.0):.1f} % |",
        "",
        f"Fits that ended at another minimum (a number more than 20 errors away): {lost}.",
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if given.out:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
