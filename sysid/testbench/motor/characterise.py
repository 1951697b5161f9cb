"""From files of the motor bench to the motor's constants with their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.documents import plain_object
from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.testbench.motor.drive import DriveLog
from sysid.testbench.motor.drive_fit import fit_all
from sysid.testbench.motor.equations import PUBLISHED, MotorConstants
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest
from sysid.testbench.motor.files import Given, read_bench_files
from sysid.testbench.motor.joint import JointFit, correlations
from sysid.testbench.motor.plausibility import (
    LEAST_RATIO,
    MOST_RATIO,
    contradictions,
    misfits,
    require_currents,
    require_experiments,
    require_plausible,
    weakly_identified,
)
from sysid.testbench.motor.separate import Route, propagated, routes, values_of

METHODS = ("auto", "separate", "joint")


@dataclass(frozen=True)
class MotorOptions:
    """How the files of a motor bench are read and evaluated.

    Attributes:
        known: constants known without a file, by name: a value in SI, or value and standard
            error; without one it is that of rounding to the last digit.
        gear: turns of the motor for one of the output shaft; the thesis's 120 unless a file or
            this tells it.
        units: column → unit, where a file lacks it.
        pulses_per_turn: of the sensor at the output shaft behind a column of event times.
        method: ``separate`` (one experiment at a time, as the thesis), ``joint``, or ``auto``:
            joint where there is the log of a drive.
    """

    known: Given = field(default_factory=dict)
    gear: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    pulses_per_turn: float = 1.0
    method: str = "auto"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UsageError(f"`method` is one of {', '.join(METHODS)}, got {self.method!r}")
        for name in ("gear", "pulses_per_turn"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise UsageError(f"`{name}` must be a positive number, got {value:g}")


@dataclass(frozen=True)
class Estimate:
    """A constant of the motor.

    Attributes:
        name, unit: as in ``CONSTANTS``.
        value: in SI; None if not identifiable.
        std_error: its standard error; None where there is none, which ``reason`` explains.
        reason: where the value comes from, or why there is none.
    """

    name: str
    unit: str
    value: float | None
    std_error: float | None
    reason: str


@dataclass(frozen=True, eq=False)
class MotorBench:
    """Results of the experiments on a motor.

    Attributes:
        gear: turns of the motor for one of the output shaft.
        routes: every value from one experiment.
        one_at_a_time: names and covariance of the first value of each constant from one experiment.
        joint: all experiments at once.
        tied: whether Kc is Kem, because no torque was measured.
        method: ``separate`` or ``joint``.
    """

    tests: tuple[SteadyTest, ...]
    drives: tuple[DriveLog, ...]
    gear: float
    routes: tuple[Route, ...]
    one_at_a_time: tuple[tuple[str, ...], Array]
    joint: JointFit
    tied: bool
    method: str
    notes: tuple[str, ...]

    @property
    def largest_voltage(self) -> float:
        """The largest voltage that was applied, of either sign [V]."""
        applied = [t.voltage for t in self.tests] + [d.voltage for d in self.drives]
        return max(float(np.max(np.abs(v))) for v in applied)

    @cached_property
    def parameters(self) -> tuple[Estimate, ...]:
        """Constants by the chosen method."""
        return tuple(map(self._row, CONSTANTS))

    @property
    def names(self) -> tuple[str, ...]:
        """Of those with a standard error."""
        return self._spread[0]

    @property
    def covariance(self) -> Array:
        """Of those in ``names``, in this order."""
        return self._spread[1]

    @property
    def constants(self) -> MotorConstants:
        """The motor, for predictions; J is 0 where it is not known."""
        return replace(self.joint.constants, **self._values)

    def to_json(self) -> dict[str, Any]:
        return plain_object(
            {
                "method": self.method,
                "gear": self.gear,
                "parameters": self.parameters,
                "correlations": {"names": self.names, "matrix": correlations(self.covariance)},
                "one_at_a_time": self.routes,
                "joint": self.joint,
                "notes": self.notes,
            }
        )

    @cached_property
    def _of_joint(self) -> dict[str, float]:
        return dict(zip(self.joint.names, self.joint.theta.tolist(), strict=True))

    @cached_property
    def _of_routes(self) -> dict[str, float]:
        return values_of(self.routes)

    @cached_property
    def _values(self) -> dict[str, float]:
        """By the method, completed by the other one, as far as they are determined."""
        values = dict(self._of_joint)
        if self.method == "separate":
            values |= self._of_routes
        if self.tied:
            values["Kc"] = values["Kem"]
        return {n: v for n, v in values.items() if n not in self.joint.undetermined}

    @cached_property
    def _spread(self) -> tuple[tuple[str, ...], Array]:
        """Names and covariance by the method."""
        both = self.joint.names, self.joint.covariance
        names, covariance = both if self.method == "joint" else self.one_at_a_time
        kept = [k for k, n in enumerate(names) if n not in self.joint.undetermined]
        return tuple(names[k] for k in kept), covariance[np.ix_(kept, kept)]

    def _row(self, name: str) -> Estimate:
        value, error = self._values.get(name), self._std_error(name)
        if error is not None and not np.isfinite(error):
            error = None
        return Estimate(name, CONSTANTS[name][0], value, error, self._reason(name, value))

    def _std_error(self, name: str) -> float | None:
        source = "Kem" if name == "Kc" and self.tied else name
        if source in self.names:
            k = self.names.index(source)
            error = float(np.sqrt(self.covariance[k, k]))
            if self.method == "separate" and source in self._of_joint:
                # what the way of evaluation changes is an error as well
                error = float(np.hypot(error, self._of_routes[source] - self._of_joint[source]))
            return error
        if name in self._values and source in self._of_joint:
            k = self.joint.names.index(source)
            return float(np.sqrt(self.joint.covariance[k, k]))
        return None

    def _reason(self, name: str, value: float | None) -> str:
        if name == "Kc" and self.tied:
            return "set equal to Kem, because no torque was measured"
        if value is None:
            return WHY_UNDETERMINED.get(name, "not identifiable from these files")
        how = {r.name: r.how for r in reversed(self.routes)}
        if self.method == "separate" and name in how:
            return how[name]
        return "all experiments at once" if how or len(self.drives) > 1 else "the drive"


def characterise_motor(files: Sequence[Path], options: MotorOptions | None = None) -> MotorBench:
    """The constants of a motor from its experiments on the bench.

    Args:
        files: tables of experiments and of values, event times, logs of drives; see docs/bench.md.

    Raises:
        DataError: an experiment is missing, or its numbers cannot be.
    """
    given = options or MotorOptions()
    read = read_bench_files(files, given.units, given.pulses_per_turn, given.known)
    gear, notes = _gear(read.known, given)
    known = {k: v for k, v in read.known.items() if k != "gear"}
    require_experiments(read.tests, read.drives, known)
    tests, said = _sided(read.tests, known, gear)
    values = values_of(routes(tests, known, gear))
    require_plausible(values)
    if "R" in values:
        require_currents(tests, values["R"])
    tied = "Kc" not in values
    if tied:
        said.append(
            "No torque was measured, so Kc is set equal to Kem, as in a motor without losses. "
            "Voltage, current and speed determine f, C0 and J only relative to Kc; a stall or "
            "external-load experiment determines Kc."
        )
    joint, remarks = fit_all(tests, read.drives, known, values, gear, tied)
    require_plausible(vars(joint.constants))
    found, names, covariance = propagated(tests, known, gear, joint.sigma)
    notes = [*read.notes, *notes, *said, *remarks, *contradictions(found)]
    notes += [*misfits(joint, tests), *weakly_identified(joint)]
    method = given.method
    if method == "auto":
        method = "joint" if read.drives else "separate"
    return MotorBench(
        tests, read.drives, gear, found, (names, covariance), joint, tied, method, tuple(notes)
    )


def _gear(known: Mapping[str, KnownValue], options: MotorOptions) -> tuple[float, list[str]]:
    if options.gear is not None:
        return options.gear, []
    if "gear" in known:
        return known["gear"].value, []
    return PUBLISHED.gear, [
        f"The gear is taken as {PUBLISHED.gear:g} motor turns per output turn (the thesis's "
        "value); change it with `gear=TURNS`."
    ]


def _sided(
    tests: Sequence[SteadyTest], known: Mapping[str, KnownValue], gear: float
) -> tuple[tuple[SteadyTest, ...], list[str]]:
    """Stall torques that can only be those of the motor's shaft, taken as such, with a sentence.

    Read as torques of the output shaft they would make Kc the gear times too small for Kem.
    """
    unsaid = [t for t in tests if t.kind is Kind.STALL and not t.motor_side]
    if not unsaid or gear <= MOST_RATIO / LEAST_RATIO:
        return tuple(tests), []
    values = values_of(routes(tests, known, gear))
    ratio = values.get("Kc", np.nan) / values.get("Kem", np.nan)
    if not (ratio < LEAST_RATIO and LEAST_RATIO <= ratio * gear <= MOST_RATIO):
        return tuple(tests), []
    names = ", ".join(t.name for t in unsaid)
    sided = tuple(replace(t, motor_side=True) if t in unsaid else t for t in tests)
    return sided, [
        f"{names}: the torque is taken at the motor's shaft; at the output shaft it would be "
        f"{gear:g} times too small for Kem. Call the column motor_torque_Nm."
    ]


WHY_UNDETERMINED = {
    "L": "not identifiable from steady states; log voltage steps with their current, sampled "
    "faster than L/R",
    "J": "not identifiable; give a value from geometry (`known={'J': 1e-7}`) or a log of a run-up",
}
"""Why a constant has no value."""
