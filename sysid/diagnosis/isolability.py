"""What a log can distinguish: the angles between the signatures of effects, before any is fitted.

The signature of an effect is what it changes of the base's free run at a usual size, what the base
could follow projected out (``search/screen.py``), in units of the noise. Its length says whether
the effect would show. Of two effects the part of one signature that the best size of the other
cannot imitate says whether they could be distinguished: where it does not show, a diagnosis can
only name both as one entry (Isermann 2006, §17; Gertler 1998, §2.6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base, fit_baseline
from sysid.diagnosis.long_logs import searched_on
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import needed_power
from sysid.diagnosis.search.screen import screened
from sysid.diagnosis.search.starts import starts_of
from sysid.diagnosis.session import noise_of
from sysid.effects.base import Effect
from sysid.effects.catalogue import NOT_NAMED, about, chain_effects


@dataclass(frozen=True)
class OneEntry:
    """Two effects that the log could not distinguish.

    Attributes:
        angle: between their signatures [deg].
        experiment: commands that open it, in words.
    """

    effects: tuple[str, str]
    angle: float
    experiment: str

    @property
    def sentence(self) -> str:
        """Which two would be one entry, and what opens the angle."""
        a, b = self.effects
        experiment = self.experiment[:1].upper() + self.experiment[1:].rstrip(".")
        return f"{a} and {b} would be one entry (angle {self.angle:.0f}°). {experiment}."


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a log can distinguish.

    Attributes:
        ids: effects, those that would show best first.
        shows: RMS of what each changes at its usual size, in noise standard deviations, (n,).
        shown: whether that is enough to be accepted, (n,).
        angles: between the signatures of two effects [deg], (n, n).
        pairs: of the effects that would show, those that would be one entry.
    """

    ids: tuple[str, ...]
    shows: Array
    shown: tuple[bool, ...]
    angles: Array
    pairs: tuple[OneEntry, ...]

    def to_json(self) -> dict[str, Any]:
        """As a document holds it."""
        return {
            "effects": [
                {"id": id, "beyond_noise": float(size), "shows": shown}
                for id, size, shown in zip(self.ids, self.shows, self.shown, strict=True)
            ],
            "angles_deg": self.angles.round(1).tolist(),
            "one_entry": [
                {"effects": list(p.effects), "angle_deg": p.angle, "experiment": p.experiment}
                for p in self.pairs
            ],
        }


def isolability(records: Sequence[Record] | LogFacts) -> Isolability:
    """Which effects would show on logs, and which of these could be distinguished."""
    searched = searched_on(LogFacts.of(records).records, None, given=False)
    base = fit_baseline(searched.facts, None, chain_effects())
    return isolability_of(base)


def isolability_of(base: Base) -> Isolability:
    """The same around a base that is there already."""
    search, model = base.search, base.model
    table, data = search.model, search.data
    errors = np.nan_to_num(data.y - table.run(model.q, data)[0])
    single = table.tracks == 1
    rows: list[Array] = []
    owners: list[int] = []
    effects = [
        e
        for e in table.effects
        if e.id not in NOT_NAMED
        and not (single and e.couples)
        and not (search.level and e.hints.level)
    ]
    for k, e in enumerate(effects):
        starts = starts_of(table, e, model.q, errors, data)
        rows += starts
        owners += [k] * len(starts)
    floor = np.maximum(noise_of(base).value, 1e-12)
    screen = screened(table, model.q, model.free, np.array(rows), data)
    flat = (screen.signatures / floor).reshape(len(rows), -1)
    counted = max(float(np.count_nonzero(data.weight)), 1.0)
    lengths = np.linalg.norm(flat, axis=1)
    cosines = np.clip(flat @ flat.T / np.maximum(np.outer(lengths, lengths), 1e-300), -1.0, 1.0)
    of = [np.flatnonzero(np.array(owners) == k) for k in range(len(effects))]
    present = [k for k, at in enumerate(of) if len(at)]
    usual = {k: int(of[k][np.argsort(lengths[of[k]])[len(of[k]) // 2]]) for k in present}
    order = sorted(present, key=lambda k: -lengths[usual[k]])
    angles = np.zeros((len(order), len(order)))
    pairs = []
    shown = {k: lengths[usual[k]] ** 2 > _needed(effects[k], table.tracks, counted) for k in order}
    for a, i in enumerate(order):
        for b, j in enumerate(order[:a]):
            # either may take the size with which it imitates the other best
            alike = max(cosines[usual[i], of[j]].max(), cosines[usual[j], of[i]].max())
            apart = float(np.arccos(np.clip(alike, 0.0, 1.0)))
            angles[a, b] = angles[b, a] = np.degrees(apart)
            rest = min(lengths[usual[i]], lengths[usual[j]]) * np.sin(apart)
            told = rest**2 > _needed(effects[i], table.tracks, counted)
            if shown[i] and shown[j] and not told:
                ids = (effects[j].id, effects[i].id)
                pairs.append(OneEntry(ids, float(angles[a, b]), opening(*ids)))
    return Isolability(
        tuple(effects[k].id for k in order),
        np.array([lengths[usual[k]] / np.sqrt(counted) for k in order]),
        tuple(bool(shown[k]) for k in order),
        angles,
        tuple(sorted(pairs, key=lambda p: p.angle)),
    )


def _needed(e: Effect, tracks: int, samples: float) -> float:
    """‖Δ⊥‖² in units of the noise's power that the rule of acceptance asks for."""
    numbers = len(e.searched({p.name: p.start(0) for p in e.parameters if p.choice}))
    numbers *= 1 if e.shared else tracks
    return samples * needed_power(numbers, samples, RULE.held_out)


def opening(a: str, b: str) -> str:
    """Commands that tell two effects apart, in words: the first that shows one of them only."""
    mine, others = (about(id).hints.programmes for id in (a, b))
    best = next((p for p in (*mine, *others) if p not in mine or p not in others), mine[0])
    return best.words if not about(a).texts.by_hand else about(a).texts.by_hand
