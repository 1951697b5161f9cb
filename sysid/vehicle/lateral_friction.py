"""Lateral friction of tracks: force and moment together.

Every point of a track at x along the vehicle slides sideways at v_y + ψ̇x, and Coulomb's friction
opposes it with q per metre, of all tracks together. Summed over −L/2 … L/2, with the instantaneous
centre at x_ICR = −v_y/ψ̇ between the ends,

    F_y = −sign(ψ̇)·2q x_ICR        M_r = sign(ψ̇)·q (L²/4 − x_ICR²)

taken from the motion, which is (2.35) and (2.36) with q = μl mg/L (there 4μl(mg/2L) and
2μl(mg/2L)), and M_r = μl W L/4 at x_ICR = 0 (Wong). Beyond the ends the whole length slides one
way: |F_y| = qL, M_r = 0. The pairs (F_y, M_r) that friction can take fill the lens between the
two parabolas |M_r| ≤ q (L²/4 − (F_y/2q)²); on its edge it slides (as
:mod:`sysid.vehicle.ground.resistance` has it), inside it sticks.
"""

from typing import Any, NamedTuple

from sysid.vehicle.kinematics import Real

NEWTON_STEPS = 6
"""From the end of the track to the root of a convex cubic: digits double from the second on."""


class Taken(NamedTuple):
    """What lateral friction takes from the motion.

    Attributes:
        side: force against v_y [N].
        turning: moment against ψ̇ [Nm].
        sticks: whether it could take more.
    """

    side: Real
    turning: Real
    sticks: Real


def nearest(
    wanted: tuple[Real, Real], q: Real, half: Real, ease: tuple[Real, Real], xp: Any
) -> Taken:
    """What friction takes where ``wanted`` would stop all motion: the nearest point of the lens.

    Nearest in the metric of the motion that is left, w₁ΔF² + w₂ΔM², which makes the outcome
    Coulomb's law: on the edge the motion that is left has its centre where the edge says so.

    Args:
        wanted: force [N] and moment [Nm].
        q: friction per metre of length, both tracks together [N/m].
        half: L/2 [m].
        ease: w₁, w₂: motion that a unit of each changes, 1/m and 1/J.
    """
    force, moment = xp.abs(wanted[0]), xp.abs(wanted[1])
    q = xp.maximum(q, 1e-12)  # no friction at all takes nothing: the lens is a point
    reach = 0.5 * force / q
    inside = (reach < half) & (moment < q * (half * half - reach * reach))
    # Edge point (2qa, q(L²/4 − a²)): a³ + αa = β where the distance is smallest. β ≥ 0, and from
    # the end of the track Newton's steps come down to the root monotonically.
    ratio = ease[0] / ease[1]
    alpha = 2.0 * ratio + moment / q - half * half
    beta = ratio * force / q
    a = half
    for _ in range(NEWTON_STEPS):
        a = (2.0 * a * a * a + beta) / (3.0 * a * a + alpha)
    a = xp.minimum(a, half)
    side = xp.where(inside, force, 2.0 * q * a)
    turning = xp.where(inside, moment, q * (half * half - a * a))
    return Taken(xp.sign(wanted[0]) * side, xp.sign(wanted[1]) * turning, inside)
