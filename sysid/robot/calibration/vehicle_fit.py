"""A vehicle's parameters from logs with its pose, and its prediction errors on held-out paths.

``MOTIONS`` says which models of motion can be fitted; each makes a ``MotionFit`` of windows, and
everything that is judged here (held-out errors, halves that judge each other, drift) is judged of
its predictions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.documents import plain_object
from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.robot.calibration.dynamic_estimate import DynamicFit
from sysid.robot.calibration.dynamic_fit import fit_dynamics
from sysid.robot.calibration.dynamic_motion import fit_weighed
from sysid.robot.calibration.dynamic_motors import KnownMotors
from sysid.robot.calibration.geometry import GeometryEstimate, lengths_of
from sysid.robot.calibration.judged import (
    Drift,
    PathErrors,
    check_enough,
    drift,
    enough,
    long_stretches,
    mean_way,
    split,
    whole,
)
from sysid.robot.calibration.numbers import Correlations, VehicleNumber
from sysid.robot.calibration.slip_curves import SlipCurves, slip_curves
from sysid.robot.calibration.slip_estimate import SlipFit, in_units
from sysid.robot.calibration.slip_fit import fit_slip
from sysid.robot.calibration.slip_model import Kinematic
from sysid.robot.calibration.square_runs import SquareResult, square_result
from sysid.robot.calibration.square_search import square_runs
from sysid.robot.calibration.trajectory import Part, Trajectories, trajectories_of
from sysid.vehicle.kinematics import Geometry

MotionFit = SlipFit | DynamicFit
"""A fitted model of motion."""

MOTIONS = ("slip", "dynamic")
"""Models of motion that can be fitted, by the names that a mission knows them under."""

WORSE = 1.1
"""Errors larger than those of wheels that roll by more than chance does to thirty windows."""

_PREDICTED_WORSE = (
    "The forces predict held-out paths worse than rolling wheels (plain). Something else moves "
    "the vehicle, such as a wheel-speed controller; do not use its stiffness and turning "
    "resistance."
)

STILL_OFF = 0.1
"""Share of the way by which a position may be off after two seconds before it is said: sound logs
leave 1 to 5 %."""


@dataclass(frozen=True)
class Fold:
    """Numbers from one half of the paths, judged on the other.

    Attributes:
        numbers: name → value of what was fitted on the other.
    """

    before: PathErrors
    after: PathErrors
    numbers: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class VehicleFit:
    """A vehicle fitted to logs, and what it is worth on held-out windows.

    Attributes:
        estimation, holdout: windows that it was fitted on, and judged on; they overlap fourfold.
        known: lengths that ``before`` stands for.
        given: lengths that a person gave; None for none.
        lengths: one radius and one width from a straight line through the windows.
    """

    motion: str
    trajectories: Trajectories
    estimation: tuple[Part, ...]
    holdout: tuple[Part, ...]
    known: Geometry
    given: Geometry | None
    lengths: GeometryEstimate
    model: MotionFit

    @cached_property
    def numbers(self) -> tuple[VehicleNumber, ...]:
        """Every quantity, identifiable or not."""
        return self.model.numbers(self.given)

    def number(self, name: str) -> VehicleNumber:
        return next(n for n in self.numbers if n.name == name)

    @cached_property
    def correlations(self) -> Correlations:
        """Of those in the model."""
        return self.model.correlations()

    @cached_property
    def before(self) -> PathErrors:
        """Errors on held-out windows with the lengths that were known."""
        return PathErrors.of(Kinematic(self.known).errors(self.holdout))

    @cached_property
    def plain(self) -> PathErrors:
        """Those with ``lengths``."""
        return PathErrors.of(Kinematic(self.lengths.geometry).errors(self.holdout))

    @cached_property
    def after(self) -> PathErrors:
        """Those with the model."""
        return PathErrors.of(self.model.errors(self.holdout))

    @cached_property
    def drift(self) -> tuple[Drift, Drift]:
        """How errors grow with the way, before and after."""
        long, models = long_stretches(self.holdout), (Kinematic(self.known), self.model)
        first, last = (drift(m.errors, self.model, long) for m in models)
        return first, last

    @cached_property
    def folds(self) -> tuple[Fold, ...]:
        """Both halves of every trajectory, each fitted with the same terms and judged by the other;
        empty where they are too short."""
        halves, folds = split(self.trajectories.each, 0.5), []
        if not all(enough(h) for h in halves):
            return ()
        for fitted, judge in (halves, halves[::-1]):
            if isinstance(self.model, DynamicFit):
                model: MotionFit = fit_dynamics(fitted, self.model.geometry, self.model.powered)
            else:
                model = fit_slip(fitted, self.model.geometry, self.model.terms)
            before = PathErrors.of(Kinematic(self.known).errors(judge))
            values = {n.name: n.value for n in model.numbers(self.given) if n.in_model}
            folds.append(Fold(before, PathErrors.of(model.errors(judge)), values))
        return tuple(folds)

    @property
    def _slipping(self) -> SlipFit:
        """The model without masses."""
        return self.model.before if isinstance(self.model, DynamicFit) else self.model

    @cached_property
    def curves(self) -> SlipCurves:
        every = (*self.estimation, *self.holdout)
        return slip_curves(every, self._slipping, self.given or self.acting)

    @cached_property
    def acting(self) -> Geometry:
        """Radius and width with which wheels that roll would go and turn most alike.

        Least squares over all steps: v = r ½(ω_L + ω_R),   ψ̇ = (r/B)(ω_R − ω_L).
        """
        rolled, spun, way, turned = [], [], [], []
        for d in (p.trajectory for p in self.estimation):
            along, angle = self.model.driven(d)
            way.append(along / d.step)
            turned.append(angle / d.step)
            rolled.append(d.omega.mean(axis=1))
            spun.append(np.diff(d.omega, axis=1)[:, 0])
        r = _slope(np.concatenate(rolled), np.concatenate(way))
        turn = _slope(np.concatenate(spun), np.concatenate(turned))
        return Geometry(r, r / turn)

    @property
    def windows(self) -> tuple[int, int]:
        """How many windows (estimation, held-out)."""
        inside, outside = (
            sum(len(p.windows) for p in part) for part in (self.estimation, self.holdout)
        )
        return inside, outside

    @cached_property
    def squares(self) -> SquareResult | None:
        """Estimates from closed squares among the paths, beside what the whole of the paths says;
        None without any."""
        n = in_units(self._slipping.q, self._slipping.geometry)
        each = self.trajectories.each
        runs = square_runs(each, self.known, n["pose_lag"], n["heading_offset"])
        if not runs:
            return None
        result = square_result(runs)
        ratio, width = n["radius_right"] / n["radius_left"], n["effective_width"] / self.known.B
        text = f"{result.sentence} The whole of the paths says {ratio:.5g} and {width:.5g}."
        return replace(result, sentence=text)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the logs and assumed, and where the model predicts badly."""
        notes = list(self.trajectories.notes)
        if isinstance(self.model, DynamicFit):
            notes += self.model.powered.notes
        way = mean_way(self.model, self.holdout)
        if self.after.path > STILL_OFF * way:
            notes.append(
                f"With these parameters the position error is {100 * self.after.path / way:.0f} % "
                "of the way after two seconds: the pose is timed unevenly, or the slip is not "
                "modelled. The standard errors hold for the nearest vehicle of this model."
            )
        worse = self.after.path > WORSE * self.plain.path
        worse = worse or self.after.heading > WORSE * self.plain.heading
        if worse and self.motion == "dynamic":
            notes.append(_PREDICTED_WORSE)
        return tuple(notes)

    @property
    def mission(self) -> dict[str, dict[str, Any]]:
        """Sections of a mission file that drive this vehicle: ``vehicle``, and ``motion`` where its
        sides slip by shares (the law of the mission's motion of kind slip)."""
        shares = self.model.shares() if isinstance(self.model, SlipFit) else None
        return shares or {"vehicle": asdict(self.acting)}

    @property
    def before_sentence(self) -> str:
        what = f"r = {self.known.r:g} m and B = {self.known.B:g} m"
        if self.given is not None:
            return f"before: rolling wheels with the given geometry ({what})"
        sentence = f"before: rolling wheels with the default geometry ({what})"
        if self.lengths.contradicts:
            sentence += (
                ", and the pose contradicts it; compare with plain, or give the vehicle's "
                "`geometry`"
            )
        return sentence

    def to_json(self) -> dict[str, Any]:
        """The document of ``fit-vehicle``."""
        steps = {"before": self.before, "plain": self.plain, "after": self.after}
        first, last = self.drift
        return plain_object(
            {
                "motion": self.motion,
                "parameters": self.numbers,
                "correlations": self.correlations,
                "path_error_m": {k: e.path for k, e in steps.items()},
                "heading_error_rad": {k: e.heading for k, e in steps.items()},
                "path_error_rms_m": {k: e.path_rms for k, e in steps.items()},
                "heading_error_rms_rad": {k: e.heading_rms for k, e in steps.items()},
                "before": self.before_sentence,
                "drift": {"before": first, "after": last},
                "two_fold": [
                    {
                        "path_error_m": {"before": f.before.path, "after": f.after.path},
                        "heading_error_rad": {"before": f.before.heading, "after": f.after.heading},
                        "parameters": dict(f.numbers),
                    }
                    for f in self.folds
                ],
                "squares": self.squares,
                "slip": self.curves,
                "windows": {"estimation": self.windows[0], "held_out": self.windows[1]},
                "geometry": {
                    "given": self.given,
                    "plain": self.lengths,
                },
                "vehicle": self.acting,
                "mission": self.mission,
            }
        )


def fit_vehicle(
    records: Sequence[Record],
    holdout: Sequence[Record] = (),
    geometry: Geometry | None = None,
    motion: str = "slip",
    motors: KnownMotors | None = None,
) -> VehicleFit:
    """Fit a vehicle to logs, validated on held-out windows of two seconds.

    Args:
        records: of one vehicle, with a pose and the speeds of its two sides, every row as logged
            (``held='keep'`` where they are read: repeats of slow sensors are detected here).
        holdout: records that judge; without them the last 30 % of each record's windows do.
        geometry: radius and distance of the wheels or tracks; None for the thesis's robot's.
        motors: what drives a vehicle of motion ``dynamic``; None where nothing of it is known.

    Raises:
        DataError: pose or speeds are missing, or there are too few windows; commands are missing.
        UsageError: there is no such motion, or it takes no motors.
    """
    if motion not in MOTIONS:
        raise UsageError(f"`motion` is one of {', '.join(MOTIONS)}, got {motion!r}")
    if motors is not None and motion != "dynamic":
        raise UsageError(f"motion {motion} has no torques; motors need `motion='dynamic'`")
    known = geometry or Geometry()
    trajectories = trajectories_of((*records, *holdout), known)
    estimation, validation = trajectories.each[: len(records)], trajectories.each[len(records) :]
    first, second = (whole(estimation), whole(validation)) if holdout else split(estimation)
    check_enough(first, records[0].name)
    check_enough(second, (holdout or records)[0].name)
    lengths = lengths_of([t for t in trajectories.tracks if len(t.starts)], known)
    # a width that the log does not determine scales with the radius
    r, width = lengths.geometry.r, lengths.geometry.B
    if lengths.std_errors[0] is not None and lengths.std_errors[1] is None:
        width = lengths.assumed.B * r / lengths.assumed.r
    start = Geometry(r, width)
    model: MotionFit
    if motion == "dynamic":
        every = (*records, *holdout)
        model = fit_weighed(first, start, every, trajectories, known, motors)
    else:
        model = fit_slip(first, start)
    parts = tuple(first), tuple(second)
    return VehicleFit(motion, trajectories, *parts, known, geometry, lengths, model)


def _slope(x: Array, y: Array) -> float:
    return max(float(x @ y) / max(float(x @ x), 1e-12), 1e-9)
