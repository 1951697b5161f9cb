"""Causes between the shaft and the log, and between the tracks and the pose."""

import math
from dataclasses import replace

import numpy as np
from sysid_datasets.physics.hidden import Cause, Hidden, in_drives, part, timed, wired
from sysid_datasets.physics.parameters import TICKS, Drive
from sysid_datasets.physics.robots import (
    SPREAD,
    Rig,
    figures,
    log_uniform,
    on_firm_ground,
    seen_from_above,
    with_body,
)

Drawn = tuple[Rig, Hidden]

SIDEWAYS = "lateral-slip"
"""Ground that creeps gives sideways, too: in arcs the bodies here slide outwards by .01 to .05 s of
v ψ̇, 10 to 50 standard errors from none in their own poses."""


def tacho_filter(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """An analogue low-pass behind a tacho."""
    size = log_uniform(rng, 0.04, 0.4) * factor
    rig, channels = in_drives(rng, rig, part("sensor", filter_time=size))
    also, same = ("actuator-lag",), {"lag": size}
    return rig, Hidden(
        "sensor-lag", "filter of the tacho", {"time_s": size}, also, channels, same, spread=SPREAD
    )


def full_scale(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A converter that ends below the free speed."""
    share = max(1.0 - log_uniform(rng, 0.1, 0.6) * factor, 0.15)
    limit = share * figures(rig.machine).speed
    return wired(rig, largest=limit), Hidden(
        "sensor-saturation",
        "full scale of a converter",
        {"limit_rad_s": limit},
        (),
        (0, 1),
        {"limit": limit},
    )


def zero_point(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """An amplifier off its zero."""
    size = log_uniform(rng, 0.01, 0.12) * factor * figures(rig.machine).speed
    size *= float(rng.choice([-1.0, 1.0]))
    both = tuple(size * s for s in rng.uniform(0.9, 1.1, len(rig.machine.drives)))
    also, same = ("load-bias",), {"bias": size}
    return wired(rig, offset=both), Hidden(
        "sensor-bias", "zero point", {"rad_s": size}, also, (0, 1), same, spread=0.1
    )


def one_channel(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """An encoder with one channel: ticks without a direction."""

    def change(drive: Drive, spread: float) -> Drive:
        return replace(drive, sensor=replace(drive.sensor, signless=1.0))

    drives = tuple(change(d, 1.0) for d in rig.machine.drives)
    rig = replace(rig, machine=replace(rig.machine, drives=drives))
    return rig, Hidden("unsigned-speed", "encoder of one channel", {}, (), (0, 1))


def coarse_ticks(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Few ticks a turn, differenced over a line of the log."""
    quantum = log_uniform(rng, 0.02, 0.15) * factor * figures(rig.machine).speed
    lines = max(round(2.0 * math.pi * rig.telemetry.rate / quantum), 4)
    drives = tuple(
        replace(d, sensor=replace(d.sensor, kind=TICKS, lines=float(lines)))
        for d in rig.machine.drives
    )
    rig = replace(rig, machine=replace(rig.machine, drives=drives))
    quantum = 2.0 * math.pi * rig.telemetry.rate / lines
    sizes = {"ticks_a_turn": float(lines), "quantum_rad_s": quantum}
    return rig, Hidden("quantisation", "coarse encoder", sizes, (), (0, 1), {"quantum": quantum})


def lost_lines(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Telegrams that do not arrive: the last value stays, or a zero stands there."""
    share = min(log_uniform(rng, 0.01, 0.08) * factor, 0.3)
    zero = bool(rng.integers(2))
    sizes = {"share": share, "zero": float(zero)}
    return wired(rig, lost=share, lost_is_zero=zero), Hidden(
        "dropouts", "lost telegrams", sizes, (), (0, 1)
    )


def slow_sensor(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A drive that reports more slowly than the log is written."""
    rows = int(rng.integers(2, 7))
    refresh = rows / rig.telemetry.rate
    return timed(rig, refresh=refresh), Hidden(
        "held-telemetry", "slow report", {"refresh_s": refresh}, (), (0, 1)
    )


def eccentric_encoder(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A code wheel off its centre."""
    size = min(log_uniform(rng, 0.01, 0.15) * factor, 0.3)
    phase = rng.uniform(0.0, 2.0 * math.pi)

    def change(drive: Drive, spread: float) -> Drive:
        off = replace(drive.sensor, eccentricity=size * spread, eccentric_phase=phase)
        return replace(drive, sensor=off)

    rig, channels = in_drives(rng, rig, change)
    return rig, Hidden("speed-ripple", "eccentric encoder", {"share": size}, (), channels)


def scrubbing(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Tracks that scrub sideways in a turn, on ground that gives: the body turns less."""
    ratio = min(log_uniform(rng, 0.15, 1.2) * factor, 2.0)
    machine = with_body(rig.machine, rng)
    body = replace(
        machine.body,
        length=ratio * machine.body.width,
        creep=rng.uniform(0.05, 0.2),
        slip_speed=0.005,
    )
    rig = seen_from_above(replace(rig, machine=replace(machine, body=body)))
    also = ("track-slip", "cross-coupling", "coulomb-friction", "longitudinal-slip", "scrub-lag")
    also = (*also, SIDEWAYS)
    return rig, Hidden("track-width", "scrubbing", {"length_over_width": ratio}, also)


def other_width(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The tracks stand further apart than the drawing says."""
    ratio = 1.0 + log_uniform(rng, 0.03, 0.3) * factor
    rig = seen_from_above(rig)
    body = replace(rig.machine.body, width=rig.machine.body.width * ratio)
    rig = replace(rig, machine=replace(rig.machine, body=body))
    same = {"ratio": 1.0 / ratio}
    sizes = {"ratio": ratio}
    return rig, Hidden("track-width", "wider than drawn", sizes, ("track-slip",), (), same)


def worn_sprocket(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """One sprocket smaller than the other."""
    ratio = 1.0 + log_uniform(rng, 0.01, 0.1) * factor * rng.choice([-1.0, 1.0])
    rig = seen_from_above(rig)
    body = replace(rig.machine.body, radius_right=rig.machine.body.radius_right * ratio)
    rig = replace(rig, machine=replace(rig.machine, body=body))
    return rig, Hidden("radius-mismatch", "unequal sprockets", {"right_over_left": ratio})


def soft_ground(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Ground that gives under the tracks' thrust, which rolling resistance asks for."""
    creep = log_uniform(rng, 0.1, 1.0) * factor
    machine = with_body(rig.machine, rng)
    body = replace(machine.body, creep=creep, rolling=rng.uniform(0.1, 0.3), slip_speed=0.005)
    rig = seen_from_above(replace(rig, machine=replace(machine, body=body)))
    # a body that ground which gives pulls along late is a law of inertial-coupling, share or none
    also = ("coulomb-friction", "stiction", "scrub-lag", "inertial-coupling", SIDEWAYS)
    return rig, Hidden("longitudinal-slip", "soft ground", {"creep": creep}, also)


def turning_follows(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A long, heavy body on soft feet: its heading follows the wheels, its way hardly lags."""
    lag, long = log_uniform(rng, 0.05, 0.4) * factor, rng.uniform(4.0, 8.0)
    machine = on_firm_ground(with_body(rig.machine, rng, coupled=long - 1.0))
    # the ground is a damper of grip m g/slip_speed: both lags follow from it
    soft = lag / long * machine.body.grip * machine.body.gravity
    rig = replace(rig, machine=replace(machine, body=replace(machine.body, slip_speed=soft)))
    also = ("inertial-coupling", "longitudinal-slip", SIDEWAYS)
    return seen_from_above(rig), Hidden(
        "scrub-lag", "heavy body on soft feet", {"lag_s": lag, "yaw_over_balanced": long}, also
    )


CAUSES: dict[str, tuple[Cause, ...]] = {
    "sensor-lag": (tacho_filter,),
    "sensor-saturation": (full_scale,),
    "sensor-bias": (zero_point,),
    "unsigned-speed": (one_channel,),
    "quantisation": (coarse_ticks,),
    "dropouts": (lost_lines,),
    "held-telemetry": (slow_sensor,),
    "speed-ripple": (eccentric_encoder,),
    "track-width": (other_width, scrubbing),
    "radius-mismatch": (worn_sprocket,),
    "longitudinal-slip": (soft_ground,),
    "scrub-lag": (turning_follows,),
}
