"""Consistency of a filter: errors and innovations against their covariances.

Where model and noise are right, the normalised error eᵀP⁻¹e (NEES) and the normalised innovation
νᵀS⁻¹ν (NIS) are χ² with as many degrees of freedom as numbers (Bar-Shalom, Li & Kirubarajan 2001,
§5.4). Both are given per degree of freedom here, so that 1 is right, more is over-confident and
less too cautious.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import NavigationInputs, Scene
from sysid.robot.mission.navigation.fusion import Filter
from sysid.robot.mission.navigation.measurements import VO, Group, Setting
from sysid.robot.mission.navigation.process import PSI
from sysid.vehicle.kinematics import wrap_angle

POSE = 3
"""Degrees of freedom of the error of a pose: x, y, ψ."""


@dataclass(frozen=True)
class Mean:
    """A mean with the bounds that it keeps to where model and noise are right.

    Attributes:
        mean: per degree of freedom; 1 is right.
        bounds: that hold it with the probability asked for.
    """

    mean: float
    bounds: tuple[float, float]

    @property
    def verdict(self) -> str:
        """``consistent``, ``over-confident`` or ``too cautious``."""
        low, high = self.bounds
        if self.mean > high:
            return "over-confident"
        return "too cautious" if self.mean < low else "consistent"


@dataclass(frozen=True)
class Consistency:
    """How a filter's errors compare with what it believes of them.

    Attributes:
        nis: of the innovations; None where nothing was read.
        nees: of the pose; None where the truth is not known.
    """

    nis: Mean | None
    nees: Mean | None
    runs: int

    @property
    def sentence(self) -> str:
        """What it means and what to do."""
        verdicts = {m.verdict for m in (self.nis, self.nees) if m is not None}
        if "over-confident" in verdicts:
            return (
                "The filter is over-confident: its errors exceed its covariance. Raise q or r, or "
                "add the missing states."
            )
        if "too cautious" in verdicts:
            return "The filter is too cautious: its errors are below its covariance. Lower q or r."
        return "The filter is consistent: its errors match its covariance."


def consistency(runs: Sequence[Mapping[str, Array]], probability: float = 0.99) -> Consistency:
    """Judge a filter by the logs of runs.

    Innovations are independent in time, so that their sum is χ² of all their degrees of freedom.
    Errors of a pose are not: their bounds count as many independent samples as the
    autocorrelation of the NEES leaves.

    Args:
        runs: columns by name, ``nis, nis_dof`` and, for the NEES, ``x, y, psi`` beside
            ``x_est, y_est, psi_est`` and the entries of P; samples in which one is NaN are left
            out of it.
        probability: with which the bounds hold a mean where model and noise are right; as in the
            tests of residuals, one verdict in a hundred may be wrong.
    """
    read = sum(float(np.nansum(run["nis_dof"])) for run in runs)
    nis = None
    if read > 0:
        total = sum(float(np.nansum(run["nis"])) for run in runs)
        nis = Mean(total / read, _bounds(read, probability))
    series = [
        errors_of_run
        for run in runs
        if (errors_of_run := nees(run)) is not None and len(errors_of_run)
    ]
    if not series:
        return Consistency(nis, None, len(runs))
    independent = sum(len(s) for s in series) / _samples_in_one(series)
    mean = float(np.concatenate(series).mean()) / POSE
    bounds = _bounds(POSE * max(independent, len(series)), probability)
    return Consistency(nis, Mean(mean, bounds), len(runs))


def nees(run: Mapping[str, Array]) -> Array | None:
    """eᵀP⁻¹e of the pose at every sample after the first; None where the truth is not known."""
    if not {"x", "y", "psi"} <= run.keys():
        return None
    error = np.stack([run[f"{name}_est"] - run[name] for name in ("x", "y", "psi")], axis=1)[1:]
    error[:, PSI] = wrap_angle(error[:, PSI])
    xx, xy, yy = (run[f"P_{name}"][1:] for name in ("xx", "xy", "yy"))
    xp, yp, pp = (run[f"P_{name}"][1:] for name in ("x_psi", "y_psi", "psi"))
    P = np.stack([xx, xy, xp, xy, yy, yp, xp, yp, pp], axis=1).reshape(-1, 3, 3)
    known = np.isfinite(error).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
    error, P = error[known], P[known]
    squared: Array = np.einsum("ti,ti->t", error, np.linalg.solve(P, error[:, :, None])[:, :, 0])
    return squared


def _bounds(dof: float, probability: float) -> tuple[float, float]:
    """Quantiles of χ² over its degrees of freedom."""
    from scipy.special import gammaincinv

    outside = 0.5 * (1.0 - probability)
    low, high = (2.0 * float(gammaincinv(0.5 * dof, p)) for p in (outside, 1.0 - outside))
    return low / dof, high / dof


def _samples_in_one(series: Sequence[Array]) -> float:
    """Samples worth one independent sample: 1 + 2Σρ, summed while ρ is above 0."""
    mean = float(np.concatenate(series).mean())
    off = [s - mean for s in series]
    power = sum(float(o @ o) for o in off)
    total, longest = 1.0, max(map(len, off))
    for lag in range(1, longest):
        rho = sum(float(o[lag:] @ o[:-lag]) for o in off if len(o) > lag) / power
        if rho <= 0:
            break
        total += 2.0 * rho
    return total


# Runs whose truth is the filter's own model -------------------------------------------------------


def own_run(
    law: Filter, scene: Scene, samples: int, seed: int, of: Filter | None = None
) -> dict[str, Array]:
    """Run a filter on a truth drawn from a model, where theory says how large its errors are.

    Args:
        scene: with the sensors; only where it starts, its vehicle and its sample time matter.
        seed: of the truth and of the measurements.
        of: whose model the truth is drawn from; the filter's own unless given.

    Returns:
        Columns of a log: ``x, y, psi`` and what the filter reports.
    """
    world = _World(of or law, scene, np.random.default_rng(seed))
    state, rows = law.start(scene, np), []
    for k in range(samples):
        measurements = world.moved(scene.dt if k else 0.0)
        given = NavigationInputs(k * scene.dt, measurements, scene)
        state, _ = law.step(state, given, scene.dt if k else 0.0, np)
        rows.append((*world.x[:POSE], *law.report(state, np)))
    table = np.array(rows)
    table[:, PSI] = wrap_angle(table[:, PSI])
    return {name: table[:, i] for i, name in enumerate(("x", "y", "psi", *law.columns))}


class _World:
    """A truth that moves and is read as a filter's model says."""

    def __init__(self, law: Filter, scene: Scene, rng: np.random.Generator) -> None:
        self.plan, self.geometry, self.linear = law.plan(scene), scene.geometry, law.linear
        self.rng = rng
        first = law.moments(law.start(scene, np).belief.of, np)
        self.x = first.x + self._drawn(first.P)
        groups = self.plan.groups
        self.elapsed = [math.inf] * len(groups)
        self.raw = [np.array([*scene.start]) if g.names == VO else np.zeros(0) for g in groups]
        self.late: list[list[dict[str, float]]] = [[{}] * g.delay for g in groups]

    def _drawn(self, P: Array) -> Array:
        """Gaussian numbers of a covariance that may be singular."""
        values, vectors = np.linalg.eigh(P)
        numbers: Array = vectors @ (
            np.sqrt(np.maximum(values, 0.0)) * self.rng.standard_normal(len(P))
        )
        return numbers

    def _named(self) -> dict[str, Any]:
        return {name: self.x[i] for i, name in enumerate(self.plan.process.names)}

    def moved(self, dt: float) -> dict[str, float]:
        """Move on; the measurements that come then."""
        process, s = self.plan.process, self._named()
        after = process.advanced(s, dt, 0.0, self.geometry, np)
        Q = process.slopes(s, dt, 0.0, self.geometry, np)[1]
        self.x = np.array([after[name] for name in process.names]) + self._drawn(Q)
        measurements: dict[str, float] = {"omega_l": math.nan, "omega_r": math.nan}
        for k, group in enumerate(self.plan.groups):
            self.elapsed[k] += dt
            due = self.elapsed[k] > group.interval * (1.0 - 1e-9)
            self.late[k].append(self._read(k, group) if due else {})
            measurements |= self.late[k].pop(0)
        return measurements

    def _read(self, k: int, group: Group) -> dict[str, float]:
        """What one sensor reads now."""
        first = not math.isfinite(self.elapsed[k])
        elapsed = 0.0 if first else self.elapsed[k]
        setting = Setting(self.geometry, elapsed=elapsed, known_heading=self.linear)
        expected = group.expected(self._named(), setting, np)
        noise = self.rng.standard_normal(len(expected)) * np.sqrt(group.spread(elapsed, np))
        values = np.array([one.value for one in expected]) + noise
        self.elapsed[k] = 0.0
        T = self.plan.since[k]
        self.x = self.x if T is None else T @ self.x
        if group.names == VO and group.adds_up:
            x, y, psi = self.raw[k]
            c, s = math.cos(psi), math.sin(psi)
            forward, left, turned = (0.0, 0.0, 0.0) if first else values
            values = np.array(
                [x + c * forward - s * left, y + s * forward + c * left, psi + turned]
            )
            self.raw[k] = values
        if group.names == ("heading",):
            angle = values[0] - group.compass.north
            return {"mag_x": math.cos(angle), "mag_y": -math.sin(angle)}
        return dict(zip(group.names, values.tolist(), strict=True))
