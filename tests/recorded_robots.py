"""Robots that are not ours as a recorder sees them: senders with clocks and ways of their own.

Two motors dω/dt = (K u − ω)/τ are driven by commands; what their encoders and a gyroscope read is
stamped by the robot's clock, travels to the recorder and is stamped again there.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sysid.data.bags.writing import Messages, Outgoing, write_bag

GAIN, TAU = (9.0, 8.0), (0.25, 0.32)
"""K [rad/s at full drive] and τ [s] of the left and of the right motor."""
RADIUS, WIDTH = 0.05, 0.3
"""Wheels and track [m]."""
EPOCH = 1_750_000_000 * 10**9
"""When the recorder was switched on [ns]."""


@dataclass(frozen=True)
class Sender:
    """How the messages of one topic are stamped and travel.

    Attributes:
        period: between its messages [s], with ``jitter`` [s] rms.
        offset, drift: its clock is ``offset`` + ``drift``·t ahead of the recorder's [s].
        way: least time on the way [s]; ``queue`` more [s] on average, exponentially.
        stamped: whether it fills in its header.
    """

    period: float
    jitter: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    way: float = 0.0
    queue: float = 0.0
    stamped: bool = True

    def instants(self, length: float, rng: np.random.Generator) -> np.ndarray:
        """True instants of its messages [s]."""
        t = np.arange(0.0, length, self.period)
        return np.maximum.accumulate(t + self.jitter * rng.standard_normal(len(t)))

    def sent(self, t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Header stamps and times of receipt [ns]."""
        stamp = np.rint((t + self.offset + self.drift * t) * 1e9).astype(np.int64) + EPOCH
        late = self.way + self.queue * rng.exponential(size=len(t))
        got = np.maximum.accumulate(t + late)  # a connection keeps the order
        return (stamp if self.stamped else 0 * stamp), np.rint(got * 1e9).astype(np.int64) + EPOCH


@dataclass(frozen=True)
class Robot:
    """A drive and who tells of it.

    Attributes:
        command, wheels, gyro: the senders.
        length: of the drive [s].
        hold: how long a command stays, in messages.
        delay: dead time of the motors [s].
        noise: of the wheel speeds [rad/s]; a third of it on the gyroscope [rad/s].
        seed: of all that is random.
    """

    command: Sender = field(default_factory=lambda: Sender(0.1))
    wheels: Sender = field(default_factory=lambda: Sender(0.02))
    gyro: Sender = field(default_factory=lambda: Sender(0.1))
    length: float = 60.0
    hold: int = 4
    delay: float = 0.0
    noise: float = 0.02
    seed: int = 1

    def messages(self, make: Messages) -> Iterable[Outgoing]:
        """The recording: /cmd_drive, /joint_states and /imu/data."""
        rng = np.random.default_rng(self.seed)
        at = self.command.instants(self.length, rng)
        drive = rng.uniform(-1.0, 1.0, size=(len(at) // self.hold + 1, 2))
        drive = np.repeat(drive, self.hold, axis=0)[: len(at)]
        _, got = self.command.sent(at, rng)
        for t, u in zip(got.tolist(), drive, strict=True):
            yield Outgoing("/cmd_drive", "std_msgs/msg/Float64MultiArray", t,
                           make.make("std_msgs/msg/Float64MultiArray", data=u.copy()))  # fmt: skip
        fine = np.arange(0.0, self.length + 1.0, 0.001)
        area = np.vstack([np.zeros(2), np.cumsum(drive[:-1] * np.diff(at)[:, None], axis=0)])
        last = np.searchsorted(at, fine - self.delay, side="right") - 1
        since = np.clip(fine - self.delay - at[np.maximum(last, 0)], 0.0, None)[:, None]
        whole = area[np.maximum(last, 0)] + since * drive[np.maximum(last, 0)]
        held = np.diff(whole, axis=0, prepend=whole[:1]) / 0.001  # means: no command is rounded
        speed = np.column_stack([_lag(held[:, k], TAU[k], 0.001, GAIN[k]) for k in (0, 1)])
        yield from self._wheels(make, fine, speed, rng)
        yield from self._gyro(make, fine, speed, rng)

    def _wheels(self, make, fine, speed, rng) -> Iterable[Outgoing]:
        t = self.wheels.instants(self.length, rng)
        stamps, got = self.wheels.sent(t, rng)
        read = np.column_stack([np.interp(t, fine, c) for c in speed.T])
        read += self.noise * rng.standard_normal(read.shape)
        kind = "sensor_msgs/msg/JointState"
        for stamp, when, w in zip(stamps.tolist(), got.tolist(), read, strict=True):
            yield Outgoing("/joint_states", kind, when, make.make(
                kind, header=make.header(stamp, "base_link"),
                name=["wheel_right", "caster", "wheel_left"],
                velocity=np.array([w[1], 0.0, w[0]]), position=np.zeros(3)))  # fmt: skip

    def _gyro(self, make, fine, speed, rng) -> Iterable[Outgoing]:
        t = self.gyro.instants(self.length, rng)
        stamps, got = self.gyro.sent(t, rng)
        turn = RADIUS * (speed[:, 1] - speed[:, 0]) / WIDTH
        read = np.interp(t, fine, turn) + 0.3 * self.noise * rng.standard_normal(len(t))
        kind = "sensor_msgs/msg/Imu"
        for stamp, when, w in zip(stamps.tolist(), got.tolist(), read.tolist(), strict=True):
            yield Outgoing("/imu/data", kind, when, make.make(
                kind, header=make.header(stamp, "imu_link"),
                angular_velocity=make.make("geometry_msgs/msg/Vector3", z=w)))  # fmt: skip

    def write(self, path: Path) -> Path:
        """The recording in a file."""
        return write_bag(path, self.messages)


MAP = {
    "drive_l [drive]": "/cmd_drive.data[0]",
    "drive_r [drive]": "/cmd_drive.data[1]",
    "omega_l": "/joint_states.velocity[wheel_left]",
    "omega_r": "/joint_states.velocity[wheel_right]",
}
"""The columns of such a recording that a fit of the motors takes."""


def _lag(u: np.ndarray, tau: float, dt: float, gain: float) -> np.ndarray:
    from scipy.signal import lfilter

    a = np.exp(-dt / tau)
    return np.asarray(lfilter([gain * (1.0 - a)], [1.0, -a], u))
