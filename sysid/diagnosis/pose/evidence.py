"""Evidence for an effect in increments of the pose, whose noise is known; and the validation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.gap import ChannelGap, Gap, interval_of_closed
from sysid.diagnosis.policies import POSE
from sysid.diagnosis.search.evidence import Evidence
from sysid.effects.ground import Ground
from sysid.fitting.holdout import Errors
from sysid.robot.calibration.ground_fit import Candidate, Fitted, PoseProblem, PoseSearch
from sysid.robot.calibration.windows import CHANNELS, OVERLAP


def evidence_of(before: Fitted, after: Fitted, tried: int) -> Evidence:
    """Evidence for the parameters that ``after`` has in addition, unlike ``search.evidence``:

    The noise of an increment is known, and an effect may show in the few windows of one turn. So G,
    the fall of the white squared error over both parts, is χ² with one degree of freedom without an
    effect; its root is t, with as many degrees of freedom as windows without overlap. Blocks and
    held-out error count only the windows and channels that the effect moves.
    """
    from scipy.special import stdtr

    new, white = len(after.free) - len(before.free), _pairs(before.white, after.white)
    n = sum(a.size for a, _ in white)
    gain = sum(float(np.sum(a**2) - np.sum(b**2)) for a, b in white) / max(after.cost, 1.0)
    t = math.sqrt(max(gain, 0.0))
    freedom = max(n / (len(CHANNELS) * OVERLAP) - new, 1.0)
    pairs, falls, held_out = (
        _of_moved_channels(_pairs(before.errors, after.errors)),
        [],
        np.zeros(2),
    )
    for i, (pair, touched) in enumerate(zip(pairs, _touched(pairs), strict=True)):
        x, y = ((e[touched] ** 2).sum(axis=1) for e in pair)
        falls += [float(np.sum((x - y)[k : k + OVERLAP])) for k in range(0, len(x), OVERLAP)]
        if i >= len(before.errors.estimation):
            held_out += x.sum(), y.sum()
    return Evidence(
        delta_bic=new * math.log(n) - gain,
        t=t,
        share_better=float(np.mean(np.array(falls) > 0)) if falls else 0.0,
        ratio=math.sqrt(held_out[1] / held_out[0]) if held_out[0] > 0 else 1.0,
        p_value=min(1.0, 2.0 * float(stdtr(freedom, -t)) * tried),
    )


def apart(best: Fitted, other: Fitted) -> float:
    """Standard errors by which rivals differ: D/(2 σ ‖d‖) of what they predict differently, d.

    D is how much larger the other's squared error is; with the best model true it has the mean
    ‖d‖² and the standard deviation 2 σ ‖d‖ (Vuong 1989, for known noise).
    """
    pairs = _pairs(best.white, other.white)
    more = sum(float(np.sum(b**2) - np.sum(a**2)) for a, b in pairs)
    apart = sum(float(np.sum((a - b) ** 2)) for a, b in pairs)
    return more / (2.0 * math.sqrt(max(best.cost, 1.0) * apart) + 1e-300)


def _of_moved_channels(pairs: Sequence[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """The channels that are moved by a share of what the most moved one is."""
    size = np.sqrt(sum(np.sum((a - b) ** 2, axis=0) for a, b in pairs))
    at = size >= POSE.touched * np.max(size)
    return [(a[:, at], b[:, at]) for a, b in pairs]


def _pairs(before: Errors, after: Errors) -> list[tuple[Array, Array]]:
    old, now = (*before.estimation, *before.holdout), (*after.estimation, *after.holdout)
    return list(zip(old, now, strict=True))


FEW_TOUCHED = 2 * OVERLAP
"""Fewer held-out windows that the effects move prove little: both parts then judge each other."""


def holdout_pairs(search: PoseSearch, keys: Sequence[Candidate]) -> list[tuple[Array, Array]]:
    """Errors of windows before and after, each judged by parameters that were not fitted on it.

    The held-out windows; where the effects move too few of them, those of the estimation part,
    too, with parameters fitted on the held-out part.
    """
    before, after = search.fit(()), search.fit(keys)
    pairs = list(zip(before.errors.holdout, after.errors.holdout, strict=True))
    if sum(int(t.sum()) for t in _touched(pairs)) >= FEW_TOUCHED:
        return pairs
    turned = replace(search, estimation=search.holdout, holdout=search.estimation)
    before, after = turned.fit(()), turned.fit(keys)
    return pairs + list(zip(before.errors.holdout, after.errors.holdout, strict=True))


def _touched(pairs: Sequence[tuple[Array, Array]]) -> list[NDArray[np.bool_]]:
    """Windows that an effect moves by a share of the largest move, in units of the floor, (W,)."""
    moved = [np.linalg.norm(a - b, axis=1) for a, b in pairs]
    most = max(float(m.max()) for m in moved)
    return [m >= POSE.touched * most for m in moved]


def pose_gap(pairs: Sequence[tuple[Array, Array]], floor: Array, seed: int = 0) -> Gap:
    """Errors beyond the noise, in units of it.

    The interval is a bootstrap over groups of windows that overlap.

    Args:
        floor: noise of the increments, (3,).
    """
    old, new = (np.concatenate([p[i] for p in pairs]) for i in (0, 1))
    each = np.column_stack([np.sum(e**2 - 1.0, axis=1) for e in (old, new)])
    excess = np.add.reduceat(each, np.arange(0, len(each), OVERLAP))
    before, after = (excess.sum(axis=0) / len(old)).tolist()
    rms = [np.sqrt(np.mean(e**2, axis=0)) * floor for e in (old, new)]
    return Gap(
        before=max(before, 0.0),
        after=after,
        noise_floor=float(len(CHANNELS)),
        closed_percent=100.0 * (1.0 - max(after, 0.0) / before) if before > 0 else 0.0,
        interval=interval_of_closed(excess, seed),
        channels={
            name: ChannelGap(float(rms[0][i]), float(rms[1][i]), float(floor[i]))
            for i, name in enumerate(CHANNELS)
        },
    )


@dataclass(frozen=True)
class PoseResiduals:
    """What increments of the pose are off by with the augmented model.

    Attributes:
        above_noise: channels off by several times their noise, and how many.
        share: share of the held-out squared error of these that distance, turn and heading predict.
    """

    above_noise: dict[str, float]
    share: float

    @property
    def structured(self) -> bool:
        """Whether something is missing."""
        return self.share > POSE.min_predicted_share

    @property
    def sentence(self) -> str:
        """What it means, empty where the pose is off by little."""
        if not self.above_noise:
            return ""
        size = ", ".join(f"{name} {ratio:.1f} times" for name, ratio in self.above_noise.items())
        seen = f"Over two seconds the pose error is far above its noise ({size})"
        if self.structured:
            return (
                f"{seen}. Distance, turn and heading predict {100 * self.share:.0f} % of it: "
                "something between robot and ground is missing from the catalogue."
            )
        return (
            f"{seen}. Distance, turn and heading do not predict it: pose or speeds are disturbed."
        )


def pose_residuals(search: PoseSearch, final: Fitted) -> PoseResiduals:
    """Regress what is left on way, turn and heading: fitted on one part, judged on the other."""
    holdout = np.concatenate(final.errors.holdout)
    size = np.sqrt(np.mean(holdout**2, axis=0))
    at = np.flatnonzero(size > POSE.residual_to_noise)
    above_noise = {CHANNELS[i]: float(size[i]) for i in at}
    if not len(at):
        return PoseResiduals({}, 0.0)
    X, Z = (_known(problem) for problem in (search.estimation, search.holdout))
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
    X, Z, Y = X / scale, Z / scale, np.concatenate(final.errors.estimation)
    gram = X.T @ X + 1e-2 * len(X) * np.eye(X.shape[1])
    rest = holdout - Z @ np.linalg.solve(gram, X.T @ Y)
    old, new = np.sum(holdout[:, at] ** 2, axis=0), np.sum(rest[:, at] ** 2, axis=0)
    return PoseResiduals(above_noise, float(np.clip(np.max(1.0 - new / old), 0.0, 1.0)))


def _known(problem: PoseProblem) -> Array:
    """Way f, turn, their products, and the heading at both ends of every window, (W, terms)."""
    rows = []
    for track in problem.tracks:
        f, _, turn = track.predicted(Ground(), problem.geometry).T
        a = track.pose[track.starts, 2]
        b = track.pose[track.starts + track.span, 2]
        plain = (np.ones(len(f)), f, turn, np.abs(turn), np.abs(f), f * np.abs(f), f * turn)
        rows.append(np.column_stack([*plain, np.cos(a), np.sin(a), np.cos(b), np.sin(b)]))
    return np.concatenate(rows)
