"""Chapter 5.3 and 6.1.1: the motor of the bench, from the tables that the thesis prints."""

from functools import cache

import numpy as np
import sysid_datasets

from sysid.data.record import Array
from sysid.report.panels import Curve, Panel, PanelPicture, panel
from sysid.testbench.motor.characterise import MotorBench, characterise_motor
from sysid.testbench.motor.equations import (
    PUBLISHED,
    MotorConstants,
    steady_state,
    step_response,
    time_constant,
    torque_speed,
)
from sysid.testbench.motor.experiments import Kind
from thesis.entries import DRAWN, Row, Sheet, compared, line, number

RPM = 30.0 / np.pi
LOADS = (0.0108, 0.0135, 0.0152, 0.0169, 0.0187, 0.0209)
"""Table 5.1 [Nm]."""
STEP_LOAD = 0.017
"""Load of 6.4 [Nm]."""
UNDER_LOAD = "the speeds under load, of which the printed f and C0 are means, are not printed"


@cache
def bench() -> MotorBench:
    """The bundled tables, one experiment at a time as the thesis."""
    folder = sysid_datasets.path("motor_no_load").parent
    names = ("values", "no_load", "stall", "external_load")
    return characterise_motor([folder / f"motor_{name}.csv" for name in names])


def table(kind: Kind, *quantities: str) -> tuple[Array, ...]:
    """Voltage and the given quantities of the experiments of a kind."""
    (test,) = (t for t in bench().tests if t.kind is kind)
    return (test.voltage, *(test.of(q) for q in quantities))


def value(name: str) -> float:
    """A constant from the tables, one experiment at a time."""
    (found,) = (p for p in bench().parameters if p.name == name)
    assert found.value is not None
    return found.value


def another(name: str) -> float:
    """The same constant by the second way that the tables tell it."""
    return [route.value for route in bench().routes if route.name == name][1]


def constants() -> Sheet:
    """5.8, 5.10–5.12, 5.15, Table 5.1: measurements and what they give."""
    volts, current, speed = table(Kind.NO_LOAD, "current", "speed")
    _, torque = table(Kind.STALL, "torque")
    slope, offset = np.polyfit(volts, current, 1)
    predicted = steady_state(PUBLISHED, volts)[0] / speed - 1.0
    stalled = (PUBLISHED.Kc * volts / PUBLISHED.R - PUBLISHED.C0) / torque - 1.0
    loaded = steady_state(PUBLISHED, volts, LOADS[-1])[0] * RPM
    back_emf = (volts - PUBLISHED.R * current) / (PUBLISHED.gear * speed)
    each_kc = torque / (volts / PUBLISHED.R - current)
    rows = (
        Row("§5.3.1", "R [Ω]", "3.1", "–", "not recomputable",
            "voltage and current of the blocked rotor are not printed"),
        Row("5.8", "current without load [mA]", "170 to 210",
            f"{number(1e3 * offset, '.0f')} mA + {number(1e3 * slope, '.0f')} mA/V",
            "none", "all five readings on a line, printed to 10 mA"),
        compared("5.10", "K_em [V/(rad/s)]", PUBLISHED.Kem, value("Kem"), ".4f",
                 f"mean of (V − Ri)/ω_m, {value('Kem'):.6f}, printed with two digits"),
        compared("5.11", "K_c [Nm/A], stall torque over V/R − i₀", PUBLISHED.Kc, value("Kc"),
                 ".4e", "printed as an interpolation of the same points, which is not described"),
        compared("5.11", "K_c [Nm/A], stall torque over the whole stall current", PUBLISHED.Kc,
                 another("Kc"), ".3e", "the other reading of the same experiment"),
        compared("5.12", "f [Nm/(rad/s)], from the readings without load", PUBLISHED.f, value("f"),
                 ".3e", UNDER_LOAD),
        compared("5.12", "C₀ [Nm], from the readings without load", PUBLISHED.C0, value("C0"),
                 ".3e", UNDER_LOAD),
        Row("Table in 5.3.2", "current without load", "five readings, 170 to 210 mA",
            f"read from `motor_no_load`, {len(current)} readings", "none", "bundled as printed"),
        Row("Table in 5.3.3, speeds", "V − Ri at 3 to 5 V over ω_m [mV/(rad/s)]", "2.3",
            ", ".join(number(1e3 * v, ".2f") for v in back_emf), "none",
            "each reading's K_em; printed as their mean"),
        Row("Table in 5.3.3, torques", "stall torque over V/R − i₀ at 3 to 5 V [10⁻⁴ Nm/A]",
            "8.6626", ", ".join(number(1e4 * v, ".2f") for v in each_kc), "–",
            "each reading's K_c: they spread by far more than the digits printed"),
        Row("Table 5.1", f"speed at 3 to 5 V under {LOADS[-1]} Nm [rpm]", DRAWN,
            ", ".join(number(v, ".0f") for v in loaded), "–", "from the printed constants"),
        Row("§5.3", "J [kg m²]", "1e−7", "–", "not recomputable",
            "estimated from a geometry that is not printed; no transient was measured"),
        Row("5.15", "stall torque of the printed constants against the printed readings",
            "a torque–speed line a voltage",
            ", ".join(number(100 * v, "+.0f") for v in stalled) + " %", "at 3 to 5 V",
            "one K_c for all voltages does not pass through five readings"),
        Row("5.10", "speed of the printed constants against the printed readings",
            "“good agreement”", ", ".join(number(100 * v, "+.1f") for v in predicted) + " %",
            "at 3 to 5 V", "f and C₀ come from the tests with load"),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter5/motor.svg",
        PanelPicture(
            "The motor on the bench",
            "dots: printed readings; lines: the printed constants",
            _panels(volts, current, speed, torque),
        ),
    )


def _panels(volts: Array, current: Array, speed: Array, torque: Array) -> tuple[Panel, ...]:
    """5.8, 5.10, 5.11, 5.12, 5.15 and the characteristic of the tables' own constants."""
    own = bench().constants
    fine = np.linspace(volts[0], volts[-1], 41)
    free = PUBLISHED.gear * speed
    across = np.linspace(0.0, 1.1 * free[-1], 41)

    def dots(name: str, x: Array, y: Array) -> Curve:
        return Curve(name, x, y, kind="dots")

    return (
        panel("5.8: current, no load", "V [V]", "i [A]",
              (line("printed constants", fine, steady_state(PUBLISHED, fine)[1]),
               line("from the tables", fine, steady_state(own, fine)[1]),
               dots("readings", volts, current))),
        panel("5.10: speed, no load", "V [V]", "speed [rpm]",
              (line("printed constants", fine, RPM * steady_state(PUBLISHED, fine)[0]),
               line("from the tables", fine, RPM * steady_state(own, fine)[0]),
               dots("readings", volts, RPM * speed))),
        panel("5.11: motor torque", "ω_m [rad/s]", "C_m [mNm]",
              tuple(line(f"{v:g} V", np.array([0.0, w]), 1e3 * np.array([c, PUBLISHED.Kc * i]))
                    for v, c, w, i in zip(volts, torque, free, current, strict=True))),
        panel("5.12: torque less the load", "ω_m [rad/s]", "C_m − C_r τ [mNm]",
              (line("printed f, C₀", across, 1e3 * (PUBLISHED.C0 + PUBLISHED.f * across)),
               line("from the tables", across, 1e3 * (own.C0 + own.f * across)),
               dots("K_c i, no load", free, 1e3 * PUBLISHED.Kc * current))),
        panel("5.15: characteristic", "speed [rpm]", "torque [Nm]",
              tuple(_characteristic(PUBLISHED, v) for v in volts)),
        panel("5.15: from the tables alone", "speed [rpm]", "torque [Nm]",
              tuple(_characteristic(own, v) for v in volts)),
    )  # fmt: skip


def _characteristic(c: MotorConstants, volts: float) -> Curve:
    speed, torque, _ = torque_speed(c, volts)
    return line(f"{volts:g} V", RPM * speed, torque)


def loads() -> Sheet:
    """5.13 and 5.14: the tests with loads as the printed constants have them."""
    volts, *_ = table(Kind.NO_LOAD, "speed")
    panels, rows = [], []
    for k, load in enumerate(LOADS):
        figure = "5.13" if k < len(LOADS) // 2 else "5.14"
        speed = steady_state(PUBLISHED, volts, load)[0] * RPM
        lines = []
        for v in volts[::2]:
            t, w, _ = step_response(PUBLISHED, v, load, 1.0, 51)
            lines.append(line(f"{v:g} V", t, RPM * w))
        panels.append(panel(f"{load} Nm", "time [s]", "speed [rpm]", tuple(lines)))
        rows.append(
            Row(figure, f"steady speed at 3 to 5 V under {load} Nm [rpm]", DRAWN,
                ", ".join(number(s, ".0f") for s in speed), "–",
                "from the printed constants; which load is in which part is not printed")
        )  # fmt: skip
    words = "steps of voltage under the loads of Table 5.1, the printed constants"
    picture = PanelPicture("5.13 and 5.14: tests with loads", words, tuple(panels))
    return Sheet(tuple(rows), "chapter5/loads.svg", picture)


def simulation() -> Sheet:
    """6.3–6.6."""
    volts, current, speed = table(Kind.NO_LOAD, "current", "speed")
    modelled, flow = steady_state(PUBLISHED, volts)
    steady = steady_state(PUBLISHED, volts, STEP_LOAD)[0] * RPM
    errors = RPM * (modelled - speed)
    worst = float(volts[np.argmax(np.abs(errors))])
    rows = (
        compared("6.3", "speed after a step of 3 V [rpm]", 85.3476, float(RPM * modelled[0]), ".1f",
                 "against the reading; the curve is the printed constants'"),
        Row("6.3", "time constant [s]", DRAWN, number(time_constant(PUBLISHED), ".2f"), "–",
            "J/(f + K_c K_em/R) of the printed constants; J was estimated, not measured"),
        Row("6.4", "speed at 3 to 5 V under 0.017 Nm [rpm]", DRAWN,
            ", ".join(number(v, ".0f") for v in steady), "–", "the printed constants'"),
        Row("6.5", "modelled less measured at 3 to 5 V, no load [rpm]",
            "misaligned only at high voltage", ", ".join(number(v, "+.1f") for v in errors),
            f"largest at {worst:g} V", UNDER_LOAD),
        Row("6.6", "current at 3 to 5 V without load [mA]", "170, 180, 190, 200, 210",
            ", ".join(number(1e3 * v, ".0f") for v in flow),
            number(100 * float(np.mean(flow / current - 1.0)), "+.0f") + " % on average",
            "f and C₀ come from the tests with load, whose speeds are not printed"),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter6/motor.svg",
        PanelPicture("The motor model", "the printed constants", _simulated(volts, speed)),
    )


def _simulated(volts: Array, speed: Array) -> tuple[Panel, ...]:
    """6.3, 6.4, 6.5 and both quantities of 6.6."""
    t, free, flow = step_response(PUBLISHED, 3.0, seconds=2.0)
    loads = np.linspace(0.0, LOADS[-1], 21)
    each = {v: steady_state(PUBLISHED, np.full(len(loads), v), loads) for v in volts}
    stepped = tuple(
        line(f"{v:g} V", t, RPM * step_response(PUBLISHED, v, STEP_LOAD, 2.0)[1]) for v in volts
    )
    measured = Curve("measured, no load", np.zeros(len(volts)), RPM * speed, kind="dots")
    return (
        panel("6.3: step of 3 V, no load", "time [s]", "speed [rpm]",
              (line("speed", t, RPM * free),)),
        panel("6.3: its current", "time [s]", "i [A]", (line("current", t, flow),)),
        panel("6.4: steps under 0.017 Nm", "time [s]", "speed [rpm]", stepped),
        panel("6.5: steady speed", "C_r [Nm]", "speed [rpm]",
              (*(line("modelled" if v == volts[-1] else "", loads, RPM * w)
                 for v, (w, _) in each.items()), measured)),
        panel("6.6: steady current", "C_r [Nm]", "i [A]",
              tuple(line(f"{v:g} V", loads, i) for v, (_, i) in each.items())),
        panel("6.6: torque and current", "i [A]", "C_r [Nm]",
              tuple(line(f"{v:g} V", i, loads) for v, (_, i) in each.items())),
    )  # fmt: skip


def characteristic() -> Sheet:
    """2.12."""
    volts = 5.0
    speed, torque, current = torque_speed(PUBLISHED, volts)
    rows = (
        Row("2.12", "torque at standstill [Nm] and speed without load [rpm] at 5 V", DRAWN,
            f"{number(torque[0], '.3f')} and {number(RPM * speed[-1], '.0f')}", "–",
            "drawn without scales; here the printed constants of §5.3"),
    )  # fmt: skip
    panels = (
        panel("2.12: torque", "speed [rpm]", "torque [Nm]", (line("5 V", RPM * speed, torque),)),
        panel("2.12: current", "speed [rpm]", "i [A]", (line("5 V", RPM * speed, current),)),
        panel("2.12: power", "speed [rpm]", "power [W]",
              (line("at the shaft", RPM * speed, torque * speed),
               line("electric", RPM * speed, volts * current))),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter2/motor.svg",
        PanelPicture("Characteristic of a motor", "at the output shaft", panels),
    )
