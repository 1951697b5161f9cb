"""Augmented: a linear core per track with named physical effects around it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, Index
from sysid.effects.base import FRICTION_BEFORE_LOADS, ORDER, Effect, Place, sides_of
from sysid.effects.catalogue import catalogue, effect, in_chain
from sysid.effects.compensation import Identified
from sysid.effects.ground import Ground
from sysid.effects.sensor import SAMPLING
from sysid.errors import ModelError
from sysid.fitting.problem import Parameter
from sysid.structures.augmented.chain import (
    ChainState,
    Core,
    Sample,
    first_speed,
    rest_state,
    share_before,
    step_with,
    with_constants,
)
from sysid.structures.augmented.given_base import GivenBase
from sysid.structures.base import Structure
from sysid.structures.motion import poles, time_constants
from sysid.structures.physics import friction_entries, ground_effects, identified_effects
from sysid.structures.special_runs import readout
from sysid.structures.traits import Traits

SLOPE = 1e-5
"""Relative shift of a parameter for its slope: the root of what rounding leaves of a long run."""

SMALLEST = 1e-3
"""Size below which a parameter is shifted as if it had that size."""


@dataclass(frozen=True)
class Augmented(Structure):
    """ω = core(T), T = K d around which the effects act; one command a track.

    Or one command of all tracks, whose effects they share; or several commands of one track: then
    T = K₁ d₁ + K₂ d₂ + …, the effects of a command act on each.

    θ stacks, track after track, K, f_1 … f_n, b_2 … b_n, then the gains of further commands, then
    effect after effect its parameters (those shared by all tracks once).

    Attributes:
        order: order n of the core.
        delay: input delay of the core [samples]; 0 where a reading is of the instant after its
            command has acted for a sample.
        scales: full drive of each command.
        dt: sample time [s].
        effects: ids in order of acceptance.
        given: a model of another structure that drives the core; None where the command does.
        chain: order of the chain in which the effects act (``in_chain``).
        outputs: number of outputs where it is not that of the commands; else 0.
        later: samples by which each of several commands of one output acts later than ``delay``;
            empty where none does.
    """

    name: ClassVar[str] = "augmented"
    traits: ClassVar[Traits] = Traits(
        title="Augmented: a linear core with named physical effects",
        equation="τ ω̇ = T − ω, T = K d, with the effects in their places",
        order_names=("n", "nk"),
        tells="gain and time constants, and each effect with its parameters",
        has_noise_model=False,
    )

    order: int
    delay: int
    scales: tuple[float, ...]
    dt: float
    effects: tuple[str, ...] = field(default=())
    given: GivenBase | None = field(default=None, compare=False)
    chain: int = ORDER
    outputs: int = 0
    later: tuple[int, ...] = ()

    @property
    def nu(self) -> int:
        return len(self.scales)

    @property
    def ny(self) -> int:
        return self.outputs or len(self.scales)

    @property
    def width(self) -> int:
        """Tracks of the chain: commands of one output, or outputs."""
        return max(self.nu, self.ny)

    @property
    def n_core(self) -> int:
        """Parameters of the cores."""
        return 2 * self.order * self.ny + self.width - self.ny

    def order_values(self) -> dict[str, Any]:
        return {"n": self.order, "nk": self.delay}

    def settings(self) -> dict[str, Any]:
        settings: dict[str, Any] = {
            "effects": list(self.effects),
            "scales": list(self.scales),
            "dt": self.dt,
            "chain": self.chain,
        } | ({"outputs": self.outputs} if self.outputs else {})
        settings |= {"later": list(self.later)} if self.later else {}
        return settings if self.given is None else {**settings, "given": self.given}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "Augmented":
        s = raw["settings"]
        for id in s["effects"]:
            effect(id)  # refuses what the catalogue does not know
        return cls(
            int(raw["orders"]["n"]),
            int(raw["orders"]["nk"]),
            tuple(float(v) for v in s["scales"]),
            float(s["dt"]),
            tuple(s["effects"]),
            GivenBase.from_json(s["given"]) if s.get("given") else None,
            _order(s.get("chain", FRICTION_BEFORE_LOADS)),
            int(s.get("outputs", 0)),
            tuple(int(v) for v in s.get("later", ())),
        )

    @cached_property
    def active(self) -> tuple[Effect, ...]:
        """The effects in the chain's order."""
        known = (*catalogue().values(), SAMPLING)
        beside = (Place.POSE, Place.SAMPLES)
        acting = (e for e in known if e.id in self.effects and e.place not in beside)
        return in_chain(acting, self.chain)

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names such as ``gain[omega_l]`` and ``dead-zone.plus[omega_l]``."""
        parameters = []
        for out in outputs:
            parameters.append(Parameter(f"gain[{out.name}]", out.unit))
            parameters += [Parameter(f"f{k + 1}[{out.name}]") for k in range(self.order)]
            parameters += [Parameter(f"b{k + 1}[{out.name}]") for k in range(1, self.order)]
        more = inputs[self.ny :]
        parameters += [Parameter(f"gain[{u.name}]", outputs[0].unit) for u in more]
        for id in self.effects:
            e = effect(id)
            sides = sides_of(e, self.nu, self.ny)
            channels = inputs if len(sides) > self.ny else outputs
            for tag in ("" if i < 0 else f"[{channels[i].name}]" for i in sides):
                parameters += [
                    Parameter(f"{id}.{p.name}{tag}", p.unit.replace("speed", outputs[0].unit))
                    for p in e.parameters
                ]
        return tuple(parameters)

    @property
    def n_effect_parameters(self) -> int:
        """Parameters of all effects, those of each track counted."""
        effects = [effect(id) for id in self.effects]
        return sum(len(e.parameters) * len(sides_of(e, self.nu, self.ny)) for e in effects)

    @cached_property
    def _indices(self) -> tuple[Index, Index, Index, dict[str, Index]]:
        """Entries of θ: K (tracks,), f (n, tracks), b₂ … (n − 1, tracks), effects by id."""
        tracks, n = self.width, self.order
        own = 2 * n * (np.arange(tracks) % self.ny)
        further = np.arange(self.ny, tracks)
        first = own.copy()
        first[self.ny :] = (2 * n - 1) * self.ny + further
        f = own + 1 + np.arange(n)[:, None]
        b = own + 1 + n + np.arange(n - 1)[:, None]
        at, effects = self.n_core, {}
        for id in self.effects:
            e = effect(id)
            width = len(e.parameters)
            sides = len(sides_of(e, self.nu, self.ny))
            offsets = width * (np.arange(tracks) % sides)
            effects[id] = at + np.arange(width)[:, None] + offsets
            at += width * sides
        return first, f, b, effects

    def unpack(self, theta: Array) -> tuple[Core, dict[str, dict[str, Array]]]:
        """θ (…, n) as a core and as each effect's parameters, one value a track: (…, tracks)."""
        xp: Any = theta.__array_namespace__()
        gain, f, b, effects = self._indices
        denominator, numerator = ([theta[..., row] for row in rows] for rows in (f, b))
        largest = 1.0 + sum(denominator) - sum(numerator, 0.0)
        parameters = {
            id: {p.name: theta[..., at[k]] for k, p in enumerate(effect(id).parameters)}
            for id, at in effects.items()
        }
        core = Core(theta[..., gain], xp.stack(denominator), xp.stack([largest, *numerator]))
        return core, parameters

    def n_states(self, theta: Array) -> int:
        """Core, effects, dead time, angles and clock, before them those of the given model."""
        rows = self.order + sum(e.memory.states for e in self.active) + self._waiting
        return self._given_states + self.width * (rows + 2) + 1

    @property
    def _waiting(self) -> int:
        """Rows of commands that wait before they act."""
        return max(self.delay - 1 + max(self.later, default=0), 0)

    @property
    def _given_states(self) -> int:
        return 0 if self.given is None else self.given.n_states()

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """Steady motion at the first measured speed; only a given model uses a longer head."""
        core, parameters = self.unpack(theta)
        w = np.zeros(self.width)
        if len(y):
            w = first_speed(self.active, parameters, y[0] + 0.0 * w)
        drive = u[0] / np.array(self.scales) + 0.0 * w if len(u) else None
        head = np.zeros(0)
        if self.given is not None:
            head = self.given.fitted_state(u, y, samples)
            drive = self.given.step()(head, u[0])[1] if len(u) else None
        before = np.zeros(self.width)
        if drive is not None:
            commands = np.broadcast_to(u / np.array(self.scales), (len(u), self.width))
            share = share_before(commands, y) if len(y) else np.ones(self.width)
            drive, before = share * drive, share * commands[0]
        state = rest_state(np, self.active, core, w, drive)
        line = [before] * self._waiting
        zeros = np.zeros(self.width)
        return np.concatenate([head, _flat(np, state, line, np.zeros(1), (zeros, zeros))])

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        x = np.zeros(self.n_states(theta)) if x0 is None else x0
        return np.asarray(self.simulate_many(theta[None], u, x[None])[0])

    def simulate_many(self, thetas: Array, u: Array, states: Array) -> Array:
        """Free runs side by side, one step of all of them at a time; (L, N, tracks).

        Args:
            thetas: parameters of each run, (L, n).
            u: commands of all runs, (N, nu).
            states: initial states, (L, n_states); those of the given model are alike.
        """
        n_given = self._given_states
        step, x = self._chain(thetas), states[:, n_given:]
        out = np.zeros((len(thetas), len(u), self.ny))
        shape = (len(thetas), self.width)
        drives = self._drive(u, states[0, :n_given])
        if self.delay == 0 and len(u):
            x, _ = step(x, np.broadcast_to(drives[0], shape))
            drives = np.vstack([drives[1:], drives[-1:]])
        for k, drive in enumerate(drives):
            x, y = step(x, np.broadcast_to(drive, shape))
            out[:, k] = y[:, : self.ny]
        return out

    def _drive(self, u: Array, head: Array) -> Array:
        """What drives the chain: the commands, or what the given model makes of them."""
        if self.given is None:
            return np.asarray(u / np.array(self.scales))
        base, drive = self.given.step(), np.zeros((len(u), self.ny))
        for k in range(len(u)):
            head, drive[k] = base(head, u[k])
        return drive

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        chain, scales, n_given = self._chain(theta), np.array(self.scales), self._given_states
        base = None if self.given is None else self.given.step()

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            head, drive = (x[:0], u / scales) if base is None else base(x[:n_given], u)
            if len(scales) < self.width:
                drive = xp.concatenate([drive] * self.width)
            following, y = chain(x[n_given:], drive)
            if self.delay == 0:  # the reading that the next row would begin with
                _, y = chain(following, drive)
            return xp.concatenate([head, following]), y[: self.ny]

        return advance

    def _chain(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x (…, n), drive (…, tracks)) → (x⁺, y) of the chain alone, its θ (…, n)."""
        core, parameters = self.unpack(theta)
        active, dt = self.active, self.dt
        whole = with_constants(theta.__array_namespace__(), active, core, parameters, dt)

        def advance(x: Array, drive: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            state, line, clock, angles = self._unflat(xp, x)
            line = [*line, drive]
            speed, acts = state[0][0], line[0]
            if self.later:
                at = [line[max(self.later) - d][..., i : i + 1] for i, d in enumerate(self.later)]
                acts = xp.concatenate(at, axis=-1)
            sample = Sample(acts, acts, clock, *angles)
            state, y = step_with(xp, active, core, whole, state, sample, dt, self.width > self.ny)
            turned = angles[0] + 0.5 * dt * (speed + state[0][0])
            return _flat(xp, state, line[1:], clock + dt, (turned, angles[1] + dt * y)), y

        return advance

    def _unflat(
        self, xp: Any, x: Array
    ) -> tuple[ChainState, list[Array], Array, tuple[Array, Array]]:
        """Core and effects, delayed commands, clock, angles; undoes ``_flat``."""
        tracks, n = self.width, self.order
        count = n + sum(e.memory.states for e in self.active) + self._waiting
        rows = [x[..., k * tracks : (k + 1) * tracks] for k in range(count)]
        clock, angles = x[..., count * tracks], x[..., count * tracks + 1 :]
        effect_states, at = [], n
        for e in self.active:
            effect_states.append(tuple(rows[at : at + e.memory.states]))
            at += e.memory.states
        state = (xp.stack(rows[:n]), tuple(effect_states))
        return state, rows[at:], clock[..., None], (angles[..., :tracks], angles[..., tracks:])

    def stable(self, theta: Array) -> bool:
        """Whether core and given model are stable; effects only dissipate or bound."""
        base = self.given
        if not np.all(np.isfinite(theta)) or np.any(np.abs(poles(self, theta)) >= 1.0):
            return False
        return base is None or base.structure.stable(base.theta)

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        """∂ŷ/∂θ by central differences, every run beside the others, (ny, N, n)."""
        x0 = self.fitted_state(theta, u, y, 1)
        h = SLOPE * np.maximum(np.abs(theta), SMALLEST)
        shifted = np.concatenate([theta + np.diag(h), theta - np.diag(h)])
        runs = self.simulate_many(shifted, u, np.repeat(x0[None], len(shifted), axis=0))
        change = runs[: len(theta)] - runs[len(theta) :]
        return np.asarray((change / (2.0 * h)[:, None, None]).T)

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The core of each track, then each effect with its parameters."""
        core, parameters = self.unpack(theta)
        lines = []
        for i, y in enumerate(outputs):
            own = range(self.nu) if self.width > self.ny else [min(i, self.nu - 1)]
            torque = " + ".join(
                f"{core.gain[max(i, j)]:.5g}·{inputs[j].name}/{self.scales[j]:g}" for j in own
            )
            if self.order == 1:
                tau = -self.dt / np.log(max(-core.f[0, i], 1e-12))
                lines.append(f"{tau:.4g} s·d{y.name}/dt = T - {y.name}, T = {torque}")
            else:
                lines.append(f"{y.name} = core of order {self.order}, gain {core.gain[i]:.5g}")
        for id in self.effects:
            e = effect(id)
            values_text = ", ".join(
                f"{name} = {value:.4g}"
                for p in e.parameters
                for name, value in _named(
                    p.name, parameters[id][p.name], sides_of(e, self.nu, self.ny), inputs, outputs
                )
                if value != p.null
            )
            lines.append(
                f"{id}: {e.texts.equation}" + (f" with {values_text}" if values_text else "")
            )
        return tuple(lines)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        core, parameters = self.unpack(theta)
        return {
            "stable": self.stable(theta),
            "gain": core.gain.tolist(),
            "effects": {
                id: {k: v.tolist() for k, v in values.items()} for id, values in parameters.items()
            },
        }


@ground_effects.register
def _(s: Augmented, theta: Array) -> Ground:
    """The effects of the vehicle, which the chain leaves to those who move it."""
    _, values = s.unpack(theta)
    ids = [id for id in s.effects if effect(id).place is Place.POSE]
    return Ground(tuple(ids), {id: values[id] for id in ids})


@identified_effects.register
def _(s: Augmented, theta: Array) -> Identified:
    """The effects of command and torque; none where another model drives the chain."""
    if (
        s.given is not None or s.nu != s.ny
    ):  # its outputs, not the commands, are what the effects act on
        return Identified()
    core, values = s.unpack(theta)
    ids = [e.id for e in s.active if e.place in (Place.COMMAND, Place.TORQUE)]
    parameters = {id: values[id] for id in ids}
    return Identified(tuple(ids), parameters, core.gain, np.array(s.scales), s.chain)


@friction_entries.register
def _(s: Augmented) -> tuple[int, ...]:
    """The parameters with which an effect holds a track at standstill."""
    entries: list[int] = []
    for e in s.active:
        for k, p in enumerate(e.parameters if e.holds else ()):
            alone = {q.name: float(q.name == p.name) for q in e.parameters}
            if e.holds is not None and e.holds(alone):
                entries += sorted(set(s._indices[3][e.id][k].tolist()))
    return tuple(entries)


@readout.register
def _(s: Augmented, theta: Array) -> Callable[[Array, Array], Array]:
    """The speeds in the state, which the reading is unless an effect changes it."""
    if any(e.place is Place.READING for e in s.active):
        step = s.step(theta)
        return lambda x, u: step(x, u)[1]
    n_given, tracks = s._given_states, s.ny
    return lambda x, u: x[n_given : n_given + tracks]


@poles.register
def _(s: Augmented, theta: Array) -> NDArray[np.complex128]:
    core, _ = s.unpack(theta)
    roots = [np.roots([1.0, *core.f[:, i]]) for i in range(s.ny)]
    return np.concatenate([np.zeros(0), *roots]).astype(np.complex128)


@time_constants.register
def _(s: Augmented, theta: Array) -> Array:
    of_core, base = time_constants.dispatch(Structure)(s, theta), s.given
    if base is None:
        return of_core
    return np.concatenate([of_core, time_constants(base.structure, base.theta)])


def _order(stored: int) -> int:
    if not FRICTION_BEFORE_LOADS <= stored <= ORDER:
        raise ModelError(
            f"the model has effects in order {stored} of the chain, this version knows orders up "
            f"to {ORDER}: read it with the version that wrote it"
        )
    return stored


def _named(
    name: str,
    values: Array,
    sides: Sequence[int],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> list[tuple[str, float]]:
    """Every value beside the name of its channel; a value that all share stands once."""
    if len(sides) == 1:
        return [(name, float(values[0]))]
    channels = inputs if len(sides) > len(outputs) else outputs
    return [(f"{name}[{c.name}]", float(v)) for c, v in zip(channels, values, strict=True)]


def _flat(
    xp: Any, state: ChainState, line: Sequence[Array], clock: Array, angles: tuple[Array, Array]
) -> Array:
    """State as one vector (…, n): core, effects, delayed commands, clock (…, 1), angles."""
    effect_states = (s for states in state[1] for s in states)
    flat: Array = xp.concatenate([*state[0], *effect_states, *line, clock, *angles], axis=-1)
    return flat
