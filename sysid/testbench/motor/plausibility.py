"""Impossible constants, and experiments that contradict each other."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from sysid.errors import DataError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.testbench.motor.drive import DriveLog
from sysid.testbench.motor.experiments import CONSTANTS, Kind, SteadyTest
from sysid.testbench.motor.joint import JointFit
from sysid.testbench.motor.separate import Route

LEAST_RATIO, MOST_RATIO = 0.1, 2.0
"""Kc over Kem of a real motor. Above 1 it would give more power than it takes, and errors of
instruments reach 2; friction that grows with the load takes some of the torque, not nine tenths.
rpm for rad/s is a factor of 9.5, mA for A one of 1000, motor for output shaft one of the gear."""

APART = 3.0
"""Standard errors of their difference beyond which two experiments contradict each other."""

HARDLY = 0.5
"""Standard error over value from which a constant is weakly identifiable."""


def require_experiments(
    tests: Sequence[SteadyTest], drives: Sequence[DriveLog], known: Mapping[str, object]
) -> None:
    """Refuse experiments that do not determine every constant."""
    if any(d.current is not None for d in drives):
        return
    lacks = []
    stalled = any(t.has("current") for t in tests if t.kind in (Kind.BLOCKED, Kind.STALL))
    turning = any(t.has("current", "speed") for t in tests)
    speeds = [t.of("speed") for t in tests if t.has("current", "speed")]
    speeds = [np.unique(s[np.isfinite(s)]) for s in speeds]
    at_two = any(len(s) > 1 for s in speeds)
    if not stalled and "R" not in known:
        lacks.append(
            "R (a blocked rotor: columns voltage_V, current_A; or the value, `known={'R': 3.1}`)"
        )
    if not turning and "Kem" not in known:
        lacks.append("Kem (no load: columns voltage_V, current_A, speed_rpm)")
    if not at_two and not {"f", "C0"} <= set(known):
        lacks.append("f and C0 (no load at two voltages or more, with current and speed)")
    if lacks:
        raise DataError(
            f"experiments are missing for {'; '.join(lacks)}; a log of voltage steps with the "
            "current (time_s, voltage_V, current_A, speed_rpm) determines all of them"
        )


LEAST_CURRENT = 1e-3
"""Current without load over that of the blocked rotor: 3 to 20 % of small motors, 0.5 % of the best
coreless ones; mA for A is a factor of 1000."""


def require_currents(tests: Sequence[SteadyTest], R: float) -> None:
    """Refuse currents without load that are next to nothing of those of the blocked rotor."""
    for t in tests:
        if t.kind is Kind.NO_LOAD and t.has("current"):
            share = float(np.nanmean(np.abs(t.of("current") * R / t.voltage)))
            if share < LEAST_CURRENT:
                raise DataError(
                    f"{t.name}: the no-load current is {100.0 * share:.2g} % of that of the "
                    "blocked rotor, V/R, less than the friction of any motor; check the units of "
                    "the currents (mA or A)"
                )


def require_plausible(values: Mapping[str, float]) -> None:
    """Refuse constants that no motor has, and name the likely slip."""
    words = {"R": "resistance", "Kem": "back-EMF constant", "Kc": "torque constant"}
    for name, meaning in words.items():
        if name in values and not values[name] > 0.0:
            raise DataError(
                f"{name} comes out as {values[name]:.3g} {CONSTANTS[name][0]}, but a {meaning} is "
                "positive; check the units of the current (mA or A) and R"
            )
    if "Kem" not in values:
        return
    ratio = values.get("Kc", values["Kem"]) / values["Kem"]
    if not LEAST_RATIO <= ratio <= MOST_RATIO:
        why = "give more power than it takes" if ratio > 1.0 else "lose nine tenths of its torque"
        raise DataError(
            f"Kc ({values['Kc']:.3g} Nm/A) is {ratio:.3g} times Kem ({values['Kem']:.3g} "
            f"V/(rad/s)), so the motor would {why}; check the units of speed (rpm or rad/s), "
            "current (mA or A) and torque (Nm or mNm, motor_torque or the output shaft's) and the "
            "gear"
        )


def contradictions(estimates: Sequence[Route]) -> list[str]:
    """Sentences on experiments whose values of a constant exclude each other.

    Several evaluations of one experiment bracket the constant: the stall torque over the whole
    current leaves friction out, over the current less that without load counts viscous friction
    that a motor at rest does not have.
    """
    said, bracketed = [], False
    for name in CONSTANTS:
        by_experiment: dict[str, list[Route]] = {}
        for r in estimates:
            if r.name == name:
                by_experiment.setdefault(r.how.partition(":")[0], []).append(r)
        if name == "Kc" and max(map(len, by_experiment.values()), default=0) > 1:
            bracketed = True
        if name in ("f", "C0") and bracketed:
            continue  # lines under load and without it part by what Kc is wrong by
        for one, other in combinations(by_experiment.values(), 2):
            low, high = sorted((one, other), key=lambda some: min(r.value for r in some))
            a, b = max(low, key=lambda r: r.value), min(high, key=lambda r: r.value)
            apart = (b.value - a.value) / max(np.hypot(a.std_error, b.std_error), 1e-300)
            if apart > APART:
                said.append(
                    f"{name} contradicts itself: {a.words}, but {b.words}, {apart:.1f} standard "
                    "errors apart."
                )
    first = {r.name: (r.value, r.std_error) for r in reversed(estimates)}
    if "Kc" in first and "Kem" in first:
        said += _power(*first["Kc"], *first["Kem"])
    return said


def _power(c: float, ec: float, m: float, em: float) -> list[str]:
    if abs(c - m) <= APART * np.hypot(ec, em):
        return []
    lost = (
        f"{100.0 * (1.0 - c / m):.0f} % of the back-EMF power is lost before the torque sensor "
        "(gear, bearings, a torque measured too low)"
        if c < m
        else "torque or speed was measured too high"
    )
    return [
        f"Kc is {c:.4g} Nm/A but Kem {m:.4g} V/(rad/s), which are equal in a motor without losses: "
        f"{lost}."
    ]


def misfits(joint: JointFit, tests: Sequence[SteadyTest]) -> list[str]:
    """Sentences on quantities that the constants miss in the same way again and again."""
    said = []
    for g in joint.groups:
        test = next((t for t in tests if t.name == g.name), None)
        if test is None or len(g.residuals) < 4 or g.floor:
            continue
        r = np.array(g.residuals)
        v = np.abs(test.voltage[np.isfinite(test.of(g.quantity))])
        if np.ptp(v) == 0.0:
            continue
        x = v - v.mean()
        slope = float(x @ r / (x @ x))
        rest = r - r.mean() - slope * x
        error = float(np.sqrt(rest @ rest / max(len(r) - 2, 1) / (x @ x)))
        if abs(slope) > APART * error:
            way = "less" if slope < 0.0 else "more"
            said.append(
                f"{g.name}: the {g.quantity} rises {way} with the voltage than the constants of "
                f"all experiments say (residuals of {100.0 * g.relative:.1f} % with a trend)."
            )
    return said


def weakly_identified(joint: JointFit) -> list[str]:
    """Sentences on constants whose standard error is not small."""
    errors = np.sqrt(np.diag(joint.covariance))
    advice = {
        "f": "drive at voltages that lie further apart",
        "C0": "also drive at voltages just above the starting voltage",
        "J": "drive more or larger steps",
        "R": "start from standstill, or block the rotor",
        "Kem": "let it reach its final speed",
        "Kc": "measure a torque",
        "L": "sample faster than L/R",
    }
    return [
        f"{n} is weakly identifiable, {v:.2g} ± {NORMAL * e:.2g} {CONSTANTS[n][0]}: {advice[n]}."
        for n, v, e in zip(joint.names, joint.theta.tolist(), errors.tolist(), strict=True)
        if not e < HARDLY * abs(v) and n not in joint.undetermined
    ]
