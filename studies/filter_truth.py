"""Runs of a filter whose truth is its own model, where theory says how large its errors are."""

import math
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import NavigationInputs, Scene
from sysid.robot.mission.navigation.consistency import POSE
from sysid.robot.mission.navigation.fusion import Filter
from sysid.robot.mission.navigation.measurements import VO, Group, Setting
from sysid.robot.mission.navigation.process import PSI
from sysid.vehicle.kinematics import wrap_angle


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
        rows.append((*world.x[: len(POSE)], *law.report(state, np)))
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
