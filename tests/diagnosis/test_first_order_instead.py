"""A base of high order that absorbed the cause gives way to one of first order."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.record import Channel, Record
from sysid.diagnosis import first_order
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.first_order import or_on_first_order
from sysid.diagnosis.session import SelectionResult
from sysid.effects.catalogue import chain_effects
from sysid.errors import DataError

LOG = Record(np.zeros((4, 1)), np.zeros((4, 1)), 0.1, (Channel("u", "V"),), (Channel("speed"),))


def outcome(
    order: int,
    named: tuple[str, ...] = (),
    doubtful: bool = True,
    unexplained: bool = True,
    closed: float = 95.0,
) -> Any:
    base = SimpleNamespace(
        search=SimpleNamespace(model=SimpleNamespace(order=order, effects=()), level=True),
        parts=SimpleNamespace(estimation=(LOG,)),
    )
    study = SimpleNamespace(
        base=base,
        required_ratio=lambda: 0.9 if doubtful else 0.0,
        far_above_noise=lambda naming: unexplained,
        gap=lambda naming: SimpleNamespace(closed_percent=closed),
    )
    return SimpleNamespace(session=study, selection=SimpleNamespace(selected=named, final=None))


def better(more: bool) -> Any:
    """What was found on first order, and whether it explains more."""
    found = outcome(1, ("backlash",))
    found.session.explains_more = lambda naming, node: more
    found.session.searched = lambda effects, say: found
    return found


@pytest.mark.parametrize(
    ("found", "other", "taken"),
    [
        (outcome(3), better(True), True),
        (outcome(3), better(False), False),
        (outcome(3), None, False),
        (outcome(3, ("dead-zone",)), better(True), True),
        (outcome(3, ("dead-zone",), unexplained=False), better(True), False),
        (outcome(3, ("dead-zone",), unexplained=False, closed=50.0), better(True), True),
        (outcome(3, doubtful=False), better(True), False),
        (outcome(1), better(True), False),
    ],
    ids=[
        *("explains-more", "explains-less", "nothing-found", "part-explained"),
        *("all-explained", "half-explained", "nothing-missing", "first-order-already"),
    ],
)
def test_first_order_is_taken_where_it_explains_more(
    found: Any, other: Any, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (chosen(found, other, monkeypatch) is other) is taken


def chosen(
    found: Any, other: Any, monkeypatch: pytest.MonkeyPatch, swinging: bool = False
) -> SelectionResult:
    def fitted(*_: Any, **__: Any) -> Any:
        if other is None:
            raise DataError("no base")
        return other.session.base

    monkeypatch.setattr(first_order, "fit_baseline", fitted)
    monkeypatch.setattr(first_order, "confirmed", lambda session, selection: (selection, ()))
    monkeypatch.setattr(first_order, "swings", lambda base: swinging)
    monkeypatch.setattr(first_order, "stand_in", lambda session, selection: "a spring")
    monkeypatch.setattr(first_order, "replace", lambda session, base: other.session)
    result = or_on_first_order(found, LogFacts((LOG,)), None, lambda text, share: None)
    assert result in (found, other)
    return result


def test_friction_in_place_of_a_spring_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """What swings on a base of higher order is no friction of a lower one, unless explained."""
    found = outcome(3)
    assert chosen(found, better(True), monkeypatch, swinging=True) is found


@pytest.mark.slow
def test_a_plain_base_keeps_to_the_highest_order_asked_for() -> None:
    rng = np.random.default_rng(7)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 25)
    y, x = np.zeros(len(u)), np.zeros(2)
    for k in range(len(u) - 1):
        x = np.array([0.95 * x[0] + 0.05 * u[k], 0.9 * x[1] + 0.1 * x[0]])
        y[k + 1] = x[1]
    y += 1e-3 * rng.standard_normal(len(y))
    log = Record(u[:, None], y[:, None], 0.02, (Channel("u", "V"),), (Channel("speed"),), name="m")
    orders = [
        fit_baseline([log], None, chain_effects(), **highest).search.model.order
        for highest in ({}, {"highest": 1})
    ]
    assert orders[0] > 1
    assert orders[1] == 1
