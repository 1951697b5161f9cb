"""Grey boxes: an ODE or difference equation whose parameters are physical constants.

A grey box is one class of about forty lines, its ``Physics``: constants, right-hand side and what
is read from its state. Free runs, derivatives, multi-start, standard errors, saving, exports and
plots follow from these. ``sysid/structures/grey_box/tanks.py`` is a complete example; other
packages register theirs under the entry-point group ``sysid.structures``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.data.schema import checked
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.runners import floats
from sysid.runners.single import in_floats
from sysid.structures.base import NamedStructure, refuse_options
from sysid.structures.grey_box.physics import MAX_SUBSTEPS, Physics, Sampling
from sysid.structures.grey_box.runs import fitted_state, stays_bounded, tangents, trajectory
from sysid.structures.motion import time_constants
from sysid.structures.options import whole_number
from sysid.structures.physics import friction_entries, torques
from sysid.structures.special_runs import readout
from sysid.structures.traits import Traits
from sysid.vehicle.motors import TorqueSource

OPTIONS: Mapping[str, str] = {
    "substeps": "integration steps in a sample; chosen from the time constants unless given",
    "free": "constants to estimate that are fixed by default, separated by commas",
}
"""Options of every grey box."""

P = TypeVar("P", bound=Physics)


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
class GreyBox(NamedStructure, Generic[P]):
    """A structure made of physics: ẋ = f(x, u, p), y = g(x, p).

    Subclasses give their name, traits and the class of their physics.

    Attributes:
        largest: numbers of channels with which it may show its largest form.
        physics: the equation.
        sampling: read off the data.
        opened: constants that are estimated although they are held by default.
    """

    physics_class: ClassVar[type[Physics]]
    largest: ClassVar[tuple[tuple[int, int], ...]] = ((2, 2), (1, 1))

    physics: P
    sampling: Sampling = field(default_factory=Sampling)
    opened: tuple[str, ...] = ()

    @property
    def nu(self) -> int:
        return self.physics.nu

    @property
    def ny(self) -> int:
        return self.physics.ny

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of the constants; those held by default are fixed."""
        parameters = []
        unit_u, unit_y = inputs[0].unit or "u", outputs[0].unit or "y"
        for c in self.physics.constants:
            unit = c.unit.replace("{u}", unit_u).replace("{y}", unit_y)
            fixed = None if c.free or c.name in self.opened else c.value
            for output in outputs if c.each else outputs[:1]:
                tag = f"[{output.name}]" if c.each and len(outputs) > 1 else ""
                parameters.append(Parameter(c.name + tag, unit, c.lower, c.upper, fixed))
        return tuple(parameters)

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with these options; grey boxes have no orders."""
        refuse_options(cls.name, options, tuple(cls.traits.options))
        if raw:
            raise UsageError(
                f"`orders`: {cls.name} is a physical model and has no orders; omit `orders`"
            )
        given = dict(options or {})
        sampling = Sampling(
            substeps=whole_number(given, "substeps", 1, MAX_SUBSTEPS, cls.name) or 0
        )
        opened = tuple(n.strip() for n in given.get("free", "").split(",") if n.strip())
        physics: Any = cls.physics_for(given, nu, ny)
        known = [c.name for c in physics.constants]
        for name in opened:
            if name not in known:
                raise UsageError(
                    f"`structure_options['free']`: {cls.name} has no constant {name!r}; it has "
                    f"{', '.join(known)}"
                )
        return cls(physics, sampling, opened)

    @classmethod
    def physics_for(cls, given: Mapping[str, str], nu: int, ny: int) -> Physics:
        """The physics with these options, for so many channels."""
        return cls.physics_class.from_options(given, nu, ny)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        return ({},)

    def order_values(self) -> dict[str, Any]:
        return {}

    def settings(self) -> dict[str, Any]:
        """Every field besides the numbers of channels."""
        settings = {**asdict(self.sampling), "opened": self.opened, **asdict(self.physics)}
        return {
            k: list(v) if isinstance(v, tuple) else v
            for k, v in settings.items()
            if k not in ("nu", "ny")
        }

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        nu, ny = raw["nu"], raw["ny"]
        cls.physics_class.from_options({}, nu, ny)  # refuses channels that it cannot have
        settings = dict(raw["settings"])
        opened = tuple(settings.pop("opened", ()))
        sampling = {f.name: settings.pop(f.name) for f in fields(Sampling) if f.name in settings}
        physics: Any = checked(cls.physics_class, {**settings, "nu": nu, "ny": ny})
        return cls(physics, checked(Sampling, sampling), opened)

    def n_states(self, theta: Array) -> int:
        return len(self.physics.state_names)

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State that meets the first ``samples`` of y best, near ``Physics.state_guess``."""
        return fitted_state(self, theta, u, y, samples)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        x = np.zeros(self.n_states(theta)) if x0 is None else x0
        return trajectory(self, theta, [u], x[:, None])[1][0]

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """The free run sample by sample: the same equations as the compiled runs."""
        own: Any = theta.__array_namespace__()
        physics, h, steps = self.physics, self.sampling.h, self.sampling.steps
        p = physics.prepared(own, physics.unpack(own, theta), h)
        plain = in_floats(p) if physics.takes_floats and own is np else None

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__() if own is np else own
            if xp is np and plain is not None:
                now = x.tolist()
                moved = physics.sample(floats, now, u.tolist(), plain, h, steps)
                return np.array(moved), np.array(physics.reading(floats, now, plain))
            state, command = x[:, None], u[:, None]
            y = xp.asarray(physics.reading(xp, state, p))
            after = xp.asarray(physics.sample(xp, state, command, p, h, steps))
            return after[:, 0], y[:, 0]

        return advance

    def stable(self, theta: Array) -> bool:
        """Whether a long run stays finite and grows no faster than an integral would.

        Where the physics do not say it, judged by runs from rest under inputs that fill the range
        of the data (±1 when there are none): random two-level inputs, fast and slow, and its two
        ends held.
        """
        if not np.all(np.isfinite(theta)):
            return False
        known = self.physics.stable(theta)
        return stays_bounded(self, theta) if known is None else known

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        x0 = self.fitted_state(theta, u, y, max(3 * self.n_states(theta), 1))
        return tangents(self, theta, [u], x0[:, None])[0][: len(theta)].transpose(1, 2, 0)

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """Those of the physics, else the equation and the constants."""
        table = self.parameters(inputs, outputs)
        values = ", ".join(
            f"{p.name} = {v:.5g} {p.unit}".rstrip() for p, v in zip(table, theta, strict=True)
        )
        own = self.physics.sentences(np.asarray(theta), inputs, outputs)
        return own or (self.traits.equation, values)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        p = self.physics.unpack(np, np.asarray(theta))
        constants = {k: np.ravel(v).tolist() if np.ndim(v) else float(v) for k, v in p.items()}
        return {
            "stable": self.stable(theta),
            "constants": constants,
            "states": list(self.physics.state_names),
            "substeps": self.sampling.steps,
            **self.physics.properties(np.asarray(theta)),
        }


def read_off(s: GreyBox[P], records: Sequence[Record]) -> GreyBox[P]:
    """The same grey box with what it reads off records: channels, sample time, range of inputs."""
    u = np.concatenate([r.u for r in records])
    ends = tuple(zip(u.min(axis=0).tolist(), u.max(axis=0).tolist(), strict=True))
    sampling = replace(s.sampling, dt=records[0].dt, input_range=ends)
    return replace(s, physics=s.physics.for_record(records[0]), sampling=sampling)


def constant_words(cls: type[GreyBox[Any]]) -> tuple[Mapping[str, str], ...]:
    """Name, meaning, unit and estimation of each constant of a grey box.

    Those of its largest form: two tracks where it knows them.
    """
    for channels in cls.largest:
        try:
            physics = cls.physics_for({}, *channels)
        except UsageError:
            continue
        tried = {name for rung in physics.ladder() for name in rung.names}
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
            for c in physics.constants
        )
    return ()


@readout.register
def _(s: GreyBox, theta: Array) -> Callable[[Array, Array], Array]:  # type: ignore[type-arg]
    """y(k), which no step of the equations is needed for."""
    physics = s.physics
    p = physics.prepared(np, physics.unpack(np, theta), s.sampling.h)

    def read(x: Array, u: Array) -> Array:
        xp: Any = x.__array_namespace__()
        y: Array = xp.asarray(physics.reading(xp, x[:, None], p))[:, 0]
        return y

    return read


@time_constants.register
def _(s: GreyBox, theta: Array) -> Array:  # type: ignore[type-arg]
    """``Physics.time_constants`` in samples; nothing before the sample time is known."""
    dt = s.sampling.dt
    return s.physics.time_constants(theta) / dt if dt > 0.0 else np.zeros(0)


@torques.register
def _(s: GreyBox, theta: Array) -> TorqueSource | None:  # type: ignore[type-arg]
    source: TorqueSource | None = s.physics.torque_source(theta)
    return source


@friction_entries.register
def _(s: GreyBox) -> tuple[int, ...]:  # type: ignore[type-arg]
    entries: tuple[int, ...] = s.physics.friction_entries()
    return entries
