"""A DC motor integrated from its physics, for estimators that know nothing of how it was made."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TurningMotor:
    """J dω/dt = Kt i − b ω − friction, i = (v − Ke ω)/R, friction stiction at rest.

    Attributes:
        friction: voltage that Coulomb friction eats [V].
        bridge: voltage below which the bridge does not conduct [V].
        time_constant: J/(b + Kt²/R) [s].
    """

    friction: float = 0.0
    bridge: float = 0.0
    time_constant: float = 0.15

    R = 2.0
    Kt = 0.05
    b = 1e-4

    @property
    def gain(self) -> float:
        """Speed per volt beyond what friction and bridge eat [(rad/s)/V]."""
        return self.Kt / self.R / (self.b + self.Kt**2 / self.R)

    def speeds(self, volts: Array, dt: float, strength: Array | None = None) -> Array:
        """Speed at each instant [rad/s]; ``strength`` is what the torque is multiplied by."""
        inner = 10
        h = dt / inner
        drag = self.b + self.Kt**2 / self.R
        inertia, coulomb = self.time_constant * drag, self.friction * self.Kt / self.R
        w, found = 0.0, np.zeros(len(volts))
        for k, v in enumerate(volts.tolist()):
            found[k] = w
            torque = self.Kt / self.R * np.sign(v) * max(abs(v) - self.bridge, 0.0)
            torque = float(torque) * (1.0 if strength is None else float(strength[k]))
            for _ in range(inner):
                if w == 0.0 and abs(torque) <= coulomb:
                    break
                side = 1.0 if (w if w != 0.0 else torque) > 0.0 else -1.0
                # exact over the step while the side does not change
                rest = (torque - coulomb * side) / drag
                after = rest + (w - rest) * float(np.exp(-h * drag / inertia))
                w = 0.0 if w * after < 0.0 else after
        return found


def steps_of(levels: Sequence[float], samples: int, hold: int, seed: int) -> Array:
    """Random levels, each held for so many samples."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.choice(np.array(levels), samples // hold + 1), hold)[:samples]
