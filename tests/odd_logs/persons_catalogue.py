"""The persons' logs, with what the workbench has to say about each and what the fit has to find."""

from pathlib import Path

import numpy as np
from odd_log import OddLog
from persons import (
    CONTAINERS,
    RPM,
    building,
    bus,
    contained,
    dynamometer,
    fan,
    hobby,
    long_lab,
    miswired,
    model_car,
    night,
    plc,
    propeller,
    regulated,
    servo,
    simulink,
    spreadsheet,
    student,
    two_days,
    two_tanks,
)

MOTOR = {("volt", "rpm"): 140.0}
UNREAD = ("headerless", "dat", "jsonl", "long", "mat")
GAINS: dict[str, dict[tuple[str, str], float]] = {
    "rostopic": {("field.volt", "field.rpm"): 140.0},
    "headerless": {},
    "dat": {},
}
"""Of containers that name the columns in their own way, or not at all."""

PERSONS: tuple[OddLog, ...] = (
    OddLog(
        "propeller stand",
        propeller,
        '--input "ESC signal" --output "Motor Optical Speed"',
        never="is stuck at",
        slow=True,
    ),
    OddLog(
        "servo on a bench",
        servo,
        "--input target_deg --output actual_deg",
        gains={("target_deg", "actual_deg"): 1.0},
        slow=True,
    ),
    OddLog(
        "oven overnight",
        night,
        "--input Stellgrad --output Ofentemperatur",
        says="4 s",
        slow=True,
    ),
    OddLog("serial monitor", hobby, slow=True),
    OddLog("vehicle bus", bus, slow=True),
    OddLog("model car", model_car, slow=True),
    OddLog("two tanks", two_tanks, "--input inflow --output h1,h2", says="[Nn]onlinear", slow=True),
    OddLog(
        "closed loop only",
        regulated,
        "--input pid_output --output speed",
        says="closed loop",
        gains={("pid_output", "speed"): 0.48},
        slow=True,
    ),
    OddLog(
        "Simulink export",
        simulink,
        "--input signals_1 --output signals_2",
        fit_says="damping 0[.](19|20)",
        gains={("signals_1", "signals_2"): 1.7},
    ),
    OddLog(
        "Monday and Tuesday", two_days, "tuesday.csv", gains={("u_V", "w_radps"): 31.0}, slow=True
    ),
    OddLog("ten minutes at 1 kHz", long_lab, diagnosis=("coulomb-friction", "limit"), slow=True),
    OddLog("student's step", student, gains={("u", "y"): 4.2}),
    OddLog(
        "tracks miswired",
        miswired,
        says="left ω follows the right PWM(.|\n)*omega_l runs against pwm_r",
        gains={
            ("pwm_r", "omega_l"): -RPM * 9.0 / 20000.0,
            ("pwm_l", "omega_r"): RPM * 10.0 / 20000.0,
        },
    ),
    OddLog(
        "tracks put right",
        miswired,
        "--input pwm_r,pwm_l --unit omega_l=-rpm --unit omega_r=rpm",
        says="agree with the robot in sign, side and size",
        gains={("pwm_r", "omega_l"): RPM * 9.0 / 20000.0},
        slow=True,
    ),
    OddLog("dynamometer", dynamometer, slow=True),
    OddLog(
        "building automation",
        building,
        "--input AHU1_Valve_pct,T_outdoor_degC --output T_supply_degC",
        gains={("AHU1_Valve_pct", "T_supply_degC"): 0.34, ("T_outdoor_degC", "T_supply_degC"): 0.6},
        slow=True,
    ),
    OddLog(
        "spreadsheet",
        spreadsheet,
        "--input Drehzahl --output Druck",
        gains={("Drehzahl", "Druck"): 0.88},
        slow=True,
    ),
    OddLog(
        "converter trace",
        plc,
        "--input DB12_Trace.Sollfrequenz_Hz --output DB12_Trace.Istdrehzahl",
        says="start.* over",
        slow=True,
    ),
    OddLog("fan", fan, "--ts 0.25", slow=True),
    *(
        OddLog(
            f"as {c}",
            contained(c),
            gains=GAINS.get(c, MOTOR),
            slow=c in UNREAD,
            read_only=True,
        )
        for c in CONTAINERS
    ),
)


def write_all(folder: Path, seed: int) -> dict[str, Path]:
    """Every person's log in a folder of its own: name → the file to name on the command line."""
    written = {}
    for person in PERSONS:
        own = folder / person.name.replace(" ", "-").replace("'", "")
        own.mkdir(parents=True, exist_ok=True)
        written[person.name] = person.make(np.random.default_rng([seed, len(person.name)]), own)
    return written
