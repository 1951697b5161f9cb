"""A vehicle with mass on four contact patches, integrated finely: logs that no law here made."""

from dataclasses import dataclass, field

import numpy as np
from pose_cases import DT, GAIN, INPUTS, OUTPUTS

from sysid.data.record import PWM_FULL_SCALE, Array, Record
from sysid.vehicle.kinematics import Geometry

PARTS = 20
"""Steps of the integration in a sample."""


@dataclass(frozen=True)
class SkidSteer:
    """Forces of two sides that slip, with a body that drives and turns.

        m v̇ = F_L + F_R,   I ψ̈ = (F_R − F_L) B/2 − D ψ̇,   F = ±limit at most of C (r ω − v_side)

    Attributes:
        mass: of the body [kg].
        inertia: about the vertical [kg m²].
        stiffness: force of a side for each m/s that it slips, C [N s/m].
        scrubbing: moment for each rad/s that drags the wheels sideways, D [N m s].
        grip: most that a side can push [N].
        geometry: radius and distance of the sides.
    """

    mass: float = 4.0
    inertia: float = 0.05
    stiffness: float = 100.0
    scrubbing: float = 0.5
    grip: float = np.inf
    geometry: Geometry = field(default_factory=Geometry)

    def pose(self, omega: Array) -> Array:
        """x, y, ψ at samples of wheel speeds (N, 2) that run straight in between, (N, 3)."""
        h, r, half = DT / PARTS, self.geometry.r, 0.5 * self.geometry.B
        v, turn = 0.5 * r * omega[0].sum(), 0.0
        x = y = psi = 0.0
        out = [(x, y, psi)]
        for k in range(len(omega) - 1):
            for i in range(PARTS):
                left, right = omega[k] + (omega[k + 1] - omega[k]) * ((i + 0.5) / PARTS)
                push = [
                    min(max(self.stiffness * slid, -self.grip), self.grip)
                    for slid in (r * left - v + half * turn, r * right - v - half * turn)
                ]
                v += h * (push[0] + push[1]) / self.mass
                turn += h * (half * (push[1] - push[0]) - self.scrubbing * turn) / self.inertia
                psi += h * turn
                x, y = x + h * v * np.cos(psi), y + h * v * np.sin(psi)
            out.append((x, y, psi))
        return np.array(out)


def logged(omega: Array, pose: Array, seed: int = 1) -> Record:
    """A record of speeds and pose with noise on both."""
    rng = np.random.default_rng(seed)
    pose = pose + np.array([0.001, 0.001, 0.002]) * rng.normal(size=pose.shape)
    read = omega + 0.1 * rng.normal(size=omega.shape)
    return Record(omega / GAIN * PWM_FULL_SCALE, read, DT, INPUTS, OUTPUTS, pose, name="made.csv")


def stepping(samples: int = 600, seed: int = 5) -> Array:
    """Speeds that change sharply, sides for themselves, (N, 2) [rad/s]."""
    rng = np.random.default_rng(seed)
    levels = np.repeat(rng.uniform(-6.0, 16.0, (samples // 12 + 1, 2)), 12, axis=0)[:samples]
    keep = np.exp(-DT / 0.15)
    out = np.zeros_like(levels)
    for k in range(1, samples):
        out[k] = keep * out[k - 1] + (1.0 - keep) * levels[k]
    return out
