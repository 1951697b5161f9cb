"""Other machines than a robot on tracks, and physics that no effect of the catalogue holds."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from sysid_datasets.physics import actuator_causes, motor_causes
from sysid_datasets.physics.hidden import Cause, Hidden, in_drives, part
from sysid_datasets.physics.logs import PERIOD, Case, Columns
from sysid_datasets.physics.parameters import ANGLE, Controller, Machine
from sysid_datasets.physics.processes import Heater, Tanks
from sysid_datasets.physics.robots import Rig, figures, log_uniform, plain_machine
from sysid_datasets.physics.simulate import Telemetry

OF_ONE_MOTOR: tuple[Cause, ...] = (
    motor_causes.coulomb,
    motor_causes.gap,
    motor_causes.fan,
    actuator_causes.switches_that_turn_on_late,
    actuator_causes.largest_duty,
    actuator_causes.current_limit,
)
"""A late command is none: the plainest base of such a log has a delay of its own."""

OF_A_POSITION: tuple[Cause, ...] = (
    motor_causes.coulomb,
    motor_causes.gap,
    actuator_causes.switches_that_turn_on_late,
    actuator_causes.largest_duty,
)

INNER = 500.0
"""Rate of the loop inside a servo [1/s]."""


def one_motor(base: Case, rng: np.random.Generator) -> Case:
    """A motor on a bench: volts in, revolutions a minute out."""
    columns = Columns((("u_V", base.rig.machine.battery.full),), (("speed_rpm", 30.0 / math.pi),))
    return replace(_with(base, rng, OF_ONE_MOTOR), columns=columns)


def position(base: Case, rng: np.random.Generator) -> Case:
    """The same with its angle as the output."""
    rig = _angular(base.rig)
    base = replace(base, rig=rig, sigma=base.sigma * 0.2, style="steps")
    columns = Columns((("u_V", rig.machine.battery.full),), (("angle_rad", 1.0),))
    return replace(_with(base, rng, OF_A_POSITION), columns=columns)


def servo(base: Case, rng: np.random.Generator) -> Case:
    """A position servo: the log holds its set point, the loop inside runs at 500 Hz."""
    f = figures(base.rig.machine)
    stiff = rng.uniform(1.0, 3.0) / (f.speed * f.time_constant)
    loop = Controller(proportional=stiff, derivative=stiff * f.time_constant * 0.3)
    machine = replace(_angular(base.rig).machine, controller=loop)
    rig = replace(base.rig, machine=machine, telemetry=Telemetry(rate=50.0, loop_rate=INNER))
    # within a third of what saturates the loop at once
    base = replace(base, rig=rig, sigma=1e-4, reference=0.3 / stiff, style="steps")
    columns = Columns((("u_rad", 1.0),), (("y_rad", 1.0),))
    return replace(_with(base, rng, (motor_causes.gap, motor_causes.coulomb)), columns=columns)


def heater(base: Case, rng: np.random.Generator) -> Case:
    """A plate under a thermometer: with a sheath, a transport, a fuse, or none of them.

    Sheath and transport are linear: the base, of up to third order with a delay, misses nothing.
    """
    plate = Heater(capacity=rng.uniform(60.0, 150.0), loss=rng.uniform(0.7, 1.5))
    choice = int(rng.integers(4))
    hidden: tuple[Hidden, ...] = ()
    if choice == 1:
        plate = replace(plate, sheath=rng.uniform(0.1, 0.4) * plate.capacity / plate.loss)
    elif choice == 2:
        plate = replace(plate, late=int(rng.integers(2, 6)) * PERIOD)
    elif choice == 3:
        plate = replace(plate, fuse=rng.uniform(0.4, 0.75))
        hidden = (Hidden("input-saturation", "fuse", {"share": plate.fuse}, (), (0,)),)
    columns = Columns((("u_V", plate.volts),), (("temperature_degC", 1.0),))
    return replace(
        base, process=plate, hidden=hidden, columns=columns, sigma=0.05, duration=1500 * PERIOD
    )


def tanks(base: Case, rng: np.random.Generator) -> Case:
    """Two tanks: levels drain by their roots, which no effect of the catalogue is."""
    made = Tanks(area=rng.uniform(0.002, 0.006), hole=rng.uniform(2e-5, 3e-5))
    columns = Columns((("u_V", made.volts),), (("level_cm", 1.0),))
    return replace(
        base, process=made, outside="outflow by the root of the level", columns=columns,
        sigma=0.1, duration=1500 * PERIOD,
    )  # fmt: skip


MACHINES: dict[str, Callable[[Case, np.random.Generator], Case]] = {
    "one motor": one_motor,
    "position": position,
    "heater": heater,
    "servo": servo,
    "tanks": tanks,
}


def spring(base: Case, rng: np.random.Generator) -> Case:
    """A spring pulls the wheels back to where they began."""
    f = figures(base.rig.machine)
    size = log_uniform(rng, 0.05, 0.3) * f.stall_torque / (f.speed * f.time_constant)
    return _outside(base, rng, "spring", spring=size)


def belt(base: Case, rng: np.random.Generator) -> Case:
    """A belt that creeps: it pulls back and forgets."""
    f = figures(base.rig.machine)
    size = log_uniform(rng, 0.1, 0.5) * f.stall_torque / (f.speed * f.time_constant)
    return _outside(base, rng, "creeping belt", memory=size, memory_time=rng.uniform(1.0, 4.0))


def pump_stroke(base: Case, rng: np.random.Generator) -> Case:
    """A load in a rhythm of its own, whatever the command."""
    share, rate = log_uniform(rng, 0.05, 0.3), rng.uniform(0.3, 2.0)
    return replace(base, rhythm=(share, rate), outside="load in a rhythm of its own")


def cogging(base: Case, rng: np.random.Generator) -> Case:
    """A motor that sticks in its slots at low speed and hardly feels them when fast."""
    f = figures(base.rig.machine)
    motor = base.rig.machine.drives[0]
    size = log_uniform(rng, 0.25, 0.8) * f.stall_torque / motor.gearbox.ratio
    rig, _ = in_drives(rng, base.rig, part("motor", cogging=size))
    drives = tuple(
        replace(d, motor=replace(d.motor, cogging_periods=7.0)) for d in rig.machine.drives
    )
    rig = replace(rig, machine=replace(rig.machine, drives=drives))
    return replace(base, rig=rig, outside="cogging")


OUTSIDE: dict[str, Callable[[Case, np.random.Generator], Case]] = {
    "spring": spring,
    "belt": belt,
    "rhythm": pump_stroke,
    "cogging": cogging,
    "tanks": tanks,
}


def _outside(base: Case, rng: np.random.Generator, words: str, **load: float) -> Case:
    rig, _ = in_drives(rng, base.rig, part("load", **load))
    return replace(base, rig=rig, outside=words)


def _with(base: Case, rng: np.random.Generator, causes: tuple[Cause, ...]) -> Case:
    """One of the causes, or none, once in so many."""
    choice = int(rng.integers(len(causes) + 1))
    if choice == len(causes):
        return base
    rig, found = causes[choice](rng, base.rig, 1.0)
    return replace(base, rig=rig, hidden=(found,))


def _angular(rig: Rig) -> Rig:
    drives = tuple(replace(d, sensor=replace(d.sensor, kind=ANGLE)) for d in rig.machine.drives)
    return replace(rig, machine=replace(rig.machine, drives=drives))


def single_drive(rng: np.random.Generator) -> Machine:
    """A plain machine of one drive."""
    return plain_machine(rng, drives=1)
