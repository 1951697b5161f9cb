"""An effect with several laws under one name: the data choose, the simplest that suffices."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import CandidateModel, ScoredCandidate
from sysid.diagnosis.search.starts import free_indices
from sysid.effects.base import Law
from sysid.effects.catalogue import effect
from sysid.structures.augmented.structure import Augmented

DT, KEPT, GAIN, SIGMA = 0.05, 0.8, 20.0, 0.05
SAG = effect("supply-sag")
MODEL = FullModel((SAG,), 1, 2, np.array([10.0, 10.0]), DT)


def logged(numbers: dict[str, float], seed: int) -> Record:
    """Two equal tracks with supply-sag under random holds, white noise."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1.0, 1.0, (60, 2))
    levels[0] = 0.0
    u = np.repeat(levels, 10, axis=0)
    theta = np.array([GAIN, -KEPT] * 2 + [numbers[p.name] for p in SAG.parameters])
    y = Augmented(1, 1, (1.0, 1.0), DT, (SAG.id,)).simulate(theta, u)
    y = y + SIGMA * rng.standard_normal(y.shape)
    inputs = (Channel("d_l", ""), Channel("d_r", ""))
    return Record(u, y, DT, inputs, (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")))


def tried(numbers: dict[str, float]) -> tuple[CandidateSearch, ScoredCandidate]:
    search = CandidateSearch(MODEL, [logged(numbers, 1)], [logged(numbers, 2)], np.ones(2), 1)
    start = MODEL.null
    start[list(MODEL.of("core"))] = [GAIN, -KEPT] * 2
    base = search.base(start[None])
    search.origin = base.q
    (found,) = search.candidates(base, [SAG])
    return search, found


def numbers_of(node: CandidateModel) -> dict[str, float]:
    return {p.name: float(node.q[MODEL.index[SAG.id, p.name, -1]]) for p in SAG.parameters}


@pytest.mark.parametrize(
    "hidden",
    [
        {"sag": 0.2, "emf": 0.85, "current": 0.0},
        {"sag": 0.3, "emf": 0.85, "current": 1.0},
        {"sag": 0.3, "emf": 0.6, "current": 2.0},
    ],
    ids=["by the command", "by the current", "of a motor with much friction"],
)
def test_the_data_choose_the_law(hidden: dict[str, float]) -> None:
    search, found = tried(hidden)
    # five standard errors and more of what this noise leaves of them
    assert numbers_of(found.model) == pytest.approx(hidden, abs=0.02)
    assert search.admissible(found.model)
    core = len(MODEL.of("core"))
    assert len(found.model.free) == core + (2 if hidden["current"] == 2.0 else 1)


def test_a_start_holds_only_the_numbers_of_its_law() -> None:
    starts = MODEL.starts(SAG)
    at = {p.name: MODEL.index[SAG.id, p.name, -1] for p in SAG.parameters}
    assert [s[at["current"]] for s in starts] == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]
    for start, moved in zip(starts, (1, 1, 1, 1, 2, 2), strict=True):
        q = MODEL.null
        q[list(start)] = list(start.values())
        assert len(free_indices(MODEL, SAG, q, (0, 1))) == moved


def test_an_effect_without_laws_moves_all_but_its_choices() -> None:
    plain = replace(SAG, laws=())
    assert plain.law({"current": 1.0}) is None
    assert plain.searched({"current": 1.0}) == ("sag", "emf")
    one = replace(SAG, laws=(Law(("emf",), choices={"current": 1.0}),))
    assert one.searched({"current": 1.0}) == ("emf",)
    assert one.law({"current": 0.0}) is None
