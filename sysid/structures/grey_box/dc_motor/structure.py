"""The DC motor as a grey box: geared motors with dry friction, one or two on a common body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from sys import float_info
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, get_args

import numpy as np

from sysid.data.checks.integral import is_position
from sysid.data.record import Array, Channel, Record
from sysid.errors import UsageError
from sysid.runners.single import together
from sysid.structures.grey_box.dc_motor.constants import (
    OPTIONAL_EACH,
    bench,
    bench_guess,
    from_bench,
    lumped,
    shape,
)
from sysid.structures.grey_box.dc_motor.motion import STEPS, friction_constants, of_motors
from sysid.structures.grey_box.dc_motor.start import central_guesses
from sysid.structures.grey_box.dc_motor.torque import torque_source
from sysid.structures.grey_box.dc_motor.words import sentences
from sysid.structures.grey_box.physics import Constant, Physics, Rung, Signal
from sysid.structures.grey_box.structure import GreyBox, grey_box_traits
from sysid.structures.options import choice, number
from sysid.structures.traits import Traits
from sysid.vehicle.dry_friction import decay
from sysid.vehicle.motors import TorqueSource

Input = Literal["auto", "pwm", "voltage"]
Output = Literal["auto", "speed", "position"]
Integrator = Literal["exact", "rk4", "implicit"]
Friction = Literal["auto", "none", "coulomb", "stribeck", "full"]
Parametrisation = Literal["lumped", "bench"]

_CHOICES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "input": get_args(Input),
        "output": get_args(Output),
        "integrator": get_args(Integrator),
        "friction": get_args(Friction),
        "parameters": get_args(Parametrisation),
    }
)

_SHARED = ("breakaway", "stribeck", "limit")


OPTIONS: Mapping[str, str] = {
    "input": "pwm (µs, limited at full drive), voltage, or auto (default): pwm for columns "
    "called pwm…",
    "output": "measured output: speed, position, or auto (default): by the output's "
    "unit, or by whether it integrates the input",
    "friction": "none, coulomb, stribeck, full (with offset, asymmetry and drag), or auto "
    "(default): each mechanism only where held-out data pay for it",
    "parameters": "lumped (default: gain, time constant, Coulomb level …) or bench (R, "
    "Kem, Kc, gear, inertia fixed at the bench's values; masses and friction estimated)",
    "shared": "constants with one value for both tracks, divided by commas; "
    "breakaway,stribeck,limit unless given, or none",
    "torque_constant": "stall torque or force per unit of input, if known: the equations "
    "then name inertia and friction in physical units",
    "integrator": "exact (default: matrix exponential, friction implicit), rk4, or "
    "implicit (cheaper: a track stops at the end of a step)",
}


@dataclass(frozen=True)
class MotorPhysics(Physics):
    """Geared DC motors with dry friction that really sticks (thesis 2.53–2.61).

    In units of speed, for each track (one motor: no coupling; r: reverse over forward)

        T ω̇ = K (sat(u) − o) − ω − f(ω)       y = ω, or its integral
        |f| ≤ K c (1 + (k−1)/(1 + (ω/ω_s)²)) + q ω²      sliding: × r_c and + (r_v − 1)|ω| at ω < 0

    T holds the time constants and, off its diagonal, what the body's mass and yaw inertia carry
    from one track to the other. From commands and speeds alone, only these ratios are determined:
    R, K_em, K_c and inertias cannot. With ``parameters=bench`` the constants of the thesis's bench
    stand for them, those measured there held, the others estimated.

    Attributes:
        input: ``pwm`` [µs], ``voltage`` or ``auto``: by the input's name.
        output: ``speed``, ``position`` or ``auto``: by the output's unit, else by whether its
            measurements integrate the input.
        integrator: ``exact`` (linear part by matrix exponential, friction implicit, stops found
            inside a step), ``rk4``, or ``implicit`` (as exact, but stops at the end of a step).
        friction: ``auto`` adds mechanisms as held-out data pay for them; ``none``, ``coulomb``,
            ``stribeck`` and ``full`` fix them.
        parametrisation: ``lumped`` or ``bench``.
        shared: constants with one value for both tracks.
        torque_per_input: stall torque (or force) per unit of input, 0 when unknown.
    """

    input: Input = "auto"
    output: Output = "speed"
    integrator: Integrator = "exact"
    friction: Friction = "auto"
    parametrisation: Parametrisation = "lumped"
    shared: tuple[str, ...] = _SHARED
    torque_per_input: float = 0.0

    takes_floats: ClassVar[bool] = True

    @classmethod
    def from_options(cls, given: Mapping[str, str], nu: int, ny: int) -> Self:
        """A motor for each input, one or two of them."""
        if nu != ny or nu not in (1, 2):
            raise UsageError(
                f"dc-motor needs one motor (1 input, 1 output) or two tracks (2 and 2), got {nu} "
                f"inputs and {ny} outputs; choose columns with `inputs` and `outputs`"
            )
        settings: dict[str, Any] = {
            "parametrisation" if option == "parameters" else option: choice(given, option, words)
            for option, words in _CHOICES.items()
        }
        shared = given.get("shared")
        if shared is not None:
            names = () if shared == "none" else tuple(n.strip() for n in shared.split(","))
            for n in names:
                if n not in OPTIONAL_EACH:
                    known = ", ".join(OPTIONAL_EACH)
                    raise UsageError(
                        f"`structure_options['shared']`: {n!r} cannot be shared; choose of {known}"
                    )
            settings["shared"] = names
        settings["torque_per_input"] = number(
            given,
            "torque_constant",
            0.0,
            float_info.max,
            "the stall torque or force per unit of input, a number above 0",
        )
        return cls(nu, ny, **settings)

    # ----------------------------------------------------------------- constants and states

    @property
    def constants(self) -> tuple[Constant, ...]:
        """The lumped constants, or those of the bench, then the shape of friction."""
        return (
            *(bench(self) if self.parametrisation == "bench" else lumped(self)),
            *shape(self),
        )

    @property
    def state_names(self) -> tuple[str, ...]:
        tags = [""] if self.ny == 1 else ["_l", "_r"]
        speeds = tuple(f"omega{t}" for t in tags)
        return speeds + tuple(f"angle{t}" for t in tags if self.output == "position")

    def ladder(self) -> tuple[Rung, ...]:
        if self.friction != "auto":
            return ()
        return (
            Rung("constant load", ("offset",)),
            Rung("saturation of the drive", ("limit",)),
            Rung("breakaway and Stribeck friction", ("breakaway", "stribeck")),
            Rung("damping that depends on the direction", ("viscous_back",)),
            Rung("drag with the square of speed", ("drag",)),
        )

    def rung_starts(self, theta: Array, rung: Rung, records: Sequence[Record]) -> tuple[Array, ...]:
        """A limit inside the commands, a little more friction at standstill, a little drag."""
        p = self.unpack(np, theta)
        if "limit" in rung.names:
            reach = max(float(np.max(np.abs(r.u))) for r in records)
            return tuple(self.pack(p | {"limit": share * reach}) for share in (0.97, 0.85, 0.6))
        if "breakaway" in rung.names:
            typical = _stribeck_scale(records, self.output == "position")
            return tuple(
                self.pack(p | {"breakaway": 1.2, "stribeck": share * typical})
                for share in (0.3, 1.0, 5.0)
            )
        if "drag" in rung.names:
            typical = 10.0 * _stribeck_scale(records, self.output == "position")
            return (self.pack(p | {"drag": 0.02 / typical}),)
        return (theta,)

    def lacks(self, names: Sequence[str]) -> bool:
        """Whether constants of the shape of friction are held by default."""
        level = ("none", "coulomb", "stribeck", "full").index(
            "coulomb" if self.friction == "auto" else self.friction
        )
        rank = {"coulomb": 1, "breakaway": 2, "stribeck": 2}
        return any(rank.get(n, 3) > level for n in names)

    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        return x[self.ny :] if self.output == "position" else x[: self.ny]

    # ----------------------------------------------------------------- motion

    def advance(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: float) -> Signal:
        w = x[: self.ny]
        net = [
            gain * (xp.minimum(xp.maximum(v, -limit), limit) - offset)
            for v, (gain, limit, offset) in zip(u, p["drive"], strict=True)
        ]
        after = STEPS[self.integrator](xp, p, w, net, h)
        turned: Sequence[Signal] = ()
        if self.output == "position":
            moved = zip(x[self.ny :], w, after, strict=True)
            turned = [angle + 0.5 * h * (v + a) for angle, v, a in moved]
        return together(xp, [*after, *turned])

    def prepared(self, xp: Any, p: dict[str, Signal], h: Signal) -> Mapping[str, Signal]:
        """The motion, motor by motor, and what its linear part does in a substep."""
        q = self.motion(xp, p)
        return q | {
            "decay": decay(xp, q["inertia"], h),
            "drive": of_motors(q, ("gain", "limit", "offset"), self.ny),
            "friction": friction_constants(xp, q, self.ny),
        }

    def bare(self) -> Self:
        return replace(self, friction="auto", torque_per_input=0.0)

    def motion(self, xp: Any, p: Mapping[str, Signal]) -> dict[str, Signal]:
        """Gain, time constants, their coupling and Coulomb level [speed], with friction's shape."""
        q = dict(p)
        if self.parametrisation == "bench":
            q |= from_bench(self, xp, p)
        else:
            tau = xp.zeros((self.ny, 1)) + p["time_constant"]
            root = xp.sqrt(tau[0] * tau[-1])
            q["inertia"] = (tau, p["coupling"] * root if self.ny == 2 else 0.0)
            q["coulomb"] = q["gain"] * p["coulomb"]
        return q

    def time_constants(self, theta: Array) -> Array:
        """Those of the coupled motion; a position keeps what its first speed was wrong by."""
        inertia, cross = self.motion(np, self.unpack(np, theta))["inertia"]
        matrix = np.diag(inertia[:, 0]) + (np.fliplr(np.eye(2)) * cross if self.ny == 2 else 0.0)
        speeds = np.linalg.eigvalsh(matrix)
        return np.append(speeds, np.inf) if self.output == "position" else np.asarray(speeds)

    def stable(self, theta: Array) -> bool:
        """Whether speeds stay bounded: T positive definite; friction only dissipates.

        A position follows as the integral of a bounded speed.
        """
        p = self.unpack(np, theta)
        inertia, cross = self.motion(np, p)["inertia"]
        definite = bool(np.all(inertia > 0.0)) and (
            self.ny == 1 or float(np.prod(inertia) - np.sum(cross) ** 2) > 0.0
        )
        return definite and bool(np.all(p["viscous_back"] > 0.0)) and bool(np.all(p["drag"] >= 0.0))

    # ----------------------------------------------------------------- starts

    def for_record(self, record: Record) -> Self:
        structure = self
        if self.input == "auto":
            pwm = all(
                n.startswith("pwm") or c.unit == "µs"
                for n, c in zip(record.input_names, record.inputs, strict=True)
            )
            structure = replace(structure, input="pwm" if pwm else "voltage")
        if self.output == "auto":
            position = all(is_position([record], i) for i in range(record.ny))
            structure = replace(structure, output="position" if position else "speed")
        return structure

    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        """From differences of the outputs over several spans."""
        guesses = []
        for words, gain, tau, level, load in central_guesses(records, self.output == "position"):
            if self.parametrisation == "bench":
                p: dict[str, Any] = bench_guess(self, gain, level)
            else:
                p = {"gain": gain, "time_constant": tau, "coulomb": level}
                if "time_constant" in self.shared:
                    p["time_constant"] = np.array([np.exp(np.mean(np.log(tau)))])
            p["offset"] = np.mean(load) if "offset" in self.shared else load
            p["stribeck"] = _stribeck_scale(records, self.output == "position")
            guesses.append((words, self.pack(p)))
        if self.lacks(["breakaway"]):
            return tuple(guesses)
        # without extra friction at standstill its speed has no slope, and a search runs away
        extra = Rung("extra friction at standstill", ("breakaway", "stribeck"))
        return tuple((w, t) for w, g in guesses for t in self.rung_starts(g, extra, records))

    def state_guess(self, theta: Array, u: Array, y: Array, dt: float) -> Array:
        """First outputs; of positions also their slope over the head."""
        if self.output != "position":
            return np.array(y[0], dtype=np.float64)
        n = max(len(y) - 1, 1)
        t = np.arange(len(y)) - n / 2.0
        slope = t @ y / max(float(t @ t), 1.0) / max(dt, 1e-300)
        return np.concatenate([slope, y[0]])

    # ----------------------------------------------------------------- words

    def sentences(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The motion of each track with its numbers, and what follows for physical constants."""
        return sentences(self, theta, inputs, outputs)

    def properties(self, theta: Array) -> dict[str, Any]:
        """Lumped values, and the command at which each track starts to move."""
        q = self.motion(np, self.unpack(np, theta))
        inertia, cross = q["inertia"]
        level = np.ravel(q["coulomb"] / q["gain"])
        return {
            "gain": np.ravel(q["gain"]).tolist(),
            "time_constant": np.ravel(inertia).tolist(),
            "coupling_time": float(np.sum(cross)),
            "sliding_friction": level.tolist(),
            "breakaway_command": np.ravel(level[:, None] * q["breakaway"]).tolist(),
            "position": self.output == "position",
        }

    def torque_source(self, theta: Any) -> TorqueSource | None:
        """The motors, where their torques are known: of the bench, or by ``torque_constant``."""
        return torque_source(self, theta)

    def friction_entries(self) -> tuple[int, ...]:
        """Sliding friction; that at standstill counts in parts of it."""
        return tuple(self.entries("coulomb") or self.entries("friction_torque"))


class DCMotor(GreyBox[MotorPhysics]):
    """One geared motor, or two tracks on a body, as a structure."""

    name: ClassVar[str] = "dc-motor"
    traits: ClassVar[Traits] = grey_box_traits(
        title="DC motor: a grey box with friction, one motor or two tracks on a body",
        equation="T dω/dt = K (sat(u) - o) - ω - f(ω), f: Coulomb and Stribeck, sticks",
        when="motors driven by PWM or voltage whose speed or position is measured; physical "
        "parameters",
        options=OPTIONS,
    )
    physics_class: ClassVar[type[Physics]] = MotorPhysics


def _stribeck_scale(records: Sequence[Record], position: bool) -> float:
    """A tenth of the usual speed."""
    speeds = [np.diff(r.y, axis=0) / r.dt if position else r.y for r in records]
    typical = float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))
    return 0.1 * typical if typical > 0 else 1.0
