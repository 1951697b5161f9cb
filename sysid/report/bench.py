"""Pictures of the test bench: a motor's characteristics, its steps, and measured steady states."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.report.panels import Curve, Panel, PanelPicture, draw_panels, panel
from sysid.testbench.motor.characterise import MotorBench
from sysid.testbench.motor.drive import DriveLog, motion
from sysid.testbench.motor.equations import (
    MotorConstants,
    steady_state,
    step_response,
    time_constant,
    torque_speed,
)
from sysid.testbench.motor.experiments import Kind, SteadyTest
from sysid.testbench.pendulum.inertia import small_swing_period
from sysid.testbench.pendulum.study import PendulumStudy
from sysid.testbench.power.study import PowerBench

THESIS_STEP = 3.0
"""Voltage of the thesis's steps [V] (figures 6.3, 6.4)."""

THESIS_LOAD = 0.017
"""Load of the second of them, at the output shaft [Nm]."""

MOST_LINES = 5
"""Voltages with a characteristic of their own: as many as the thesis draws."""


def motor_picture(bench: MotorBench, load: float = THESIS_LOAD) -> PanelPicture:
    """Characteristics, steps and steady states of a motor of the bench.

    Args:
        load: torque at the output shaft of the loaded step [Nm].
    """
    c, voltages = bench.constants, voltages_of(bench)
    panels = [torque_speed_panel(c, voltages), current_torque_panel(c, voltages)]
    steady = [t for t in bench.tests if t.has("speed")]
    if steady:
        panels += [steady_panel(bench, steady, "speed"), steady_panel(bench, steady, "current")]
    stalled = [t for t in bench.tests if t.kind is Kind.STALL and t.has("torque")]
    panels += [stall_panel(bench, stalled)] if stalled else []
    for log in bench.drives[:1]:
        panels += drive_panels(c, log)
    if c.J > 0.0:
        volts = min(THESIS_STEP, max(voltages))
        panels += [step_panel(bench, volts, (0.0, load))]
    values = ", ".join(
        f"{n} {getattr(c, n):.4g}" for n in ("R", "Kem", "Kc", "f", "C0", "J") if getattr(c, n)
    )
    words = f"{values}, gear {c.gear:g} (SI); dots: measured; bands: 95 %"
    return PanelPicture("Motor on the bench", words, tuple(panels))


def voltages_of(bench: MotorBench) -> tuple[float, ...]:
    """The voltages of the tests without load, at most five; else fifths of the largest one."""
    seen = [v for t in bench.tests if t.kind is Kind.NO_LOAD for v in np.abs(t.voltage).tolist()]
    if not seen:
        top = bench.largest_voltage
        return tuple(top * k / MOST_LINES for k in range(1, MOST_LINES + 1))
    every = sorted(set(seen))
    chosen = np.linspace(0, len(every) - 1, min(len(every), MOST_LINES)).round().astype(int)
    return tuple(every[k] for k in chosen)


def torque_speed_panel(c: MotorConstants, voltages: Sequence[float]) -> Panel:
    """Torque of the output shaft against its speed (figures 2.12 and 5.15)."""
    curves = [(v, torque_speed(c, v)) for v in voltages]
    lines = [Curve(f"{v:g} V", speed, torque) for v, (speed, torque, _) in curves]
    return panel("torque and speed", "speed [rad/s]", "torque [Nm]", lines)


def current_torque_panel(c: MotorConstants, voltages: Sequence[float]) -> Panel:
    """Current against the torque of the output shaft (figure 6.6)."""
    curves = [(v, torque_speed(c, v)) for v in voltages]
    lines = [Curve(f"{v:g} V", torque, current) for v, (_, torque, current) in curves]
    return panel("current and torque", "torque [Nm]", "current [A]", lines)


def _banded(
    bench: MotorBench,
    label: str,
    x: Array,
    curve: Callable[[MotorConstants], Array],
    colour: int,
) -> Curve:
    """A curve with its 95 % band by the constants' covariance C: ± 1.96 √(∂y/∂c C ∂y/∂cᵀ)."""
    c, size = bench.constants, np.sqrt(np.diag(bench.covariance))
    at = np.array([getattr(c, n) for n in bench.names])

    def of(theta: Array) -> Array:
        return curve(replace(c, **dict(zip(bench.names, theta.tolist(), strict=True))))

    moves = np.array([of(at + e) - of(at - e) for e in np.diag(size)]) / 2.0
    scale = np.where(size > 0.0, size, 1.0)
    related = bench.covariance / np.outer(scale, scale)
    reach = NORMAL * np.sqrt(np.maximum(np.einsum("in,ij,jn->n", moves, related, moves), 0.0))
    y = curve(c)
    return Curve(label, x, y, y - reach, y + reach, colour=colour)


def step_panel(bench: MotorBench, voltage: float, loads: Sequence[float]) -> Panel:
    """Speed after a step from standstill, free and loaded (figures 6.3 and 6.4)."""
    seconds = 6.0 * time_constant(bench.constants)
    lines = []
    for k, load in enumerate(loads):

        def speed(c: MotorConstants, load: float = load) -> Array:
            return step_response(c, voltage, load, seconds)[1]

        t = step_response(bench.constants, voltage, load, seconds)[0]
        lines.append(_banded(bench, f"{load:g} Nm" if load else "free", t, speed, k))
    return Panel("step", f"step to {voltage:g} V", "time [s]", "speed [rad/s]", tuple(lines))


def steady_panel(bench: MotorBench, tests: Sequence[SteadyTest], quantity: str) -> Panel:
    """Steady states, measured and by the constants, against the voltage (figure 6.5)."""
    c, lines = bench.constants, list[Curve]()
    for test in tests:
        applied = np.abs(test.motor_torque(c.gear)) * c.gear
        for load in np.unique(np.round(applied, 9)).tolist()[: MOST_LINES - len(lines) // 2]:
            rows = np.isclose(applied, load) & np.isfinite(test.of(quantity))
            if rows.any():
                words = f"{load:.3g} Nm" if load else "free"
                v, colour = test.voltage[rows], len(lines) // 2
                dense = np.linspace(float(v.min()), float(v.max()), 50)

                def modelled(c: MotorConstants, v: Array = dense, load: float = load) -> Array:
                    return steady_state(c, v, load)[quantity == "current"]

                measured = test.of(quantity)[rows]
                lines.append(Curve(words, v, measured, kind="dots", colour=colour))
                lines.append(_banded(bench, "", dense, modelled, colour))
    up = f"{quantity} [{'rad/s' if quantity == 'speed' else 'A'}]"
    return Panel(quantity, f"steady {quantity}", "voltage [V]", up, tuple(lines))


def stall_panel(bench: MotorBench, tests: Sequence[SteadyTest]) -> Panel:
    """Torque of the output shaft at standstill, measured and by the constants."""
    c, lines = bench.constants, list[Curve]()
    for k, test in enumerate(tests[:MOST_LINES]):
        v = np.abs(test.voltage)
        measured = c.gear * np.abs(test.motor_torque(c.gear))
        dense = np.linspace(float(v.min()), float(v.max()), 50)
        lines.append(Curve("", v, measured, kind="dots", colour=k))

        def torque(c: MotorConstants, v: Array = dense) -> Array:
            return np.asarray(c.gear * (c.Kc * v / c.R - c.C0))

        lines.append(_banded(bench, "", dense, torque, k))
    return Panel("stall", "stall torque", "voltage [V]", "torque [Nm]", tuple(lines))


def drive_panels(c: MotorConstants, log: DriveLog) -> list[Panel]:
    """Speed and current of a drive, measured and by the constants from its first row."""
    speed = log.speed_at_rows()
    first = 0.0 if log.current is None else float(log.current[0])
    current, motor, _ = motion(c, log.voltage, log.dt, (first, c.gear * float(speed[0])), log.load)
    shown = [("speed", "rad/s", speed, motor / c.gear)]
    shown += [] if log.current is None else [("current", "A", log.current, current)]
    return [
        panel(
            f"{name}, {log.name}",
            "time [s]",
            f"{name} [{unit}]",
            (Curve("measured", log.t, seen, colour=-1), Curve("constants", log.t, computed)),
        )
        for name, unit, seen, computed in shown
    ]


def draw_swing(path: Path, study: PendulumStudy) -> None:
    """Draw the swings with their fit, what the fit leaves, and each period at its amplitude."""
    first = study.logs[0]
    o, degrees = first.oscillation, 180.0 / np.pi
    panels = [
        panel(
            f"swing, {first.swing.name}",
            "time [s]",
            "angle [°]",
            (
                Curve("measured", o.t, degrees * o.angle, colour=-1),
                Curve("fitted", o.t, degrees * o.fitted),
            ),
        ),
        panel(
            "what the fit leaves",
            "time [s]",
            "angle [°]",
            (Curve("", o.t, degrees * (o.angle - o.fitted), kind="dots"),),
        ),
    ]
    lines, most = [], 0.0
    for log in study.logs[:5]:
        free = log.free
        sizes = log.oscillation.scale * degrees * np.abs(free.swings)
        whole = free.numbers[2:] - free.numbers[:-2] == 2
        at = 0.5 * (sizes[1:] + sizes[:-1])[whole]
        each = (free.passages[2:] - free.passages[:-2])[whole]
        lines.append(Curve(log.swing.name, at, each, kind="dots"))
        most = max(most, float(at.max()))
    shown = np.linspace(0.0, most, 60)
    law = np.array([study.small_period / small_swing_period(1.0, a / degrees) for a in shown])
    reach = law * NORMAL * study.small_std_error / study.small_period
    lines.append(Curve("pendulum with T₀", shown, law, law - reach, law + reach))
    panels.append(panel("each period", "amplitude [°]", "period [s]", lines))
    draw_panels(
        path,
        f"Inertia {study.corrected:.4f} ± {NORMAL * study.corrected_std_error:.2g} kg m²",
        f"± and band 95 %; T₀ = {study.small_period:.5f} ± "
        f"{NORMAL * study.small_std_error:.2g} s, mean period "
        f"{study.period:.5f} s at {degrees * study.amplitude:.3g}°",
        tuple(panels),
    )


def draw_power(path: Path, bench: PowerBench) -> None:
    """Draw each battery's voltage with its fit, and each staircase with its lines."""
    panels = [
        panel(
            f"battery, {b.name}",
            "time [s]" if b.charge is not None else "row",
            "voltage [V]",
            (Curve("measured", b.t, b.voltage, colour=-1), Curve("fitted", b.t, b.fitted)),
        )
        for b in bench.batteries[:3]
    ]
    for bridge in bench.bridges[:3]:
        lines = []
        for k, (name, d) in enumerate(bridge.directions().items()):
            sign = 1.0 if name == "forward" else -1.0
            lines.append(Curve(name, d.drive, d.answer, kind="dots", colour=k))
            shown = np.linspace(0.0, 1.0, 400)
            line = sign * d.line(shown)
            edge = d.gain * np.hypot(d.dead_band_std_error, d.jump_std_error)
            reach = NORMAL * np.interp(shown, [d.dead_band, 1.0], [edge, d.at_full_std_error])
            reach = np.where(line != 0.0, reach, 0.0)
            lines.append(Curve("", sign * shown, line, line - reach, line + reach, colour=k))
        title = f"bridge, {bridge.name} {bridge.side}".rstrip()
        up = f"{bridge.quantity} [{bridge.unit}]"
        panels.append(Panel("bridge", title, "drive", up, tuple(lines)))
    measured = ", ".join(f"{k} {m.value:.3g}" for k, m in bench.supply().items())
    draw_panels(path, "Power supply, bands 95 %", measured, tuple(panels))
