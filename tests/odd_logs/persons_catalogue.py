"""The persons' logs, with what the workbench has to say about each and what the fit has to find."""

from pathlib import Path

import numpy as np
from odd_log import OddLog
from persons import (
    CONTAINERS,
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

IN_CONTAINERS = {("volt", "rpm"): 140.0}

PERSONS: tuple[OddLog, ...] = (
    OddLog("propeller stand", propeller, slow=True),
    OddLog("servo on a bench", servo, slow=True),
    OddLog("oven overnight", night, gains={("Stellgrad", "Ofentemperatur"): 0.93}, slow=True),
    OddLog("serial monitor", hobby, slow=True),
    OddLog("vehicle bus", bus, slow=True),
    OddLog("model car", model_car, slow=True),
    OddLog("two tanks", two_tanks, slow=True),
    OddLog("closed loop only", regulated, slow=True),
    OddLog("Simulink export", simulink, gains={("signals_1", "signals_2"): 1.7}),
    OddLog("Monday and Tuesday", two_days, "tuesday.csv", gains={("u_V", "w_radps"): 31.0}),
    OddLog("ten minutes at 1 kHz", long_lab, slow=True),
    OddLog("student's step", student, gains={("u", "y"): 4.2}),
    OddLog("tracks miswired", miswired, slow=True),
    OddLog("dynamometer", dynamometer, slow=True),
    OddLog("building automation", building, slow=True),
    OddLog("spreadsheet", spreadsheet, gains={("Drehzahl", "Druck"): 0.88}),
    OddLog("converter trace", plc, slow=True),
    OddLog("fan", fan, slow=True),
    *(OddLog(f"as {c}", contained(c), gains=IN_CONTAINERS) for c in CONTAINERS),
)


def write_all(folder: Path, seed: int) -> dict[str, Path]:
    """Every person's log in a folder of its own: name → the file to name on the command line."""
    written = {}
    for person in PERSONS:
        own = folder / person.name.replace(" ", "-").replace("'", "")
        own.mkdir(parents=True, exist_ok=True)
        written[person.name] = person.make(np.random.default_rng([seed, len(person.name)]), own)
    return written
