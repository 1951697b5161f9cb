"""Equations of a file as the physics of a grey box."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.errors import UsageError
from sysid.runners import floats
from sysid.runners.single import together
from sysid.structures.grey_box.file.definition import Definition, definition_of
from sysid.structures.grey_box.file.dimensions import dimension
from sysid.structures.grey_box.file.expressions import evaluate, names_in
from sysid.structures.grey_box.physics import Constant, Physics, Signal

HALVINGS, TERMS = 10, 8
"""Of the exponential of a matrix: scaled by 2^−10, eight terms of its series, squared ten times
(Moler & Van Loan 2003, method 3): exact to 1e-12 up to time constants of 1/500 of a sample."""

SLOPE = 1e-6
"""Relative step of the differences that give time constants."""

SPREAD = 2.0
EITHER_SIGN = 1.0
"""Starts vary a parameter with a lower bound by this factor, another one by this share."""


@dataclass(frozen=True)
class FilePhysics(Physics):
    """ẋ = f(x, u, p) or x⁺ = f(x, u, p), y = g(x, p) as a file writes them.

    A parameter that every experiment has of its own is a state that stays as it begins, counted
    from the start that the file gives, so that rest is zero. Continuous equations are integrated by
    Runge-Kutta 4; linear ones are stepped exactly, u held.

    Attributes:
        point: mean inputs, then mean outputs, of the data, about which time constants are stated.
    """

    text: str = ""
    point: tuple[float, ...] = ()

    takes_floats: ClassVar[bool] = True

    @property
    def definition(self) -> Definition:
        """The file, read."""
        return definition_of(self.text)

    @property
    def constants(self) -> tuple[Constant, ...]:
        constants = []
        for name, p in self.definition.parameters.items():
            low, high = p.bounds or (-np.inf, np.inf)
            low, high = (v if abs(v) < 1e300 else np.copysign(np.inf, v) for v in (low, high))
            spread = SPREAD if np.isfinite(low) else EITHER_SIGN
            constants.append(
                Constant(name, p.unit, p.start, low, high, not p.fixed, spread, words=p.meaning)
            )
        return tuple(constants)

    @property
    def state_names(self) -> tuple[str, ...]:
        return self.definition.states

    def estimated_states(self) -> tuple[bool, ...]:
        said = self.definition.said.states
        return tuple(not (n in said and said[n].known) for n in self.state_names)

    # ----------------------------------------------------------------- the equation

    def _values(
        self, xp: Any, x: Signal, u: Signal | None, p: Mapping[str, Signal]
    ) -> dict[str, Signal]:
        """Names of the file and what they stand for; ``let`` as far as it is known without u."""
        d = self.definition
        values: dict[str, Signal] = {n: p[n] for n in d.parameters}
        own = d.said.parameters
        for i, name in enumerate(d.states):
            values[name] = x[i] + own[name].start if name in own else x[i]
        if u is not None:
            values |= {n: u[i] for i, n in enumerate(d.inputs)}
        for name, e in d.let.items():
            if names_in(e) <= values.keys():
                values[name] = evaluate(e, values, xp)
        return values

    def _together(self, xp: Any, values: Sequence[Signal], x: Signal) -> Signal:
        """Values as rows; one that depends on nothing becomes as long as a state."""
        if xp is floats:
            return [float(v) for v in values]
        return together(xp, [v if np.ndim(v) else v + 0.0 * x[0] for v in values])

    def rates(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        values = self._values(xp, x, u, p)
        found = [evaluate(e, values, xp) for e in self.definition.rates]
        return self._together(xp, [*found, *[0.0] * (len(x) - len(found))], x)

    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        values = self._values(xp, x, None, p)
        return self._together(xp, [evaluate(e, values, xp) for e in self.definition.readings], x)

    def advance(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: float) -> Signal:
        d = self.definition
        if d.linear:
            return self._exact(xp, x, u, p)
        if d.said.time == "discrete":
            own = [x[i] for i in range(len(d.rates), len(x))]
            values = self._values(xp, x, u, p)
            after = self._together(xp, [*(evaluate(e, values, xp) for e in d.rates), *own], x)
        else:
            after = super().advance(xp, x, u, p, h)
        if not d.after:
            return after
        values = self._values(xp, after, None, p)
        put = [
            evaluate(d.after[n], values, xp) if n in d.after else after[i]
            for i, n in enumerate(d.states)
        ]
        return self._together(xp, put, after)

    def sample(
        self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: Signal, steps: Signal
    ) -> Signal:
        if self.definition.linear or self.definition.said.time == "discrete":
            return self.advance(xp, x, u, p, h)
        return super().sample(xp, x, u, p, h, steps)

    def prepared(self, xp: Any, p: dict[str, Signal], h: Signal) -> Mapping[str, Signal]:
        """With the matrix of an exact step, where the equations are linear, entry by entry."""
        if not self.definition.linear:
            return p
        n, m = len(self.state_names), self.nu
        zero = [0.0] * n, [0.0] * m

        def rate(k: int) -> list[Any]:
            x, u = list(zero[0]), list(zero[1])
            if 0 <= k < n:
                x[k] = 1.0
            elif k >= n:
                u[k - n] = 1.0
            values = self._values(xp, x, u, p)
            return [evaluate(e, values, xp) for e in self.definition.rates]

        free = rate(-1)
        columns = [[a - b for a, b in zip(rate(k), free, strict=True)] for k in range(n + m)]
        columns.append(free)
        none = xp.asarray(0.0)
        rows = [
            xp.stack([xp.asarray(c[i] * 1.0) if i < len(free) else none for c in columns])
            for i in range(n)
        ]
        rows += [xp.zeros(n + m + 1)] * (m + 1)
        step = exponential(xp, xp.stack([xp.asarray(r) for r in rows]) * h)
        exact = {_entry(i, k): step[i, k] for i in range(n) for k in range(n + m + 1)}
        return {**p, **exact}

    def _exact(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        n, m = len(x), self.nu
        seen = [*(x[i] for i in range(n)), *(u[i] for i in range(m))]
        after = []
        for i in range(n):
            value = p[_entry(i, n + m)]
            for k, v in enumerate(seen):
                value = value + p[_entry(i, k)] * v
            after.append(value)
        return self._together(xp, after, x)

    def bare(self) -> "FilePhysics":
        return replace(self, point=())

    def for_record(self, record: Record) -> "FilePhysics":
        means = np.concatenate([record.u.mean(axis=0), record.y.mean(axis=0)])
        return replace(self, point=tuple(means.tolist()))

    # ----------------------------------------------------------------- where a fit begins

    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        return (("values of the file", self.pack({})),)

    def state_guess(self, theta: Array, u: Array, y: Array, dt: float) -> Array:
        """As the file says; see ``StateSection``."""
        d = self.definition
        p = self.unpack(np, np.asarray(theta))
        values = {n: float(v) for n, v in p.items()}
        values |= {n: float(v) for n, v in zip(d.outputs, y[0], strict=True)} if len(y) else {}
        x = np.zeros(len(d.states))
        for i, name in enumerate(d.states):
            e = d.initial.get(name)
            if e is not None and names_in(e) <= values.keys():
                with np.errstate(all="ignore"):
                    first = float(evaluate(e, values, np))
                x[i] = first if np.isfinite(first) else 0.0
        return x

    # ----------------------------------------------------------------- what follows from θ

    def _motions(self, theta: Array) -> Array:
        """Rates [1/s] of its own motions at the means of the data: eigenvalues of ∂f/∂x."""
        d = self.definition
        if d.said.time == "discrete":
            return np.zeros(0)
        n, p = len(d.rates), self.unpack(np, np.asarray(theta, dtype=np.float64))
        mean = np.array(self.point or [0.0] * (self.nu + self.ny))
        u, y = mean[: self.nu, None], mean[None, self.nu :]
        at = self.state_guess(theta, u.T, y, 0.0)
        size = np.maximum(np.abs(at), 1.0) * SLOPE
        x = np.stack([at + s * side for s in np.diag(size)[:n] for side in (1.0, -1.0)], axis=1)
        with np.errstate(all="ignore"):
            f = self.rates(np, x, np.tile(u, (1, x.shape[1])), p)[:n]
        A = (f[:, ::2] - f[:, 1::2]) / (2.0 * size[:n])
        return np.linalg.eigvals(A) if np.all(np.isfinite(A)) else np.zeros(0)

    def time_constants(self, theta: Array) -> Array:
        """−1/Re λ [s] of its own motions; infinite where one neither grows nor decays."""
        real = self._motions(theta).real
        fast = np.max(np.abs(real), initial=0.0)
        still = np.abs(real) <= 1e-9 * fast
        return np.where(still, np.inf, -1.0 / np.where(still, 1.0, real))

    def time_scale(self, theta: Array, dt: float) -> float:
        """1/|λ| of the fastest motion; a sample of a difference equation."""
        if self.definition.said.time == "discrete":
            return dt
        fastest = float(np.max(np.abs(self._motions(theta)), initial=0.0))
        return 1.0 / fastest if fastest > 0.0 else np.inf

    def sentences(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        said = self.definition.said
        form = "{} = {}" if said.time == "continuous" else "{}(t+1) = {}"
        values = ", ".join(
            f"{c.name} = {v:.5g} {c.unit}".rstrip()
            for c, v in zip(self.constants, theta, strict=True)
        )
        rate = "d{}/dt" if said.time == "continuous" else "{}"
        return (
            *(f"{n} = {text}" for n, text in said.let.items()),
            *(form.format(rate.format(n), text) for n, text in said.equations.items()),
            *(f"{n} ← {text} after each step" for n, text in said.after.items()),
            *(f"{n} = {o.equation}" for n, o in said.outputs.items()),
            values,
        )

    def require_channels(self, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> None:
        """Refuse channels in other units than the file's, or in another order."""
        d = self.definition
        for side, units, channels in (("input", d.inputs, inputs), ("output", d.outputs, outputs)):
            names = [c.name for c in channels]
            if set(names) == set(units) and names != list(units):
                raise UsageError(
                    f"the {side}s of the file are {', '.join(units)}, those of the log "
                    f"{', '.join(names)}; give them in the order of the file by `{side}s`"
                )
            for (name, unit), channel in zip(units.items(), channels, strict=True):
                try:
                    one, other = dimension(unit), dimension(channel.unit)
                except ValueError:  # a log may have units that no equation knows
                    continue
                if one is not None and other is not None and not one.like(other):
                    raise UsageError(
                        f"{side} {name} of the file is in {unit}, {channel.name} of the log in "
                        f"{channel.unit}; write the equations for {channel.unit}"
                    )


def _entry(row: int, column: int) -> str:
    """Under which name an entry of the matrix of an exact step stands among constants."""
    return f"step {row} {column}"


def exponential(xp: Any, A: Signal) -> Signal:
    """exp(A) by scaling and squaring, over any namespace."""
    part = A * 2.0**-HALVINGS
    one = xp.eye(len(A))
    out = one
    for k in range(TERMS, 0, -1):
        out = one + part @ out * (1.0 / k)
    for _ in range(HALVINGS):
        out = out @ out
    return out
