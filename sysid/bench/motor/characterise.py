"""From files of the motor bench to the motor's constants with what they are worth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.bench.motor.equations import PUBLISHED, MotorConstants
from sysid.bench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest
from sysid.bench.motor.joint import (
    JointFit,
    Part,
    estimated_names,
    fit_jointly,
    known_part,
    steady_part,
)
from sysid.bench.motor.propagation import propagated
from sysid.bench.motor.published import PRINTED, is_the_thesis, printed_against
from sysid.bench.motor.separate import Route, routes, values_of
from sysid.bench.motor.tables import (
    columns_of,
    known_value,
    known_values,
    read_bench_table,
    steady_test,
)
from sysid.data.record import Array
from sysid.errors import DataError, UsageError

METHODS = ("separate", "joint")


@dataclass(frozen=True)
class MotorOptions:
    """How the files of a motor bench are read and evaluated.

    Attributes:
        known: constants known without a file, by name: a value in SI, or value and standard
            error; without one it is that of rounding to the last digit.
        gear: turns of the motor for one of the output shaft; the thesis's 120 unless a file or
            this tells it.
        units: column → unit, where a file does not tell it.
        method: ``separate`` (one experiment at a time, as the thesis) or ``joint``.
    """

    known: Mapping[str, float | tuple[float, float | None]] = field(default_factory=dict)
    gear: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    method: str = "separate"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UsageError(f"`method` is one of {', '.join(METHODS)}, got {self.method!r}")


@dataclass(frozen=True)
class Estimate:
    """A constant of the motor.

    Attributes:
        name, unit: as in ``CONSTANTS``.
        value: in SI; None where nothing tells it.
        std_error: its standard error; None where there is none, which ``reason`` explains.
        published: what the thesis prints, for its own tables.
        recomputable: whether the given files tell the constant; for the thesis's tables whether
            they give the printed number.
        reason: where the value comes from, or why it cannot be told.
    """

    name: str
    unit: str
    value: float | None
    std_error: float | None
    published: float | None
    recomputable: bool
    reason: str

    def to_json(self) -> dict[str, Any]:
        """JSON-able values."""
        return {
            "name": self.name,
            "value": self.value,
            "std_error": self.std_error,
            "unit": self.unit,
            "published": self.published,
            "recomputable": self.recomputable,
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class MotorBench:
    """What the experiments on a motor tell.

    Attributes:
        tests: experiments in steady state.
        gear: turns of the motor for one of the output shaft.
        parameters: constants by the chosen method.
        names, covariance: of those with a standard error, in this order.
        routes: every value from one experiment, with its standard error.
        joint: all experiments at once.
        constants: the motor, for predictions; J is 0 where it is not known.
        notes: what a user should know.
        method: ``separate`` or ``joint``.
    """

    tests: tuple[SteadyTest, ...]
    gear: float
    parameters: tuple[Estimate, ...]
    names: tuple[str, ...]
    covariance: Array
    routes: tuple[tuple[Route, float], ...]
    joint: JointFit
    constants: MotorConstants
    notes: tuple[str, ...]
    method: str

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON-able values."""
        return {
            "method": self.method,
            "gear": self.gear,
            "parameters": [p.to_json() for p in self.parameters],
            "correlations": {"names": self.names, "matrix": self.correlations().tolist()},
            "one_at_a_time": [
                {"name": r.name, "value": r.value, "std_error": e, "how": r.how}
                for r, e in self.routes
            ],
            "joint": self.joint.to_json(),
            "notes": self.notes,
        }

    def correlations(self) -> Array:
        """Correlations of the parameters in ``names``, (n, n)."""
        s = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        size = np.where(s > 0.0, s, 1.0)
        found = self.covariance / np.outer(size, size)
        np.fill_diagonal(found, 1.0)
        return np.asarray(found)


def characterise_motor(files: Sequence[Path], options: MotorOptions | None = None) -> MotorBench:
    """The constants of a motor from its experiments on the bench.

    Args:
        files: tables of experiments and of values, see docs/bench.md.
        options: what is known, and how to evaluate.

    Raises:
        DataError: an experiment is missing, or its numbers cannot be.
        UsageError: an option cannot be.
    """
    given = options or MotorOptions()
    tests, known, notes = _read(files, given)
    gear, said = _gear(known, given)
    notes += said
    constants = {k: v for k, v in known.items() if k != "gear"}
    missing = _missing(tests, constants)
    if missing:
        raise DataError(missing)
    found = routes(tests, constants, gear)
    _plausible(values_of(found), tests)
    tied = "Kc" not in values_of(found)
    if tied:
        notes.append(
            "No torque was measured: Kc is taken for equal to Kem, as it is in a motor without "
            "losses in its field; a stall or external-load experiment tells it."
        )
    joint = _joint(tests, constants, found, gear, tied)
    errors, covariance, names = propagated(tests, constants, gear, joint.sigma, tied)
    notes += _contradictions(found, errors)
    return _evaluated(given, tests, gear, (found, errors), (names, covariance), joint, tied, notes)


def _read(
    files: Sequence[Path], options: MotorOptions
) -> tuple[list[SteadyTest], dict[str, KnownValue], list[str]]:
    tests: list[SteadyTest] = []
    known: dict[str, KnownValue] = {}
    notes: list[str] = []
    for path in files:
        table = read_bench_table(path)
        columns = columns_of(table, options.units)
        if columns and all(c.role in (*CONSTANTS, "gear") for c in columns):
            known |= {v.name: v for v in known_values(table, columns)}
            continue
        test, said = steady_test(table, columns)
        if test is not None:
            tests.append(test)
        if said:
            notes.append(said)
    for name, given in options.known.items():
        value, error = given if isinstance(given, tuple) else (given, None)
        known[name] = known_value(name, value, "`known`", error)
    return tests, known, notes


def _gear(known: Mapping[str, KnownValue], options: MotorOptions) -> tuple[float, list[str]]:
    if options.gear is not None:
        if not options.gear > 0.0:
            raise UsageError(f"`gear` must be a positive number, got {options.gear:g}")
        return options.gear, []
    if "gear" in known:
        return known["gear"].value, []
    return PUBLISHED.gear, [
        f"The gear is taken as {PUBLISHED.gear:g} turns of the motor for one of the output shaft, "
        "the thesis's; `gear=TURNS` says otherwise."
    ]


def _missing(tests: Sequence[SteadyTest], known: Mapping[str, KnownValue]) -> str:
    """Which experiment is missing, as one sentence; empty where none is."""
    lacks = []
    stalled = any(t.has("current") for t in tests if t.kind in (Kind.BLOCKED, Kind.STALL))
    turning = any(t.has("current", "speed") for t in tests)
    if not stalled and "R" not in known:
        lacks.append(
            "R (a blocked rotor: columns voltage_V, current_A; or the value, `known={'R': 3.1}`)"
        )
    if not turning and "Kem" not in known:
        lacks.append("Kem (no load: columns voltage_V, current_A, speed_rpm)")
    if not turning and not {"f", "C0"} <= set(known):
        lacks.append("f and C0 (no load at two voltages or more, with current and speed)")
    return f"experiments are missing for {'; '.join(lacks)}" if lacks else ""


LEAST_RATIO, MOST_RATIO = 0.1, 2.0
"""Kc over Kem of a real motor. Above 1 it would give more power than it takes, and errors of
instruments reach 2; friction that grows with the load takes some of the torque, not nine tenths.
rpm for rad/s is a factor of 9.5, mA for A one of 1000, motor for output shaft one of the gear."""


def _plausible(values: Mapping[str, float], tests: Sequence[SteadyTest]) -> None:
    """Refuse constants that no motor has, and name the likely slip.

    Raises:
        DataError: a constant is not positive, or Kc is not of the size of Kem.
    """
    for name, words in (
        ("R", "resistance"),
        ("Kem", "back-EMF constant"),
        ("Kc", "torque constant"),
    ):
        if name in values and not values[name] > 0.0:
            raise DataError(
                f"{name} comes out as {values[name]:.3g}, but a {words} is positive; check the "
                "units of the current (mA or A) and R"
            )
    ratio = values.get("Kc", values["Kem"]) / values["Kem"]
    if not LEAST_RATIO <= ratio <= MOST_RATIO:
        why = "give more power than it takes" if ratio > 1.0 else "lose nine tenths of its torque"
        raise DataError(
            f"Kc ({values['Kc']:.3g} Nm/A) is {ratio:.3g} times Kem ({values['Kem']:.3g} "
            f"V/(rad/s)), so the motor would {why}; check the units of speed (rpm or rad/s), "
            "current (mA or A) and torque (Nm or mNm, motor_torque or the output shaft's) and the "
            "gear"
        )


def _joint(
    tests: Sequence[SteadyTest],
    known: Mapping[str, KnownValue],
    found: Sequence[Route],
    gear: float,
    tied: bool,
) -> JointFit:
    values = values_of(found)
    start = MotorConstants(
        R=values["R"],
        Kem=values["Kem"],
        Kc=values.get("Kc", values["Kem"]),
        f=max(values.get("f", 0.0), 1e-12),
        C0=max(values.get("C0", 0.0), 1e-12),
        J=values.get("J", 0.0),
        L=values.get("L", 0.0),
        gear=gear,
    )
    parts: list[Part] = [steady_part(t, gear) for t in tests]
    parts += [known_part(v) for v in known.values()]
    return fit_jointly(parts, estimated_names(tests, known), start, tied)


APART = 3.0
"""Standard errors of their difference beyond which two experiments contradict each other."""


def _contradictions(found: Sequence[Route], errors: Sequence[float]) -> list[str]:
    """Sentences on pairs of experiments whose values of a constant exclude each other."""
    said = []
    for name in CONSTANTS:
        own = [(r, e) for r, e in zip(found, errors, strict=True) if r.name == name]
        for k, (a, ea) in enumerate(own):
            for b, eb in own[k + 1 :]:
                apart = abs(a.value - b.value) / max(np.hypot(ea, eb), 1e-300)
                if apart > APART:
                    said.append(
                        f"{name} contradicts itself: {a.value:.4g} ± {ea:.2g} ({a.how}), but "
                        f"{b.value:.4g} ± {eb:.2g} ({b.how}), {apart:.1f} standard errors apart."
                    )
    first = {r.name: (r.value, e) for r, e in reversed(list(zip(found, errors, strict=True)))}
    if "Kc" in first and "Kem" in first:
        (c, ec), (m, em) = first["Kc"], first["Kem"]
        if abs(c - m) > APART * np.hypot(ec, em):
            share = 100.0 * (1.0 - c / m)
            lost = (
                f"{share:.0f} % of the power that the back-EMF takes is lost before the torque was "
                "measured (gear, bearings, a reading of the torque that is low)"
                if c < m
                else "the torque or the speed was read too high"
            )
            said.append(
                f"Kc is {c:.4g} Nm/A but Kem {m:.4g} V/(rad/s), which are equal in a motor without "
                f"losses: {lost}."
            )
    return said


def _evaluated(
    given: MotorOptions,
    tests: Sequence[SteadyTest],
    gear: float,
    single: tuple[tuple[Route, ...], tuple[float, ...]],
    spread: tuple[tuple[str, ...], Array],
    joint: JointFit,
    tied: bool,
    notes: list[str],
) -> MotorBench:
    found, errors = single
    thesis = is_the_thesis(tests)
    if thesis:
        worst = 100.0 * max(abs(e) for e in printed_against(tests))
        notes.append(
            f"The constants that the thesis prints predict its speeds without load within "
            f"{worst:.1f} %."
        )
    of_joint = dict(zip(joint.names, joint.theta.tolist(), strict=True))
    if given.method == "joint":
        names, covariance = joint.names, joint.covariance
        values = of_joint
    else:
        names, covariance = spread
        values = {r.name: r.value for r in reversed(found)}
    if tied:
        values["Kc"] = values["Kem"]
    how = {r.name: r.how for r in reversed(found)}
    std = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    if tied and "Kem" in std:
        std["Kc"] = std["Kem"]
    table = []
    for name, (unit, _) in CONSTANTS.items():
        value, error = values.get(name), std.get(name)
        if error is not None and given.method == "separate" and name in of_joint:
            error = float(np.hypot(error, values[name] - of_joint[name]))
        reason = _reason(name, how, given.method, tied)
        printed = PRINTED.get(name) if thesis else None
        table.append(
            Estimate(
                name,
                unit,
                value,
                error,
                printed.value if printed else None,
                printed.recomputable if printed else value is not None,
                f"{reason}; {printed.reason}" if printed else reason,
            )
        )
    constants = MotorConstants(
        **{k: float(v) for k, v in values.items() if k in CONSTANTS}, gear=gear
    )
    pairs = tuple(zip(found, errors, strict=True))
    return MotorBench(
        tuple(tests), gear, tuple(table), tuple(names), covariance, pairs, joint, constants,
        tuple(notes), given.method,
    )  # fmt: skip


def _reason(name: str, how: Mapping[str, str], method: str, tied: bool) -> str:
    if name == "Kc" and tied:
        return "taken for equal to Kem: no torque was measured"
    if name not in how:
        return {
            "L": "not told: steady states do not see it; a log of voltage steps with its current, "
            "sampled faster than L/R, does",
            "J": "not told: give a value from geometry (`known={'J': 1e-7}`) or a log of a run-up",
        }.get(name, "not told by these files")
    return "all experiments at once" if method == "joint" else how[name]
