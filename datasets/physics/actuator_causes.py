"""Causes before the motor: controller board, bridge, battery, command line."""

from dataclasses import replace

import numpy as np
from sysid_datasets.physics.hidden import Cause, Hidden, in_drives, part, timed
from sysid_datasets.physics.parameters import ONE_QUADRANT, Drive
from sysid_datasets.physics.robots import SPREAD, Change, Rig, figures, log_uniform

Drawn = tuple[Rig, Hidden]


def pulses_left_out(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A driver that leaves out short pulses: beyond them the whole command arrives."""
    size = min(log_uniform(rng, 0.04, 0.3) * factor, 0.6)
    rig, channels = in_drives(rng, rig, part("firmware", shortest_pulse=size))
    return rig, Hidden(
        "dead-zone",
        "short pulses left out",
        {"duty": size},
        (),
        channels,
        {"plus": size, "minus": size},
        spread=SPREAD,
    )


def switches_that_turn_on_late(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Every pulse loses the time the switch takes: the command less a constant."""
    size = min(log_uniform(rng, 0.03, 0.25) * factor, 0.6)
    rig, channels = in_drives(rng, rig, part("firmware", turn_on=size))
    return rig, Hidden(
        "dead-zone",
        "pulses shortened by the turn-on",
        {"duty": size},
        (),
        channels,
        {"plus": size, "minus": size},
        spread=SPREAD,
    )


def largest_duty(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A bootstrap supply or a careful programmer bounds the duty."""
    size = max(1.0 - log_uniform(rng, 0.12, 0.6) * factor, 0.15)
    rig, channels = in_drives(rng, rig, part("firmware", largest=size))
    return rig, Hidden(
        "input-saturation",
        "duty bounded",
        {"duty": size},
        (),
        channels,
        {"plus": size, "minus": size},
        spread=SPREAD,
    )


def remote_curve(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The expo setting of a remote control, mild commands made stronger."""
    size = min(log_uniform(rng, 0.08, 0.5) * factor, 0.5)
    rig, channels = in_drives(rng, rig, part("firmware", expo=size))
    return rig, Hidden("concave-gain", "expo of a remote control", {"expo": size}, (), channels)


def brushes(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Brushes off the neutral: another motor constant turning backward."""
    off = log_uniform(rng, 0.04, 0.25) * factor * rng.choice([-1.0, 1.0])

    def change(drive: Drive, spread: float) -> Drive:
        return replace(
            drive, motor=replace(drive.motor, backward_constant=max(1.0 + off * spread, 0.3))
        )

    rig, channels = in_drives(rng, rig, change)
    also = ("viscous-asymmetry",)
    return rig, Hidden(
        "direction-asymmetry", "brushes off the neutral", {"constant": 1.0 + off}, also, channels
    )


def late_command(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A radio line, or a board that polls: commands act late."""
    delay = round(log_uniform(rng, 0.4, 4.0) * factor / rig.telemetry.rate, 4)
    rig = timed(rig, command_delay=delay)
    same = {"delay": delay}
    return rig, Hidden("input-delay", "commands act late", {"delay_s": delay}, (), (0, 1), same)


def slew(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The board moves the duty no faster than this."""
    size = 4.0 / (log_uniform(rng, 1.0, 10.0) * factor)
    rig, channels = in_drives(rng, rig, part("firmware", slew=size))
    same = {"rate": size}
    return rig, Hidden(
        "rate-limit", "duty slewed", {"per_s": size}, (), channels, same, spread=SPREAD
    )


def soft_start(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A low-pass of the board on the duty."""
    size = log_uniform(rng, 0.04, 0.4) * factor
    rig, channels = in_drives(rng, rig, part("firmware", soft_start=size))
    same = {"lag": size}
    also = ("sensor-lag",)
    return rig, Hidden(
        "actuator-lag", "duty low-passed", {"time_s": size}, also, channels, same, spread=SPREAD
    )


def battery_resistance(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The bus falls with the current of both motors: by a share of it when both start."""
    f = figures(rig.machine)
    sag = min(log_uniform(rng, 0.03, 0.45) * factor, 0.7)
    drives = len(rig.machine.drives)
    resistance = sag / (1.0 - sag) * rig.machine.battery.full / f.stall_current / drives
    battery = replace(rig.machine.battery, resistance=resistance)
    rig = replace(rig, machine=replace(rig.machine, battery=battery))
    sizes = {"ohm": resistance, "share_at_stall": sag}
    return rig, Hidden("supply-sag", "resistance of the battery", sizes)


def battery_runs_down(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """A small cell: the open-circuit voltage falls with the charge that was taken."""
    f = figures(rig.machine)
    fall = min(log_uniform(rng, 0.05, 0.4) * factor, 0.6)
    # typical commands take a tenth of the stall current of each motor, for about 100 s
    taken = 0.1 * f.stall_current * len(rig.machine.drives) * 100.0
    full = rig.machine.battery.full
    battery = replace(rig.machine.battery, slope=fall * full, capacity=taken)
    rig = replace(rig, machine=replace(rig.machine, battery=battery))
    sizes = {"fall_when_empty": fall, "ampere_seconds": taken}
    return rig, Hidden("battery-discharge", "charge taken from the battery", sizes)


def dead_time(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Both switches of a leg wait: the current's sign takes voltage away."""
    size = min(log_uniform(rng, 0.01, 0.1) * factor, 0.25)
    current = 0.02 * figures(rig.machine).stall_current
    rig, channels = in_drives(
        rng, rig, part("bridge", dead_time=size, ripple_current=current, diode_drop=0.7)
    )
    also = ("coulomb-friction", "stiction")
    return rig, Hidden("dead-time", "dead time of the legs", {"share": size}, also, channels)


def current_limit(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """The bridge chops beyond a current."""
    share = 0.75 / (log_uniform(rng, 1.0, 4.5) * factor)
    rig, channels = in_drives(
        rng, rig, part("bridge", current_limit=share * figures(rig.machine).stall_current)
    )
    sizes = {"share_of_stall": share}
    return rig, Hidden("current-limit", "chopped current", sizes, (), channels)


def diodes(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """Diodes carry the current on: the motor coasts while it outruns the command."""
    rig, channels = in_drives(rng, rig, _coasting(rng, quadrants=ONE_QUADRANT))
    also = ("coast-asymmetry", "dead-zone")  # the drop takes a little of every command
    return rig, Hidden("freewheel", "bridge of one quadrant", {}, also, channels)


def open_at_zero(rng: np.random.Generator, rig: Rig, factor: float) -> Drawn:
    """All switches open at a command of zero, and only then."""
    rig, channels = in_drives(rng, rig, _coasting(rng, coast_at_zero=1.0))
    also = ("coast-asymmetry",)
    return rig, Hidden(
        "freewheel",
        "switches open at zero",
        {},
        also,
        channels,
        styles=("steps", "joystick"),
    )


def _coasting(rng: np.random.Generator, **bridge: float) -> Change:
    drop = rng.uniform(0.2, 0.5)

    def change(drive: Drive, spread: float) -> Drive:
        return replace(drive, bridge=replace(drive.bridge, diode_drop=drop, **bridge))

    return change


CAUSES: dict[str, tuple[Cause, ...]] = {
    "dead-zone": (pulses_left_out, switches_that_turn_on_late),
    "input-saturation": (largest_duty,),
    "concave-gain": (remote_curve,),
    "direction-asymmetry": (brushes,),
    "input-delay": (late_command,),
    "rate-limit": (slew,),
    "actuator-lag": (soft_start,),
    "supply-sag": (battery_resistance,),
    "battery-discharge": (battery_runs_down,),
    "dead-time": (dead_time,),
    "current-limit": (current_limit,),
    "freewheel": (diodes, open_at_zero),
}
