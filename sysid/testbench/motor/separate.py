"""Constants of a motor from one experiment at a time (thesis §5.3), and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.fitting.differences import slopes
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest

Values = Mapping[str, float]


@dataclass(frozen=True)
class Route:
    """A constant from one experiment.

    Attributes:
        value, std_error: in SI; no error where it is not asked for.
        how: the experiment and what is done with it.
    """

    name: str
    value: float
    how: str
    std_error: float = 0.0

    @property
    def words(self) -> str:
        return f"{self.value:.4g} ± {NORMAL * self.std_error:.2g} ({self.how})"


def routes(
    tests: Sequence[SteadyTest], known: Mapping[str, KnownValue], gear: float
) -> tuple[Route, ...]:
    """Every route from the experiments to a constant, the thesis's first.

    The constants are found in the order R, Kem, Kc, then f and C0 together, each with those
    before it; what is known takes part as if it were measured.
    """
    values: dict[str, float] = {}
    all_routes: list[Route] = []
    for name, value in known.items():
        if name != "gear":
            all_routes.append(Route(name, value.value, f"a value from {value.source}"))
            values[name] = value.value
    for rule in (_resistance, _back_emf, _torque_constant, _friction):
        for route in rule(tests, values, gear):
            if np.isfinite(route.value):
                all_routes.append(route)
                values.setdefault(route.name, route.value)
    return tuple(all_routes)


def values_of(some_routes: Sequence[Route]) -> dict[str, float]:
    """The first route of every constant."""
    taken: dict[str, float] = {}
    for route in some_routes:
        taken.setdefault(route.name, route.value)
    return taken


def _of(tests: Sequence[SteadyTest], kind: Kind, *quantities: str) -> list[SteadyTest]:
    return [t for t in tests if t.kind is kind and t.has(*quantities)]


def _mean(parts: Sequence[Array]) -> float:
    values = np.concatenate(parts) if parts else np.zeros(0)
    values = values[np.isfinite(values)]
    return float(np.mean(values)) if len(values) else np.nan


def _resistance(tests: Sequence[SteadyTest], _: Values, gear: float) -> list[Route]:
    """R = V/i of a blocked rotor; a stall test with its current is one, too."""
    ways = []
    for kind in (Kind.BLOCKED, Kind.STALL):
        some = _of(tests, kind, "current")
        if some:
            value = _mean([t.voltage / t.of("current") for t in some])
            ways.append(Route("R", value, f"{kind.value}: mean of V/i"))
    return ways


def _back_emf(tests: Sequence[SteadyTest], values: Values, gear: float) -> list[Route]:
    """Kem = (V − R i)/ωm."""
    if "R" not in values:
        return []
    ways = []
    for kind in (Kind.NO_LOAD, Kind.EXTERNAL):
        some = _of(tests, kind, "current", "speed")
        if some:
            each = [
                (t.voltage - values["R"] * t.of("current")) / (gear * t.of("speed")) for t in some
            ]
            ways.append(Route("Kem", _mean(each), f"{kind.value}: mean of (V − R i)/ωm"))
    return ways


def _torque_constant(tests: Sequence[SteadyTest], values: Values, gear: float) -> list[Route]:
    """Kc: stall torque over the current beyond that without load; over all of it; from loads."""
    ways = []
    some = _of(tests, Kind.STALL, "torque")
    if some and "R" in values:
        without = [_no_load_current(tests, t.voltage) for t in some]
        read = [t.of("current") for t in some]
        stalled = [
            np.where(np.isfinite(i), i, t.voltage / values["R"])
            for t, i in zip(some, read, strict=True)
        ]
        torque = [t.motor_torque(gear) for t in some]
        each = [c / (i - i0) for c, i, i0 in zip(torque, stalled, without, strict=True)]
        how = "stall: mean of torque over stall current minus no-load current"
        ways.append(Route("Kc", _mean(each), how))
        whole = [c / i for c, i in zip(torque, stalled, strict=True)]
        ways.append(Route("Kc", _mean(whole), "stall: mean of torque over stall current"))
    rows = _loaded_rows(tests, values, gear)
    if rows is not None and len(rows) > 3:
        current, load, speed = rows.T
        if np.ptp(load) > 0.0 and np.ptp(speed) > 0.0:
            terms = np.column_stack([load, np.ones(len(load)), speed])
            slope = float(scaled_lstsq(terms, current)[0])
            how = "external load: slope of the current over the load"
            ways.append(Route("Kc", 1.0 / slope if slope > 0.0 else np.nan, how))
    return ways


def _no_load_current(tests: Sequence[SteadyTest], voltage: Array) -> Array:
    """No-load current at these voltages: measured, or on the line through the measurements."""
    some = _of(tests, Kind.NO_LOAD, "current")
    if not some:
        return np.full(len(voltage), np.nan)
    V = np.concatenate([t.voltage for t in some])
    i = np.concatenate([t.of("current") for t in some])
    V, i = V[np.isfinite(i)], i[np.isfinite(i)]
    line = np.polyfit(V, i, 1) if np.ptp(V) > 0.0 else np.array([0.0, float(np.mean(i))])
    read = [i[v == V] for v in voltage]
    return np.array(
        [np.mean(r) if len(r) else np.polyval(line, v) for r, v in zip(read, voltage, strict=True)]
    )


def _loaded_rows(tests: Sequence[SteadyTest], values: Values, gear: float) -> Array | None:
    """Current, load and speed at the motor's shaft of tests with external load, (N, 3).

    Where the current was not read it is (V − Kem ωm)/R, as in the thesis.
    """
    parts = []
    for t in _of(tests, Kind.EXTERNAL, "speed", "torque"):
        speed = gear * t.of("speed")
        current = t.of("current")
        if "R" in values and "Kem" in values:
            computed = (t.voltage - values["Kem"] * speed) / values["R"]
            current = np.where(np.isfinite(current), current, computed)
        if np.all(np.isfinite(current)):
            # both directions as one: measurements have the signs of their voltages
            signed = np.column_stack([current, t.motor_torque(gear), speed])
            parts.append(np.sign(t.voltage)[:, None] * signed)
    return np.concatenate(parts) if parts else None


def _friction(tests: Sequence[SteadyTest], values: Values, gear: float) -> list[Route]:
    """f and C0: the line of Kc i − τ Cr over ωm; of external loads the mean over the loads."""
    Kc = values.get("Kc", values.get("Kem"))  # without a torque Kc is taken for equal to Kem
    if Kc is None:
        return []
    ways = []
    rows = _loaded_rows(tests, values, gear)
    if rows is not None:
        lines = []
        for load in np.unique(rows[:, 1]):
            at_load = rows[rows[:, 1] == load]
            if np.ptp(at_load[:, 2]) > 0.0:
                lines.append(_line(at_load[:, 2], Kc * at_load[:, 0] - load))
        if not lines and np.ptp(rows[:, 2]) > 0.0:
            lines = [_line(rows[:, 2], Kc * rows[:, 0] - rows[:, 1])]
        if lines:
            f, C0 = np.mean(lines, axis=0).tolist()
            how = "external load: line of Kc i − τ Cr over ωm, mean over the loads"
            ways += [Route("f", f, how), Route("C0", C0, how)]
    free = _of(tests, Kind.NO_LOAD, "current", "speed")
    if free:
        # both directions as one: measurements have the signs of their voltages
        speed = np.concatenate([gear * np.abs(t.of("speed")) for t in free])
        current = np.concatenate([np.abs(t.of("current")) for t in free])
        ok = np.isfinite(speed) & np.isfinite(current)
        if np.ptp(speed[ok]) > 0.0:
            f, C0 = _line(speed[ok], Kc * current[ok]).tolist()
            how = "no load: line of Kc i over ωm"
            ways += [Route("f", f, how), Route("C0", C0, how)]
    return ways


def _line(x: Array, y: Array) -> Array:
    return scaled_lstsq(np.column_stack([x, np.ones(len(x))]), y)


_STEP = 1e-5
"""Relative change of a measurement for a central difference."""


def propagated(
    tests: Sequence[SteadyTest],
    known: Mapping[str, KnownValue],
    gear: float,
    sigma: Mapping[tuple[str, str], float],
) -> tuple[tuple[Route, ...], tuple[str, ...], Array]:
    """Every route with its standard error, and the covariance of the first value of each constant.

    First-order propagation, cov = Σ σ² g gᵀ with g the slope of all values over one measurement:
    the same measurements and the same R enter several constants, whose errors are thereby
    correlated.

    Args:
        gear: turns of the motor for one of the output shaft.
        sigma: noise level by (file, quantity), in SI.

    Returns:
        The routes; names of the n constants; covariance (n, n).
    """
    here = routes(tests, known, gear)
    names = tuple(n for n in CONSTANTS if n in values_of(here))
    rows = [
        (k, q, row)
        for k, test in enumerate(tests)
        for q in test.answers()
        for row in np.flatnonzero(np.nan_to_num(test.of(q))).tolist()
        if sigma.get((test.name, q))
    ]

    def values(p: Array) -> Array:
        """Of the routes, and the first of each constant, for other numbers."""
        measured = list(tests)
        for (k, q, row), x in zip(rows, p[len(known) :], strict=True):
            readings = measured[k].of(q).copy()
            readings[row] = x
            measured[k] = measured[k].changed(q, readings)
        others = {n: replace(v, value=x) for (n, v), x in zip(known.items(), p, strict=False)}
        found = routes(measured, others, gear)
        first = values_of(found)
        return np.array([*(r.value for r in found), *(first[n] for n in names)])

    p = np.array([*(v.value for v in known.values()), *(tests[k].of(q)[r] for k, q, r in rows)])
    errors = [
        *(v.std_error for v in known.values()),
        *(sigma[tests[k].name, q] for k, q, _ in rows),
    ]
    changes = slopes(values, p, _STEP * np.abs(p)) * np.array(errors)
    of_routes, of_constants = changes[: len(here)], changes[len(here) :]
    std_errors = np.linalg.norm(of_routes, axis=1).tolist()
    found = tuple(replace(r, std_error=e) for r, e in zip(here, std_errors, strict=True))
    return found, names, of_constants @ of_constants.T
