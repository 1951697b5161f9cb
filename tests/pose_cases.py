"""Logs with a pose and models of two tracks that the tests of the vehicle stage share."""

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from sysid_datasets.hidden_logs import Hidden, Request, hide

from sysid.criteria.information import information_criteria
from sysid.data.io import read_log
from sysid.data.preprocess import Detrend
from sysid.data.record import PWM_FULL_SCALE, Array, Channel, Record
from sysid.effects.ground import Ground
from sysid.errors import Termination
from sysid.robot.calibration.windows import path_of
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

DT = 0.1
INPUTS = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
OUTPUTS = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
GAIN, TAU = 20.0, 0.25


@cache
def hidden_mission(effect: str, seed: int, noise: str = "low") -> Hidden:
    """A mission log with an effect, or with none."""
    return hide(Request((effect,) if effect else (), seed, noise, rate=10.0, mission=True))


def logs(hidden: Hidden, folder: Path) -> tuple[Record, Record]:
    """The estimation and the validation log; every file is written to ``folder``."""
    for name, text in hidden.files.items():
        folder.joinpath(name).write_text(text, encoding="utf-8")
    return read_log(folder / "est.csv"), read_log(folder / "val.csv")


def driven(
    omega: ArrayLike, ground: Ground | None = None, seed: int = 1, geometry: Geometry | None = None
) -> Record:
    """A record of wheel speeds (N, 2) with the pose they make, noise on both."""
    speeds = np.asarray(omega, dtype=np.float64)
    rng = np.random.default_rng(seed)
    pose = path_of(speeds, DT, ground or Ground(), geometry or Geometry())
    pose = pose + np.array([0.001, 0.001, 0.002]) * rng.normal(size=pose.shape)
    read = speeds + 0.1 * rng.normal(size=speeds.shape)
    return Record(speeds / GAIN * PWM_FULL_SCALE, read, DT, INPUTS, OUTPUTS, pose, name="made.csv")


def wandering(samples: int = 600, seed: int = 5) -> Array:
    """Speeds of many ratios: smooth, forward for the most part, (N, 2) [rad/s]."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(-4.0, 14.0, (samples // 20 + 2, 2))
    at = np.arange(samples) / 20.0
    columns = [np.interp(at, np.arange(len(knots)), knots[:, i]) for i in (0, 1)]
    return np.column_stack(columns)


def ground(effect: str, left: float, right: float | None = None) -> Ground:
    """One effect with its number for the left and the right track."""
    name = {"track-slip": "share", "radius-mismatch": "rho", "track-width": "ratio"}[effect]
    values = np.array([left, left if right is None else right])
    return Ground((effect,), {effect: {name: values}})


def two_tracks(
    gains: tuple[float, float] = (GAIN, GAIN), taus: tuple[float, float] = (TAU, TAU)
) -> Model:
    """A model of two tracks of first order."""
    structure = Augmented(1, 1, (PWM_FULL_SCALE, PWM_FULL_SCALE), DT)
    theta = np.array(
        [v for k, tau in zip(gains, taus, strict=True) for v in (k, -np.exp(-DT / tau))]
    )
    return Model(
        structure=structure,
        theta=theta,
        covariance=1e-6 * np.eye(4),
        parameters=structure.parameters(INPUTS, OUTPUTS),
        dt=DT,
        inputs=INPUTS,
        outputs=OUTPUTS,
        detrend=Detrend.none(2, 2),
        noise_covariance=0.01 * np.eye(2),
        n_estimated=4,
        criteria=information_criteria([np.full((100, 2), 0.1)], 4),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(-16000.0, 16000.0)] * 2 + [(-20.0, 20.0)] * 2),
    )


def true_base(hidden: Hidden) -> Model:
    """The model of the robot's motors as they are."""
    base = hidden.truth["base"]
    assert isinstance(base, dict)
    left, right = base["omega_l"], base["omega_r"]
    return two_tracks((left["K"], right["K"]), (left["tau"], right["tau"]))
