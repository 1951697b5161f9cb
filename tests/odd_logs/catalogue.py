"""Logs as strangers write them: odd headers, clocks, units, counters and machines, with the truth.

Each entry writes its files from a seed and knows what a person would type first, what the workbench
has to say about the log, and what the fit has to find. Gains are in the units of the file.
"""

from dataclasses import replace

import numpy as np
from log_files import (
    alone,
    clocked,
    coarse,
    counted,
    dated,
    deadened,
    delayed,
    german,
    held,
    in_a_loop,
    joined,
    noise,
    oven,
    plain,
    posed,
    position,
    second_order_from_rest,
    shifted,
    sided,
    step_test,
    switched,
    two_valued,
    untimed,
    wild,
    with_a_gap,
    with_jitter,
    with_missing_lines,
)
from odd_log import OddLog
from persons_catalogue import PERSONS

MOTOR = {("u", "y"): 150.0}
RPM = ("volt", "rpm")

FILES: tuple[OddLog, ...] = (
    # clocks
    OddLog("millis", clocked("millis", 1e-3, 5.0), gains=MOTOR),
    OddLog(
        "micros that start over",
        clocked("micros", 1e-6, 4290.0, 2**32),
        gains=MOTOR,
        says="start.* over",
    ),
    OddLog(
        "millis in 16 bits", clocked("millis", 1e-3, 62.0, 2**16), gains=MOTOR, says="start.* over"
    ),
    OddLog("time [ms]", clocked("time [ms]", 1e-3), gains=MOTOR),
    OddLog("time without a unit", clocked("time", 1e-3, 12.0), gains=MOTOR, says="--unit '?time="),
    OddLog("nameless rising column", clocked("Timer", 1e-3, 12.0), gains=MOTOR),
    OddLog("epoch in milliseconds", clocked("timestamp", 1e-3, 1.78e9), gains=MOTOR),
    OddLog("dates across midnight", dated, gains={("voltage", "speed_rpm"): 150.0}),
    OddLog(
        "unit of the time by option",
        clocked("clock", 1e-3),
        "--time clock --unit clock=ms",
        gains=MOTOR,
    ),
    OddLog(
        "42 missing lines", with_missing_lines, gains=MOTOR, says="42", never="No sample is missing"
    ),
    OddLog("jitter", with_jitter, gains=MOTOR),
    OddLog("a gap", with_a_gap, gains={RPM: 150.0}, says="cut into 2 experiments"),
    OddLog("a gap to be refused", with_a_gap, "--resample refuse", code=1, inspected=1),
    OddLog("no time", untimed, "--ts 0.02", gains=MOTOR),
    OddLog("no time and nobody says", untimed, says="--ts", gains=MOTOR),
    OddLog(
        "time asked for as the output",
        clocked("millis", 1e-3),
        "--input u --output millis",
        code=2,
        inspected=2,
        fit_says="millis",
    ),
    # layouts
    OddLog("German spreadsheet", german, gains={("Spannung", "Drehzahl"): 150.0}),
    OddLog(
        "title above the header", plain("u", "y", before="Run 7 of the bench,May 2026"), gains=MOTOR
    ),
    OddLog("row of units", plain("u", "y", after="s,V,rpm"), gains=MOTOR),
    OddLog("comment lines", plain("u", "y", before="# bench 3"), gains=MOTOR),
    OddLog("trailing delimiter", plain("u", "y", tail=","), gains=MOTOR),
    OddLog("tabs", plain("u", "y", sep="\t"), gains=MOTOR),
    OddLog("ON and OFF", switched, gains={("heater", "temperature_degC"): 60.0}, says="heater"),
    # names and units
    OddLog("U/min", plain("volt", "n [U/min]"), gains={("volt", "n"): 150.0}),
    OddLog("degrees a second", plain("u_V", "speed [°/s]", 6.0), gains={("u_V", "speed"): 900.0}),
    OddLog("millivolts", plain("u_mV", "y_rpm", u_scale=1000.0), gains={("u_mV", "y_rpm"): 0.15}),
    OddLog("throttle and rpm", plain("throttle", "rpm"), gains={("throttle", "rpm"): 150.0}),
    OddLog("sign reversed", plain("u", "y", -1.0), gains={("u", "y"): -150.0}),
    OddLog(
        "columns nobody can tell",
        plain("alpha", "beta"),
        code=1,
        inspected=1,
        fit_says="--input .* --output",
    ),
    OddLog(
        "pwmL and rpmL",
        sided(("pwmL", "pwmR", "rpmL", "rpmR"), 60 / (2 * np.pi)),
        "--pwm-max 255",
        "--structure oe --orders 'nb=1 nf=1 nk=1'",
        gains={
            ("pwmL", "rpmL"): 10 * 60 / (2 * np.pi) / 255,
            ("pwmR", "rpmR"): 9 * 60 / (2 * np.pi) / 255,
        },
    ),
    OddLog(
        "left_pwm and rpm_left",
        sided(("left_pwm", "right_pwm", "rpm_left", "rpm_right"), 60 / (2 * np.pi)),
        "--pwm-max 255",
        "--structure oe --orders 'nb=1 nf=1 nk=1'",
        gains={("left_pwm", "rpm_left"): 10 * 60 / (2 * np.pi) / 255},
    ),
    OddLog(
        "pose in millimetres and degrees",
        posed,
        fit_options="--structure arx --orders 'na=1 nb=1 nk=1'",
        gains={("pwm_l", "omega_l"): 10.0 / 20000.0},
        says="deg",
    ),
)
"""What is odd about the file alone."""

CATALOGUE: tuple[OddLog, ...] = (
    *(replace(log, read_only=True) for log in FILES),
    # counters and slow sensors
    OddLog(
        "16-bit counter",
        counted(16, False),
        "--input u --output encoder --unit encoder=counts=2048/rev --speed-of encoder",
        says="65536",
        gains={("u", "encoder_speed"): 8.0 * 2048 / (2 * np.pi)},
    ),
    OddLog(
        "signed 16-bit counter",
        counted(16, True),
        "--input u --output encoder --unit encoder=counts=2048/rev --speed-of encoder",
        says="65536",
        gains={("u", "encoder_speed"): 8.0 * 2048 / (2 * np.pi)},
    ),
    OddLog("position", position, gains={("u", "y"): 0.5}),
    OddLog("held telemetry", held, says="every 4", never="is stuck at", gains={("u", "y"): 5.0}),
    OddLog("coarse readings", coarse, gains=MOTOR, never="slower than the log"),
    OddLog(
        "wild readings",
        wild,
        fit_options="--robust --structure oe --orders 'nb=1 nf=1 nk=1'",
        gains=MOTOR,
    ),
    OddLog(
        "pose in a second file",
        joined,
        "--join mocap.csv",
        "--structure arx --orders 'na=1 nb=1 nk=1'",
        says="3[.]7",
        gains={("pwm_l", "omega_l"): 10.0 / 20000.0},
    ),
    # offsets
    OddLog("oven from rest", oven(0), gains={("u", "y"): 8.0}, never="model integrates"),
    OddLog("oven from the middle", oven(200), gains={("u", "y"): 8.0}, never="model integrates"),
    OddLog("one step from rest", step_test, gains={("u", "y"): 12.0}, never="model integrates"),
    OddLog("10 s from rest", second_order_from_rest, gains={RPM: 150.0}),
    OddLog("offset sensor", shifted, gains={RPM: 150.0}),
    # delays, loops, nothing
    OddLog("delay of 21", delayed(21), gains=MOTOR, says="21 from u", never="closed loop"),
    OddLog("delay of 41", delayed(41), gains=MOTOR, says="41 from u", never="closed loop"),
    OddLog("delay of 61", delayed(61), gains=MOTOR, says="61 from u", never="closed loop"),
    OddLog("PI loop", in_a_loop(False), gains={("u", "y"): 3.0}, says="closed loop"),
    OddLog(
        "PI loop with its reference", in_a_loop(True), gains={("u", "y"): 3.0}, says="closed loop"
    ),
    OddLog("noise", noise, says="no more of y than chance", fit_says="no more of y than chance"),
    OddLog("a signal on its own", alone, fit_says="arma?"),
    # nonlinear
    OddLog("two levels", two_valued, gains={("u", "y"): 20.0}, says="levels"),
    OddLog(
        "dead zone and offset",
        deadened,
        fit_options="--structure hammerstein-wiener --orders 'nb=1 nf=1 nk=1'",
        slow=True,
    ),
    OddLog(
        "dead zone diagnosed",
        deadened,
        diagnosis=("dead-zone", "stiction"),
        fit_options="--structure arx",
        slow=True,
    ),
    *PERSONS,
)
