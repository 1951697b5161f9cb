"""The motor of the bench as a model: structure dc-motor with the constants of the bench."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Channel
from sysid.errors import Termination
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.model import Model, Provenance
from sysid.testbench.motor.characterise import MotorBench
from sysid.testbench.motor.equations import steady_state, time_constant
from sysid.version import __version__

NAMES: Mapping[str, str] = {
    "R": "resistance",
    "Kem": "back_emf",
    "Kc": "torque_constant",
    "f": "motor_viscous",
    "J": "motor_inertia",
    "C0": "motor_friction",
}
"""Constant of the bench → constant of the structure."""

SAMPLE_TIME = 0.1
"""Sample time [s] of the robot, for which a model is made where there is no drive."""

CHANNELS = ("voltage", "omega")
"""Names of input and output where there is no drive."""


def bench_model(
    bench: MotorBench,
    files: Sequence[Path] = (),
    dt: float | None = None,
    channels: tuple[str | None, str | None] = (None, None),
) -> Model | None:
    """The dc-motor of these constants, voltage [V] in, speed of the output shaft [rad/s] out.

    What was estimated keeps its standard error and its correlations; L di/dt is neglected, as in
    the structure. None where J is not known: the model would have no dynamics.

    Args:
        files: what they came from, for the provenance.
        dt: sample time [s]; that of the drive, or of the robot, unless given.
        channels: names of input and output, None for those of the drive's log.
    """
    c = bench.constants
    if not c.J > 0.0:
        return None
    log = next((d for d in bench.drives if d.speed is not None), None)
    dt = dt or (log.dt if log else SAMPLE_TIME)
    usual = log.channels if log else CHANNELS
    inputs = (Channel(channels[0] or usual[0], "V"),)
    outputs = (Channel(channels[1] or usual[1], "rad/s"),)
    physics = MotorPhysics(1, 1, input="voltage", friction="coulomb", parametrisation="bench")
    top = bench.largest_voltage
    steps = max(1, int(np.ceil(10.0 * dt / time_constant(c))))
    structure = DCMotor(physics, Sampling(dt, steps, ((-top, top),)))
    values = {name_there: getattr(c, name) for name, name_there in NAMES.items()}
    values |= {"gear": c.gear, "load_inertia": 0.0, "bridge_gain": 1.0, "friction_torque": 0.0}
    theta = physics.pack(values)
    estimated = {NAMES[n]: k for k, n in enumerate(bench.names) if n in NAMES}
    table = structure.parameters(inputs, outputs)
    index = {p.name: k for k, p in enumerate(table)}
    covariance = np.zeros((len(table), len(table)))
    for a, i in estimated.items():
        for b, j in estimated.items():
            covariance[index[a], index[b]] = bench.covariance[i, j]
    speed = float(steady_state(c, np.array([top]))[0][0])
    noise = [g.noise for g in bench.joint.groups if g.quantity == "speed"]
    return Model(
        structure=structure,
        theta=theta,
        covariance=covariance,
        parameters=tuple(
            replace(p, fixed=None if p.name in estimated else float(v))
            for p, v in zip(table, theta, strict=True)
        ),
        dt=dt,
        inputs=inputs,
        outputs=outputs,
        detrend=Detrend.none(1, 1),
        noise_covariance=np.array([[float(np.mean(np.square(noise))) if noise else 0.0]]),
        n_estimated=len(estimated),
        criteria={},
        termination=Termination.CLOSED_FORM,
        ranges=np.array([[-top, top], [-speed, speed]]),
        warnings=tuple(bench.notes),
        provenance=Provenance(
            options={"made_by": "bench motor", "experiments": [str(f) for f in files]},
            version=__version__,
        ),
    )
