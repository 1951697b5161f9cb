"""A tracked vehicle in the plane, integrated finely: a judge that shares no line with the product.

Two tracks press evenly on the floor and rub it sideways with Coulomb friction μl; thrust follows
from slip by Janosi's law; rolling resistance brakes each track; the motors are resistances with
back-EMF, viscous and dry friction. Every sign is a slope up to a speed that is small against all
that matter; Runge-Kutta of order four in steps of 25 µs.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

jax.config.update("jax_enable_x64", True)

Array = NDArray[np.float64]

STEP = 2.5e-5
"""Step [s]: the stiffest part, rubbing at a crawl, has a time constant of half of that."""

CRAWL = 5e-5
"""Speed up to which friction is a slope [m/s]: what should stand creeps by less than that, 1 mrad/s
in a turn."""

SLOWEST = 5e-3
"""Floor of the track's speed in slip [m/s]: below, the steps would be too long for it."""

SLIGHT = 1e-6
"""Smallest yaw rate that the integrals along a track are divided by [rad/s]."""

G = 9.81


@dataclass(frozen=True)
class Truth:
    """A vehicle, its motors and its ground."""

    mass: float = 1.5
    yaw_inertia: float = 0.02
    rolling: float = 0.03
    lateral: float = 0.4
    friction: float = 0.7
    shear_modulus: float = 0.02
    r: float = 0.0215
    B: float = 0.186
    L: float = 0.14
    torque_per_volt: float = 0.0335329
    damping: float = 0.0107886
    inertia: float = 0.00144
    dry_friction: float = 0.00355896

    @property
    def thrust_stiffness(self) -> float:
        """Of one track at small slip [N]."""
        return self.mass * G / 2.0 * self.friction * self.L / (2.0 * self.shear_modulus)


def drawn(rng: np.random.Generator) -> Truth:
    """A vehicle and a floor between toy and small robot, by chance."""
    mass = float(rng.uniform(1.0, 4.0))
    return Truth(
        mass=mass,
        yaw_inertia=mass * float(rng.uniform(0.004, 0.02)),
        rolling=float(rng.uniform(0.015, 0.06)),
        lateral=float(rng.uniform(0.15, 0.5)),
        friction=float(rng.uniform(0.6, 0.9)),
        shear_modulus=float(np.exp(rng.uniform(np.log(0.004), np.log(0.03)))),
    )


def simulate(truths: Sequence[Truth], volts: Array, dt: float) -> tuple[Array, Array]:
    """Runs from rest, side by side.

    Args:
        truths: vehicles.
        volts: of each of them, held between instants, (runs, N, 2) [V].
        dt: time between instants [s].

    Returns:
        Speeds (runs, N, 2) [rad/s] and poses (runs, N, 3) at the instants, ψ not wrapped.
    """
    p = {f.name: jnp.array([asdict(t)[f.name] for t in truths]) for f in fields(Truth)}
    every = round(dt / STEP)

    def one(p: Any, u: Any) -> Any:
        def inner(s: Any, held: Any) -> Any:
            return jax.lax.fori_loop(0, every, lambda _, x: _rk4(x, held, p), s), s

        return jax.lax.scan(inner, jnp.zeros(8), u)[1]

    states = np.asarray(jax.jit(jax.vmap(one))(p, jnp.asarray(volts)))
    return states[:, :, :2], states[:, :, 5:]


def _rk4(s: Any, u: Any, p: Any) -> Any:
    a = _rates(s, u, p)
    b = _rates(s + 0.5 * STEP * a, u, p)
    c = _rates(s + 0.5 * STEP * b, u, p)
    d = _rates(s + STEP * c, u, p)
    return s + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def _rates(s: Any, u: Any, p: Any) -> Any:
    """Derivatives of ω_L, ω_R, v forward, v left, yaw rate, x, y, ψ."""
    omega, v, side, spin, psi = s[:2], s[2], s[3], s[4], s[7]
    load = p["mass"] * G / 2.0
    track = v + jnp.array([-0.5, 0.5]) * p["B"] * spin
    rim = p["r"] * omega
    # a point of the track slides for L/|rω| seconds at most: that is how far it shears the ground
    slip = (rim - track) / jnp.sqrt(rim**2 + SLOWEST**2)
    reach = jnp.abs(slip) * p["L"] / p["shear_modulus"]
    safe = jnp.maximum(reach, 1e-9)
    share = jnp.where(reach < 1e-6, 0.5 * reach, 1.0 + jnp.expm1(-safe) / safe)
    thrust = jnp.sign(slip) * load * p["friction"] * share
    resistance = p["rolling"] * load * jnp.clip(track / CRAWL, -1.0, 1.0)
    across, scrub = _rubbed(side, spin, 2.0 * p["lateral"] * load / p["L"], 0.5 * p["L"])
    torque = (
        p["torque_per_volt"] * u
        - p["damping"] * omega
        - p["dry_friction"] * jnp.clip(rim / CRAWL, -1.0, 1.0)
        - p["r"] * thrust
    )
    pull = thrust - resistance
    moment = 0.5 * p["B"] * (pull[1] - pull[0]) - scrub
    return jnp.concatenate(
        [
            torque / p["inertia"],
            jnp.array(
                [
                    jnp.sum(pull) / p["mass"] + spin * side,
                    -across / p["mass"] - spin * v,
                    moment / p["yaw_inertia"],
                    v * jnp.cos(psi) - side * jnp.sin(psi),
                    v * jnp.sin(psi) + side * jnp.cos(psi),
                    spin,
                ]
            ),
        ]
    )


def _rubbed(side: Any, spin: Any, q: Any, half: Any) -> tuple[Any, Any]:
    """Force and moment of ∫ q clip((v_y + ψ̇x)/c, −1, 1) dx and the same times x, −L/2 … L/2."""
    turn = jnp.where(spin >= 0.0, jnp.maximum(spin, SLIGHT), jnp.minimum(spin, -SLIGHT))

    def first(z: Any) -> Any:
        return jnp.where(jnp.abs(z) < CRAWL, 0.5 * z * z / CRAWL, jnp.abs(z) - 0.5 * CRAWL)

    def second(z: Any) -> Any:
        far = jnp.sign(z) * (0.5 * z * z - CRAWL**2 / 6.0)
        return jnp.where(jnp.abs(z) < CRAWL, z**3 / (3.0 * CRAWL), far)

    ahead, behind = side + turn * half, side - turn * half
    force = (first(ahead) - first(behind)) / turn
    moment = (second(ahead) - second(behind) - side * (first(ahead) - first(behind))) / turn**2
    return q * force, q * moment
