"""Causes in motor, gear and load."""

import math
from dataclasses import replace

import numpy as np
from sysid_datasets.physics.hidden import Cause, Hidden, in_drives, part
from sysid_datasets.physics.parameters import Drive
from sysid_datasets.physics.robots import (
    SPREAD,
    Rig,
    figures,
    log_uniform,
    on_firm_ground,
    with_body,
)

Drawn = tuple[Rig, Hidden]


def gap(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Play between elastic teeth; a load side that is light or heavy and rubs a little."""
    play = min(log_uniform(rng, 0.04, 1.0) * factor, 6.2)
    share = log_uniform(rng, 0.05, 0.7)
    rub = log_uniform(rng, 0.005, 0.04) * figures(rig.machine).stall_torque

    def change(drive: Drive, spread: float) -> Drive:
        motor, gear = drive.motor, drive.gearbox
        total = gear.load_inertia + motor.inertia * gear.ratio**2
        load = share * total
        light = load * (1.0 - share)
        stiffness = light * rng.uniform(150.0, 400.0) ** 2
        damping = 2.0 * rng.uniform(0.05, 0.4) * math.sqrt(stiffness * light)
        friction = replace(drive.friction, coulomb_forward=rub, coulomb_backward=rub)
        return replace(
            drive,
            motor=replace(motor, inertia=(1.0 - share) * total / gear.ratio**2),
            gearbox=replace(
                gear, load_inertia=load, gap=play * spread, stiffness=stiffness, damping=damping
            ),
            friction=friction,
        )

    rig, channels = in_drives(rng, rig, change)
    sizes = {"gap_rad": play, "load_share": share, "friction_N_m": rub}
    return rig, Hidden(
        "backlash",
        "play between teeth",
        sizes,
        ("coulomb-friction", "position-play"),
        channels,
        {"gap": play},
        spread=SPREAD,
    )


def coulomb(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Dry friction of the output shaft."""
    share = min(log_uniform(rng, 0.015, 0.2) * factor, 0.5)
    size = share * figures(rig.machine).stall_torque
    rig, channels = in_drives(
        rng, rig, part("friction", coulomb_forward=size, coulomb_backward=size)
    )
    sizes = {"share_of_stall": share, "N_m": size}
    return rig, Hidden("coulomb-friction", "dry friction", sizes, ("stiction",), channels)


def stribeck(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Dry friction that is larger at rest."""
    f = figures(rig.machine)
    share = min(log_uniform(rng, 0.03, 0.15) * factor, 0.4)
    size, more, speed = share * f.stall_torque, rng.uniform(1.4, 2.5), rng.uniform(0.02, 0.08)

    def change(drive: Drive, spread: float) -> Drive:
        dry = replace(
            drive.friction,
            coulomb_forward=size * spread,
            coulomb_backward=size * spread,
            breakaway=more,
            stribeck_speed=speed * f.speed,
        )
        return replace(drive, friction=dry)

    rig, channels = in_drives(rng, rig, change)
    sizes = {"share_of_stall": share, "breakaway": more, "stribeck_rad_s": speed * f.speed}
    return rig, Hidden("stiction", "Stribeck friction", sizes, ("coulomb-friction",), channels)


def bristles(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Dry friction that gives elastically before it slides (LuGre)."""
    f = figures(rig.machine)
    share = min(log_uniform(rng, 0.03, 0.2) * factor, 0.4)
    twist = log_uniform(rng, 0.003, 0.05)
    size = share * f.stall_torque

    def change(drive: Drive, spread: float) -> Drive:
        inertia = drive.gearbox.load_inertia + drive.motor.inertia * drive.gearbox.ratio**2
        damping = math.sqrt(size / twist * inertia)
        dry = replace(
            drive.friction,
            coulomb_forward=size * spread,
            coulomb_backward=size * spread,
            presliding=twist,
            bristle_damping=damping,
            breakaway=1.3,
            stribeck_speed=0.03 * f.speed,
        )
        return replace(drive, friction=dry)

    rig, channels = in_drives(rng, rig, change)
    sizes = {"share_of_stall": share, "presliding_rad": twist}
    return rig, Hidden("coulomb-friction", "bristles (LuGre)", sizes, ("stiction",), channels)


def loaded_gear(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A worm or planetary gear: dry friction that grows with the torque it transmits."""
    f = figures(rig.machine)
    share, base = min(log_uniform(rng, 0.04, 0.3) * factor, 0.5), 0.02 * f.stall_torque
    rig, channels = in_drives(
        rng,
        rig,
        part("friction", coulomb_forward=base, coulomb_backward=base, load_share=share),
    )
    sizes = {"share_of_torque": share, "N_m": base}
    also = ("stiction", "coast-asymmetry")
    return rig, Hidden("coulomb-friction", "friction by load", sizes, also, channels)


def fan(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A torque that grows with the square of the speed."""
    f = figures(rig.machine)
    share = min(log_uniform(rng, 0.05, 0.6) * factor, 2.0)
    rig, channels = in_drives(
        rng, rig, part("friction", quadratic=share * f.stall_torque / f.speed**2)
    )
    sizes = {"share_of_stall_at_free_speed": share}
    return rig, Hidden("quadratic-drag", "fan", sizes, (), channels)


def constant_load(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A weight on a drum."""
    share = log_uniform(rng, 0.02, 0.2) * factor * rng.choice([-1.0, 1.0])
    size = share * figures(rig.machine).stall_torque
    rig, channels = in_drives(rng, rig, part("load", constant=size))
    return rig, Hidden("load-bias", "constant load", {"share_of_stall": share}, (), channels)


def sided_viscosity(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A seal that rubs more one way: viscous friction per direction."""
    f = figures(rig.machine)
    more = log_uniform(rng, 0.08, 0.8) * factor * f.stall_torque / f.speed
    back = bool(rng.integers(2))

    def change(drive: Drive, spread: float) -> Drive:
        name = "viscous_backward" if back else "viscous_forward"
        grown = {name: getattr(drive.friction, name) + more * spread}
        return replace(drive, friction=replace(drive.friction, **grown))

    rig, channels = in_drives(rng, rig, change)
    sizes = {"more_N_m_s": more, "backward": float(back)}
    also = ("direction-asymmetry",)
    return rig, Hidden("viscous-asymmetry", "viscous friction per way", sizes, also, channels)


def heat(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The winding warms by the square of its current, its resistance rises with it."""
    f = figures(rig.machine)
    rise = log_uniform(rng, 20.0, 200.0) * factor
    time = log_uniform(rng, 10.0, 60.0)
    watts = 0.08 * f.stall_current**2 * rig.machine.drives[0].motor.resistance
    out = rise / watts

    def change(drive: Drive, spread: float) -> Drive:
        warm = replace(
            drive.thermal,
            winding_capacity=0.5 * time / out,
            housing_capacity=time / out,
            winding_to_housing=0.7 * out * spread,
            housing_to_air=0.3 * out * spread,
        )
        return replace(drive, thermal=warm)

    rig, channels = in_drives(rng, rig, change)
    sizes = {"typical_rise_K": rise, "time_s": time}
    return rig, Hidden("thermal-fade", "warm winding and magnets", sizes, (), channels)


def eccentric_gear(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A gear or sprocket off its centre: the ratio changes within a turn."""
    size = min(log_uniform(rng, 0.01, 0.15) * factor, 0.3)
    phase, periods = rng.uniform(0.0, 2.0 * math.pi), float(rng.integers(1, 4))

    def change(drive: Drive, spread: float) -> Drive:
        off = replace(
            drive.gearbox,
            eccentricity=size * spread,
            eccentric_phase=phase,
            eccentric_periods=periods,
        )
        return replace(drive, gearbox=off)

    rig, channels = in_drives(rng, rig, change)
    sizes = {"share": size, "per_turn": periods}
    return rig, Hidden("speed-ripple", "eccentric gear", sizes, (), channels)


def unbalanced(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A weight on an arm: a torque by the sine of the angle."""
    share = log_uniform(rng, 0.03, 0.4) * factor
    size, phase = share * figures(rig.machine).stall_torque, rng.uniform(-math.pi, math.pi)

    def change(drive: Drive, spread: float) -> Drive:
        return replace(drive, load=replace(drive.load, gravity=size * spread, gravity_phase=phase))

    rig, channels = in_drives(rng, rig, change)
    sizes = {"share_of_stall": share, "phase_rad": phase}
    return rig, Hidden("gravity-load", "unbalanced wheel", sizes, ("speed-ripple",), channels)


def soft_ground_turns(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A body that the ground resists in turning, in proportion to the rate."""
    f = figures(rig.machine)
    share = log_uniform(rng, 0.05, 0.8) * factor
    machine = on_firm_ground(with_body(rig.machine, rng))
    b = machine.body
    damping = f.stall_torque / f.speed
    rate = share * damping * (b.width / b.radius_left) ** 2 / 2.0
    body = replace(b, yaw_viscosity=rate)
    rig = replace(rig, machine=replace(machine, body=body))
    sizes = {"share_of_damping": share}
    return rig, Hidden("cross-coupling", "viscous resistance to turning", sizes)


def body_inertia(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A body whose mass and yaw inertia do not balance: each track feels the other accelerate."""
    more = log_uniform(rng, 0.15, 1.5) * factor
    off = more if rng.uniform() < 0.5 else -more / (1.0 + more)
    machine = on_firm_ground(with_body(rig.machine, rng, coupled=off))
    rig = replace(rig, machine=machine)
    return rig, Hidden("inertial-coupling", "mass of the body", {"yaw_over_balanced": off})


CAUSES: dict[str, tuple[Cause, ...]] = {
    "backlash": (gap,),
    "coulomb-friction": (coulomb, bristles, loaded_gear),
    "stiction": (stribeck,),
    "quadratic-drag": (fan,),
    "load-bias": (constant_load,),
    "viscous-asymmetry": (sided_viscosity,),
    "thermal-fade": (heat,),
    "speed-ripple": (eccentric_gear,),
    "gravity-load": (unbalanced,),
    "cross-coupling": (soft_ground_turns,),
    "inertial-coupling": (body_inertia,),
}
