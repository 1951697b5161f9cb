"""Noise of a navigation filter, estimated from a log of its sensors by maximum likelihood."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.logs.sensor_log import SensorLog
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array
from sysid.errors import DataError
from sysid.robot.mission.localize import Localization, localize_log, read_sensors, scene_of
from sysid.robot.mission.navigation.fusion import Filter
from sysid.robot.mission.spec import Mission


@dataclass(frozen=True)
class SearchRule:
    """How the noise is looked for.

    Attributes:
        decades: powers of ten that a density or variance may move from where it started: figures
            from data sheets are off by less, and a log without motion would drive them anywhere.
        known: standard deviation of the figures of sensors and of a small robot's motion [powers of
            ten]: it holds what the log says nothing of, and weighs nothing against what it says.
        rows: of a log that are used, from its start: enough for variances to within 5 %.
        rejects: share of rejected measurements beyond which a gate is opened: a few per mille of
            right ones lie outside; more say that the robot moves as the filter does not expect.
        steps: of the factors, one after the other [powers of ten]; the last is 12 % of a variance,
            of which some hundred samples know no more.
        sweeps: through all factors with one step at most.
        gain: of log likelihood below which nothing is gained: e^0.1 is no evidence.
    """

    decades: float = 4.0
    known: float = 1.0
    rows: int = 1500
    rejects: float = 0.01
    steps: tuple[float, ...] = (1.0, 0.5, 0.2, 0.1, 0.05)
    sweeps: int = 3
    gain: float = 0.1


RULE = SearchRule()


@dataclass(frozen=True, eq=False)
class FilterTuning:
    """Densities and variances of a filter that make a log's measurements most likely.

    Attributes:
        q: densities of what walks at random, by state.
        r: variances of measurements, by name.
        gate: the filter's, opened (1) where it would reject much with this noise.
        log_likelihood: of the measurements before and after.
        at_bound: keys whose value went as far as it may.
    """

    q: Mapping[str, float]
    r: Mapping[str, float]
    gate: float
    log_likelihood: tuple[float, float]
    before: Localization
    after: Localization
    at_bound: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def sentence(self) -> str:
        gained = self.log_likelihood[1] - self.log_likelihood[0]
        text = f"The log likelihood of the measurements rose by {gained:.4g}"
        figures = self.after.consistency
        if figures.get("nis_mean") is None:
            return f"{text}."
        low, high = figures["nis_bounds"]
        fits = low <= figures["nis_mean"] <= high
        return (
            f"{text}; NIS {figures['nis_mean']:.3g} lies "
            f"{'inside' if fits else 'outside'} its bounds {low:.3g} to {high:.3g}."
        )

    def summary(self) -> dict[str, Any]:
        return {
            "q": dict(self.q),
            "r": dict(self.r),
            "gate": self.gate,
            "log_likelihood": {"before": self.log_likelihood[0], "after": self.log_likelihood[1]},
            "consistency": {
                "before": dict(self.before.consistency),
                "after": dict(self.after.consistency),
            },
            "errors": {"before": dict(self.before.errors), "after": dict(self.after.errors)},
            "at_bound": list(self.at_bound),
            "sentence": self.sentence,
            "warnings": list(self.notes),
        }


def tuned_filter(
    path: str | Path,
    mission: Mission,
    columns: Mapping[str, str] | None = None,
    options: ReadOptions | None = None,
    rule: SearchRule = RULE,
) -> FilterTuning:
    """Estimate the noise of a mission's filter from a log.

    Maximises Σ ln p(z_k | z_1 … z_{k−1}) = Σ −½(νᵀS⁻¹ν + ln det S + m ln 2π) over the densities q
    and the variances r, as powers of ten, with slopes by differences. Measurements of one sensor
    share a factor. Nothing is rejected meanwhile: a gate would hide what does not fit. Where the
    log holds the true pose, the run starts in it and errors are counted.

    Args:
        mission: whose navigation is a filter with q and r.
        columns: reading → column, where the names differ.
    """
    law = mission.navigation
    if not isinstance(law, Filter):
        raise DataError(
            "the mission's navigation has no noise to tune: name a filter, e.g. "
            "navigation: {kind: ekf}"
        )
    log = read_sensors(path, columns, options)
    scene, notes = scene_of(log, mission)
    knobs = _knobs(law, scene)
    short = _cut(log, rule.rows)

    def with_noise(powers: Array) -> Filter:
        q, r = dict(law.q), dict(law.r)
        for knob, power in zip(knobs, powers.tolist(), strict=True):
            for kind, name, value in knob:
                (q if kind == "q" else r)[name] = value * 10.0**power
        return law.model_copy(update={"q": q, "r": r})

    def likelihood(powers: Array) -> float:
        taken = with_noise(powers).model_copy(update={"gate": 1.0})
        localization = localize_log(short, mission.model_copy(update={"navigation": taken}))
        prior = 0.5 * float(np.sum((powers / rule.known) ** 2))
        return float(np.nansum(localization.columns["log_likelihood"])) - prior

    powers, *likelihoods = _climbed(likelihood, len(knobs), rule)
    best = with_noise(powers)
    after = localize_log(log, mission.model_copy(update={"navigation": best}))
    if law.gate < 1 and _rejected(after) > rule.rejects:
        notes = (
            *notes,
            f"Its gate would reject {_rejected(after):.0%} of the measurements, because the robot "
            "moves less evenly than a random walk; the gate was opened (1).",
        )
        best = best.model_copy(update={"gate": 1.0})
        after = localize_log(log, mission.model_copy(update={"navigation": best}))
    edge = rule.decades - rule.steps[-1]
    bound = [f"{kind}.{name}" for knob, p in zip(knobs, powers, strict=True) if abs(p) >= edge
             for kind, name, _ in knob]  # fmt: skip
    if len(short.t) < len(log.t):
        notes = (*notes, f"The noise was estimated from the first {len(short.t)} rows.")
    return FilterTuning(
        q=best.q,
        r=best.r,
        gate=best.gate,
        log_likelihood=(likelihoods[0], likelihoods[1]),
        before=localize_log(log, mission),
        after=after,
        at_bound=tuple(bound),
        notes=notes,
    )


def _rejected(localization: Localization) -> float:
    """Share of the measurements' groups that the gate let not through."""
    groups = max(1, int(np.sum(localization.columns["nis_dof"] > 0)))
    return float(np.sum(localization.columns["rejected"])) / groups


Knob = tuple[tuple[str, str, float], ...]
"""What one factor scales: ("q" or "r", name, value at the factor 1)."""


def _knobs(law: Filter, scene: Any) -> tuple[Knob, ...]:
    """What may be scaled: each walk of the motion, and the measurements of each sensor together."""
    plan = law.plan(scene)
    densities = {"speed": plan.process.speed, "yaw_rate": plan.process.yaw_rate}
    walks = dict(zip(plan.process.names, plan.process.walks, strict=True))
    if walks.get("slip_l", 0.0) > 0:
        densities["slip"] = walks["slip_l"]
    motion = tuple((("q", name, value),) for name, value in densities.items())
    sensors = tuple(
        tuple(("r", name, value) for name, value in zip(group.names, group.variance, strict=True))
        for group in plan.groups
    )
    return (*motion, *sensors)


def _cut(log: SensorLog, most: int) -> SensorLog:
    rows = slice(0, most)
    measurements = {name: values[rows] for name, values in log.measurements.items()}
    pose = None if log.pose is None else log.pose[rows]
    return replace(log, t=log.t[rows], measurements=measurements, pose=pose)


def _climbed(
    likelihood: Callable[[Array], float], n: int, rule: SearchRule
) -> tuple[Array, float, float]:
    """The powers of ten at the top, and the log likelihood at the start and there.

    A pattern search (Hooke and Jeeves 1961): each factor in turn goes up or down as long as that
    gains; when none does, the step becomes smaller. Slopes are of no use far from the top, where
    those of different factors differ by orders of magnitude.
    """
    powers = np.zeros(n)
    first = best = likelihood(powers)
    if not np.isfinite(first):
        raise DataError(
            "the measurements have zero likelihood under the filter's noise; check r and q"
        )
    for step in rule.steps:
        for _ in range(rule.sweeps):
            before = best
            for k in range(n):
                powers, best = _moved(likelihood, powers, best, step * np.eye(n)[k], rule)
            if best - before < rule.gain:
                break
    return powers, first, best


def _moved(
    likelihood: Callable[[Array], float],
    powers: Array,
    best: float,
    step: Array,
    rule: SearchRule,
) -> tuple[Array, float]:
    """Move one factor up, else down, as long as that gains."""
    for sign in (1.0, -1.0):
        start = best
        while np.all(np.abs(powers + sign * step) <= rule.decades):
            there = likelihood(powers + sign * step)
            if not there > best + rule.gain:
                break
            powers, best = powers + sign * step, there
        if best > start:
            break
    return powers, best
