"""Tables and drives together: identifiable constants, initial guesses, hold of the input."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.errors import DataError
from sysid.testbench.motor.drive import BLOCKS, DriveLog, behind_steps, drive_part, guessed
from sysid.testbench.motor.equations import MotorConstants
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest
from sysid.testbench.motor.joint import JointFit, fit_jointly, known_part, steady_part

SMEARED = 3.0
"""Errors of the current right behind steps over those elsewhere, from which the steps cannot have
been at the rows: noise alone makes this ratio 1 within a few tenths."""

SEEN = 2.0
"""Standard errors by which an inductance must differ from zero to be identifiable."""


def fit_all(
    tests: Sequence[SteadyTest],
    drives: Sequence[DriveLog],
    known: Mapping[str, KnownValue],
    values: Mapping[str, float],
    gear: float,
    tied: bool,
) -> tuple[JointFit, list[str]]:
    """All experiments at once, and what there is to say about the drives.

    A voltage that is logged beside current and speed may stand for the interval behind its row (a
    command) or before it (a measurement): whichever predicts better is taken.

    Args:
        gear: turns of the motor for one of the output shaft.
        tied: whether Kc is Kem.
    """
    steady = [steady_part(t, gear) for t in tests] + [known_part(v) for v in known.values()]
    starts = _starts(drives, values, gear)
    names = _names(tests, drives, known)
    if not drives:
        return fit_jointly(steady, names, starts, tied), []
    fits = []
    for share in (0.0, 1.0):
        parts = [*steady, *(drive_part(d, starts[0], share) for d in drives)]
        fits.append((fit_jointly(parts, names, starts, tied), parts))
    best = min((0, 1), key=lambda k: _cost(fits[k][0]))
    best_fit, parts = fits[best]
    smeared = _smeared(best_fit, drives)
    if smeared:
        parts = [*steady, *(drive_part(d, starts[0], 0.5, smeared=True) for d in drives)]
        best_fit = fit_jointly(parts, names, starts, tied)
        said = [
            "Voltage steps fall between rows, so the current right after a step is left out. "
            "Errors of some per cent may remain; log faster, or step the voltage at the rows."
        ]
    else:
        behind = "before it, as measured with the rest" if best else "behind it, as commanded"
        said = [f"The voltage of a row is taken as that of the interval {behind}."]
    if "L" in names and "L" not in known:
        dt = max(d.dt for d in drives)
        logged = any(d.current is not None for d in drives)
        if logged and _inductance_identifiable(best_fit, dt if smeared else 0.0):
            return best_fit, said
        # it stays among the estimates, whose errors take in that it is not known
        best_fit = replace(best_fit, undetermined=(*best_fit.undetermined, "L"))
        why = f"the current follows the voltage within a sample of {dt:g} s; sample faster than L/R"
        said.append(f"L is not identifiable; {why if logged else 'log the current'}.")
    return best_fit, said


def _names(
    tests: Sequence[SteadyTest], drives: Sequence[DriveLog], known: Mapping[str, KnownValue]
) -> tuple[str, ...]:
    """Constants that the experiments and known values determine, in the order of ``CONSTANTS``."""
    torque = any(t.has("torque") for t in tests if t.kind in (Kind.STALL, Kind.EXTERNAL))
    determined = {"R", "Kem", "f", "C0", *known}
    determined |= {"Kc"} if torque else set()
    determined |= {"J", "L"} if drives else set()  # a lag of the current shows in the speed, too
    return tuple(n for n in CONSTANTS if n in determined)


def _starts(
    drives: Sequence[DriveLog], values: Mapping[str, float], gear: float
) -> tuple[MotorConstants, ...]:
    """Where the search may begin: values of the tables, and what they lack read off the drives."""
    whole = {"R", "Kem", "f", "C0"} <= set(values)
    tables = None
    if whole:
        tables = MotorConstants(
            R=values["R"],
            Kem=values["Kem"],
            Kc=values.get("Kc", values["Kem"]),
            f=max(values["f"], 1e-12),
            C0=max(values["C0"], 1e-12),
            J=values.get("J", 0.0),
            L=values.get("L", 0.0),
            gear=gear,
        )
    if not drives:
        assert tables is not None  # experiments are complete
        return (tables,)
    used = [d for d in drives if d.current is not None] or drives
    read = [guessed(used, gear, tables, b) for b in BLOCKS if b * MIN_BLOCKS < len(used[0].t)]
    read = [g for g in read if g.R > 0.0 and g.Kem > 0.0 and np.isfinite(g.J)]
    if not read:
        raise DataError(
            f"{drives[0].name}: voltage, current and speed do not fit a motor; check their signs "
            "and units"
        )
    if tables is None:
        given = {n: v for n, v in values.items() if n in CONSTANTS}
        guesses = [replace(g, **given) for g in read]
    else:
        guesses = [replace(tables, J=values.get("J", g.J), L=values.get("L", g.L)) for g in read]
    around = (1.0, 0.3, 3.0)  # what slopes over blocks are wrong by
    return tuple(replace(g, J=a * g.J, L=b * g.L) for g in guesses for a in around for b in around)


MIN_BLOCKS = 10
"""Blocks from which constants are read off."""


def _cost(fit: JointFit) -> float:
    """−2 log-likelihood of Gaussian residuals with a level of each group, but for a constant."""
    return float(sum(len(g.residuals) * np.log(g.noise) for g in fit.groups if g.kind == "drive"))


def _inductance_identifiable(fit: JointFit, least: float) -> bool:
    """Whether L differs from zero, and L/R from its smallest identifiable value [s]."""
    k = fit.names.index("L")
    error = float(np.sqrt(fit.covariance[k, k]))
    long = least * fit.constants.R < fit.constants.L
    return "L" not in fit.at_bound and long and fit.theta[k] > SEEN * error


def _smeared(fit: JointFit, drives: Sequence[DriveLog]) -> bool:
    """Whether currents right behind steps of the voltage are missed by far more than others."""
    large: list[float] = []
    small: list[float] = []
    for log in drives:
        group = next((g for g in fit.groups if (g.name, g.quantity) == (log.name, "current")), None)
        if group is not None:
            r, steps = np.square(group.residuals), behind_steps(log.voltage)
            large += r[steps].tolist()
            small += r[~steps].tolist()
    return bool(large and small) and SMEARED**2 * float(np.mean(small)) < float(np.mean(large))
