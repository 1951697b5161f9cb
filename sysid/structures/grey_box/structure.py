"""Grey boxes: an ODE or difference equation whose parameters are physical constants.

A grey box is one class of about forty lines: its constants, its right-hand side and what is read
from its state. Free runs, derivatives, multi-start, standard errors, saving, exports and plots
follow from these. ``sysid/structures/grey_box/tanks.py`` is a complete example; other packages
register theirs under the entry-point group ``sysid.structures``.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Ge, Le

from sysid.data.record import Array, Channel, Record
from sysid.data.schema import checked
from sysid.errors import UsageError, argument
from sysid.fitting.problem import (
    Parameter,
)
from sysid.outside_text import whole
from sysid.runners import floats
from sysid.runners.loops import repeated
from sysid.runners.single import ahead, in_floats
from sysid.structures.base import NamedStructure, refuse_options
from sysid.structures.grey_box.constants import Constant, Rung, Signal
from sysid.structures.grey_box.runs import (
    fitted_state,
    free_run,
    stays_bounded,
    tangents,
)
from sysid.structures.motion import time_constants
from sysid.structures.special_runs import readout
from sysid.structures.traits import Traits

MAX_SUBSTEPS = 1000

OPTIONS: Mapping[str, str] = {
    "substeps": "integration steps in a sample; chosen from the time constants unless given",
    "free": "constants to estimate that are fixed by default, separated by commas",
}
"""Options of every grey box."""


def grey_box_traits(
    title: str, equation: str, when: str, options: Mapping[str, str] | None = None
) -> Traits:
    """The traits of a grey box; it has the options of all grey boxes, too."""
    return Traits(
        title=title,
        equation=equation,
        when=when,
        options={**(options or {}), **OPTIONS},
        tells="physical constants with units and errors",
        physical=True,
    )


@dataclass(frozen=True)
class GreyBox(NamedStructure):
    """ẋ = f(x, u, p), y = g(x, p) with physical constants p; y(k) is read before u(k) acts.

    Subclasses give ``constants``, ``state_names``, ``rates`` (or ``advance``, for difference
    equations and exact discretisations), ``reading`` and ``first_guess``. In all of these x is
    (n, runs) and u (nu, runs); a constant is a number, or (ny, 1) where every output has one.
    The input is held between samples; each sample is cut into ``substeps`` equal steps.

    Attributes:
        dt: sample time [s], read off the data; 0 before a fit.
        substeps: steps in a sample, 0 before a fit when it is to be chosen.
        opened: constants that are estimated although they are held by default.
        input_range: lowest and highest value of each input in the data; empty before a fit.
    """

    n_inputs: int
    n_outputs: int
    dt: Annotated[float, Ge(0.0)] = 0.0
    substeps: Annotated[int, Ge(0), Le(MAX_SUBSTEPS)] = 0
    opened: tuple[str, ...] = ()
    input_range: tuple[tuple[float, float], ...] = ()

    takes_floats: ClassVar[bool] = False
    """Whether ``advance`` and ``reading`` also serve one run on plain numbers, which is ten times
    faster: x and u are lists of floats then, constants floats or, one an output, lists."""

    # ----------------------------------------------------------------- what a subclass gives

    @property
    @abstractmethod
    def constants(self) -> tuple[Constant, ...]:
        """The physical constants, in the order of θ."""

    @property
    @abstractmethod
    def state_names(self) -> tuple[str, ...]:
        """What the states are."""

    @abstractmethod
    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        """y (ny, runs) of the state x (n, runs)."""

    @abstractmethod
    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        """Named θ read off the data: where the search begins."""

    def rates(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        """ẋ (n, runs)."""
        raise TypeError(f"{type(self).__name__} must define rates or advance")

    def advance(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: float) -> Signal:
        """x after a step h with u held: classical Runge-Kutta 4 unless overridden."""
        a = self.rates(xp, x, u, p)
        b = self.rates(xp, ahead(xp, x, 0.5 * h, a), u, p)
        c = self.rates(xp, ahead(xp, x, 0.5 * h, b), u, p)
        d = self.rates(xp, ahead(xp, x, h, c), u, p)
        total = ahead(xp, ahead(xp, a, 2.0, ahead(xp, b, 1.0, c)), 1.0, d)
        return ahead(xp, x, h / 6.0, total)

    def prepared(self, xp: Any, p: dict[str, Signal], h: Signal) -> Mapping[str, Signal]:
        """p for ``advance`` and ``reading``, with whatever need be computed only once a run."""
        return p

    def rough(self) -> Self:
        """The same θ with cheaper steps, if there are any, for comparing many starts."""
        return self

    def state_guess(self, theta: Array, u: Array, y: Array) -> Array:
        """A state that suits the head of a record: the first outputs, and zeros."""
        x = np.zeros(len(self.state_names))
        n = min(len(x), y.shape[1])
        if len(y):
            x[:n] = y[0, :n]
        return x

    def ladder(self) -> tuple[Rung, ...]:
        """What held-out data decide on, in the order in which it is tried."""
        return ()

    def rung_starts(self, theta: Array, rung: Rung, records: Sequence[Record]) -> tuple[Array, ...]:
        """Where to begin when the constants of a rung become free: where they are, by default."""
        return (theta,)

    def for_record(self, record: Record) -> Self:
        """The grey box with what it reads off a record's channels."""
        return self

    def time_constants_s(self, theta: Array) -> Array:
        """Time constants [s], one a motion, infinite for an integral; empty when unknown.

        From the slowest follows how long an initial state is remembered.
        """
        return np.zeros(0)

    def time_scale(self, theta: Array) -> float:
        """Shortest time constant [s], from which the substeps follow; infinite when unknown."""
        return float(np.min(self.time_constants_s(theta), initial=np.inf))

    # ----------------------------------------------------------------- θ and p

    @property
    def nu(self) -> int:
        return self.n_inputs

    @property
    def ny(self) -> int:
        return self.n_outputs

    def unpack(self, xp: Any, theta: Signal) -> dict[str, Signal]:
        """p: the constants by name."""
        p: dict[str, Signal] = {}
        at = 0
        for c in self.constants:
            n = self.n_outputs if c.each else 1
            p[c.name] = theta[at : at + n].reshape(n, 1) if c.each else theta[at]
            at += n
        return p

    def pack(self, p: Mapping[str, Any]) -> Array:
        """θ from constants by name; those that are missing take their default value."""
        parts = [
            np.broadcast_to(
                np.ravel(np.asarray(p.get(c.name, c.value), dtype=np.float64)),
                (self.n_outputs if c.each else 1,),
            )
            for c in self.constants
        ]
        return np.concatenate(parts)

    def entries(self, name: str) -> list[int]:
        """Places in θ of the constant called ``name``."""
        at = 0
        for c in self.constants:
            n = self.n_outputs if c.each else 1
            if c.name == name:
                return list(range(at, at + n))
            at += n
        return []

    def spreads(self) -> Array:
        """``Constant.spread`` by entry of θ."""
        return self.by_entry(lambda c: c.spread)

    def by_entry(self, value: Callable[[Constant], float]) -> Array:
        """One number of each constant, for every entry of θ."""
        values = [[value(c)] * (self.n_outputs if c.each else 1) for c in self.constants]
        return np.array([v for row in values for v in row])

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of the constants; those held by default are fixed."""
        parameters = []
        unit_u, unit_y = inputs[0].unit or "u", outputs[0].unit or "y"
        for c in self.constants:
            unit = c.unit.replace("{u}", unit_u).replace("{y}", unit_y)
            fixed = None if c.free or c.name in self.opened else c.value
            for output in outputs if c.each else outputs[:1]:
                tag = f"[{output.name}]" if c.each and len(outputs) > 1 else ""
                parameters.append(Parameter(c.name + tag, unit, c.lower, c.upper, fixed))
        return tuple(parameters)

    # ----------------------------------------------------------------- making one

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with these options; grey boxes have no orders.

        Raises:
            UsageError: orders are given, or an option does not exist or cannot be read.
        """
        refuse_options(cls.name, options, tuple(cls.traits.options))
        if raw:
            raise UsageError(
                f"`orders`: {cls.name} is a physical model and has no orders; omit `orders`"
            )
        given = dict(options or {})
        substeps = _substeps(given.get("substeps", "auto"))
        opened = tuple(n.strip() for n in given.get("free", "").split(",") if n.strip())
        made = cls(nu, ny, substeps=substeps, opened=opened, **cls.read_options(given, nu, ny))
        known = [c.name for c in made.constants]
        for name in opened:
            if name not in known:
                raise UsageError(
                    f"`structure_options['free']`: {cls.name} has no constant {name!r}; it has "
                    f"{', '.join(known)}"
                )
        return made

    @classmethod
    def read_options(cls, given: Mapping[str, str], nu: int, ny: int) -> dict[str, Any]:
        """Fields of the subclass from its options; UsageError for numbers of channels it lacks."""
        return {}

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """One entry without orders."""
        return ({},)

    def described_constants(self) -> tuple[Mapping[str, str], ...]:
        """Name, meaning, unit and estimation of each constant."""
        tried = {name for rung in self.ladder() for name in rung.names}
        return tuple(
            {
                "name": c.name,
                "meaning": c.words,
                "unit": c.unit.replace("{u}", "input").replace("{y}", "output"),
                "estimated": "always"
                if c.free
                else "where held-out data pay for it"
                if c.name in tried
                else "if option free names it",
            }
            for c in self.constants
        )

    def order_values(self) -> dict[str, Any]:
        return {}

    def settings(self) -> dict[str, Any]:
        """Every field besides the numbers of channels."""
        settings = {f.name: getattr(self, f.name) for f in fields(self)}
        return {
            k: list(v) if isinstance(v, tuple) else v
            for k, v in settings.items()
            if k not in ("n_inputs", "n_outputs")
        }

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        channels = {"n_inputs": raw["nu"], "n_outputs": raw["ny"]}
        cls.read_options({}, raw["nu"], raw["ny"])  # refuses channels that it cannot have
        return checked(cls, {**raw["settings"], **channels})

    def sampled(self, dt: float) -> Self:
        """The same grey box for data sampled every ``dt`` seconds."""
        return replace(self, dt=dt)

    def driven_as(self, records: Sequence[Record]) -> Self:
        """The same grey box with the range of the inputs of some records."""
        u = np.concatenate([r.u for r in records])
        ends = zip(u.min(axis=0).tolist(), u.max(axis=0).tolist(), strict=True)
        return replace(self, input_range=tuple(ends))

    # ----------------------------------------------------------------- runs

    @property
    def steps(self) -> int:
        """Steps in a sample, at least one."""
        return max(self.substeps, 1)

    @property
    def h(self) -> float:
        """Length of a substep [s]."""
        return self.dt / self.steps

    def timeless(self) -> Self:
        """The equations alone: equal where a compilation of one serves the other."""
        return replace(self, dt=0.0, substeps=0, opened=(), input_range=())

    def sample(
        self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: Signal, steps: Signal
    ) -> Signal:
        """x one sample later, u held for ``steps`` steps of length h."""
        return repeated(xp, steps, lambda x: self.advance(xp, x, u, p, h), x)

    def first_sample(self) -> int:
        return 0

    def n_states(self, theta: Array) -> int:
        return len(self.state_names)

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State that meets the first ``samples`` of y best, near ``state_guess``."""
        return fitted_state(self, theta, u, y, samples)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (all states zero when None), (N, ny)."""
        x = np.zeros(self.n_states(theta)) if x0 is None else x0
        return free_run(self, theta, [u], x[:, None])[0]

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """The free run sample by sample: the same equations as the compiled runs."""
        own: Any = theta.__array_namespace__()
        p = self.prepared(own, self.unpack(own, theta), self.h)
        plain = in_floats(p) if self.takes_floats and own is np else None
        h, steps = self.h, self.steps

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            if xp is np and plain is not None:
                now = x.tolist()
                moved = self.sample(floats, now, u.tolist(), plain, h, steps)
                return np.array(moved), np.array(self.reading(floats, now, plain))
            state, command = x[:, None], u[:, None]
            y = xp.asarray(self.reading(xp, state, p))
            after = xp.asarray(self.sample(xp, state, command, p, h, steps))
            return after[:, 0], y[:, 0]

        return advance

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """Free-run errors: nothing but the initial state is taken from the outputs."""
        x0 = self.fitted_state(theta, u, y, window) if window else None
        return np.asarray(y - self.simulate(theta, u, x0))

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """The free run, whatever the horizon: there is no noise model."""
        return np.asarray(y - self.errors(theta, u, y, window))

    def stable(self, theta: Array) -> bool:
        """Whether a long run stays finite and grows no faster than an integral would.

        Judged by runs from rest under inputs that fill the range of the data (±1 when there are
        none): random two-level inputs, fast and slow, and its two ends held.
        """
        if not np.all(np.isfinite(theta)):
            return False
        ranges = self.input_range or ((-1.0, 1.0),) * self.nu
        return stays_bounded(self, theta, ranges)

    def gradient_columns(self, theta: Array, u: Array, y: Array, output: int) -> Array:
        """∂ŷ/∂θ of the free run, (N, n)."""
        x0 = self.fitted_state(theta, u, y, max(3 * self.n_states(theta), 1))
        return tangents(self, theta, [u], x0[:, None])[0][: len(theta), output].T

    # ----------------------------------------------------------------- words

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        table = self.parameters(inputs, outputs)
        values = ", ".join(
            f"{p.name} = {v:.5g} {p.unit}".rstrip() for p, v in zip(table, theta, strict=True)
        )
        return (self.traits.equation, values)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        p = self.unpack(np, np.asarray(theta))
        return {
            "stable": self.stable(theta),
            "constants": {
                k: np.ravel(v).tolist() if np.ndim(v) else float(v) for k, v in p.items()
            },
            "states": list(self.state_names),
            "substeps": self.steps,
        }


def constant_words(cls: type[GreyBox]) -> tuple[Mapping[str, str], ...]:
    """Name, meaning, unit and estimation of each constant of a grey box.

    Those of its largest form: two tracks where it knows them.
    """
    for channels in (2, 1):
        try:
            made = cls.from_orders({}, channels, channels)
        except UsageError:
            continue
        return made.described_constants()
    return ()


@readout.register
def _(s: GreyBox, theta: Array) -> Callable[[Array, Array], Array]:
    """y(k), which no step of the equations is needed for."""
    p = s.prepared(np, s.unpack(np, np.asarray(theta, dtype=np.float64)), s.h)

    def read(x: Array, u: Array) -> Array:
        xp: Any = x.__array_namespace__()
        y: Array = xp.asarray(s.reading(xp, x[:, None], p))[:, 0]
        return y

    return read


@time_constants.register
def _(s: GreyBox, theta: Array) -> Array:
    """``time_constants_s`` in samples; nothing before the sample time is known."""
    return s.time_constants_s(theta) / s.dt if s.dt > 0.0 else np.zeros(0)


def _substeps(text: str) -> int:
    if text == "auto":
        return 0
    number = whole(text)
    if number is None or not 1 <= number <= MAX_SUBSTEPS:
        raise UsageError(
            f"{argument(structure_options={'substeps': text})}: give a whole number from 1 to "
            f"{MAX_SUBSTEPS}, or auto"
        )
    return number
