"""The rule of acceptance at the end: nothing is said of an effect that its numbers do not bear."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import Base, fit_baseline, full_drive
from sysid.diagnosis.diagnosis import NamedEffect, Value
from sysid.diagnosis.findings import sentence_of
from sysid.diagnosis.policies import RULE, VERDICT
from sysid.diagnosis.rules.final_model import (
    ParameterEstimate,
    _acting_alone,
    against,
    uncertain_parameters,
)
from sysid.diagnosis.rules.ledger import confirmed
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.selection import CandidateModel, Interval, Selection
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.diagnosis.verdict import Remaining, verdict_of
from sysid.effects.catalogue import about, chain_effects
from sysid.structures.augmented.structure import Augmented

CLEAR = Evidence(-60.0, 6.0, 0.9, 0.5, 1e-6)
AWAY = ParameterEstimate(0.3, 0.0, 0.05)


def test_what_stands_is_not_spoken_against() -> None:
    assert against(CLEAR, [AWAY]) == ""
    assert against(CLEAR, []) == ""  # read off the data: it has no number of its own


@pytest.mark.parametrize(
    ("evidence", "number", "words"),
    [
        (CLEAR, ParameterEstimate(-0.031, 0.0, 0.062), "includes the null value"),
        (replace(CLEAR, p_value=0.118), AWAY, "may be chance (p = 0.12"),
        (replace(CLEAR, p_value=0.062), AWAY, "may be chance (p = 0.062"),
        (replace(CLEAR, delta_bic=-5.0), AWAY, "cost more than they gain"),
        (replace(CLEAR, ratio=1.15), AWAY, "changes the held-out error by +15 %"),
        (CLEAR, ParameterEstimate(0.3, 0.0, 0.0), "includes the null value"),  # a slope of nothing
        (CLEAR, ParameterEstimate(0.3, 0.0, 0.01, Interval(0.0, 0.6)), "includes the null value"),
        (CLEAR, ParameterEstimate(0.3, 0.0, 0.01, Interval(0.2, 0.4, visited=False)), "null value"),
        (CLEAR, ParameterEstimate(0.9, 1e6, 0.01, Interval(0.8, None)), "includes the null value"),
    ],
)
def test_what_evidence_speaks_against_is_dropped(
    evidence: Evidence, number: ParameterEstimate, words: str
) -> None:
    assert words in against(evidence, [number])


def test_a_gain_beyond_chance_stands_although_few_blocks_hold_it() -> None:
    """A remote-controlled log of a minute stops and reverses seldom."""
    seldom = replace(CLEAR, delta_bic=-207.0, t=2.7, p_value=0.53)
    assert against(seldom, [AWAY]) == ""
    assert "may be chance" in against(replace(seldom, t=1.5), [AWAY])


def test_one_number_away_from_its_null_is_enough_and_a_limit_needs_its_upper_end() -> None:
    assert against(CLEAR, [ParameterEstimate(0.01, 0.0, 0.1), AWAY]) == ""
    assert ParameterEstimate(0.9, 1e6, 0.0, Interval(0.8, 0.95)).away
    assert ParameterEstimate(0.3, 0.0, 9.0, Interval(0.1, 0.5)).away  # the likelihood knows better


def test_a_delay_is_none_as_long_as_sampling_itself_may_make_it() -> None:
    """Found before others were known, it may have shrunk to what counting over a sample makes."""
    within = ParameterEstimate(0.027, 0.0, 0.001, Interval(0.024, 0.033), sampled=0.0275)
    assert "includes the null value" in against(CLEAR, [within])
    assert against(CLEAR, [replace(within, interval=Interval(0.029, 0.033))]) == ""
    assert "includes the null value" in against(CLEAR, [replace(within, interval=None)])
    assert against(CLEAR, [replace(within, interval=None, value=0.031)]) == ""


def test_one_alone_must_do_what_a_first_effect_must() -> None:
    left_alone = replace(CLEAR, ratio=0.93)
    assert against(left_alone, [AWAY]) == ""
    assert "the held-out error by -7 %" in against(left_alone, [AWAY], RULE.held_out)


def lagging(samples: int = 600) -> tuple[Array, Array]:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(0.2, 1.0, samples // 20), 20)[:, None]  # never backwards
    s = Augmented(1, 1, (1.0,), 0.05, ())
    y = s.simulate(np.array([20.0, -0.8]), u) + 0.05 * rng.standard_normal((samples, 1))
    return u, y


@pytest.fixture(scope="module")
def base() -> Base:
    u, y = lagging()
    record = Record(u, y, 0.05, (Channel("volts", "V"),), (Channel("omega", "rad/s"),))
    some = [e for e in chain_effects() if e.id == "dead-zone"]
    return fit_baseline([record], None, some)


def named(base: Base) -> Selection:
    """A dead zone with numbers of both sides; the log drives one."""
    search, q = base.search, base.model.q.copy()
    mine = search.model.of("dead-zone")
    q[list(mine)] = [0.05, 0.05, 0.0]
    node = search.evaluate(("dead-zone",), q, (*base.model.free, *mine))
    return Selection(base.model, node, search.account(base.model, node, (), ()), (), ())


def test_a_side_that_slopes_say_nothing_of_is_asked_of_the_likelihood(base: Base) -> None:
    slots = base.search.model.parameters
    doubted = {slots[k].name for k in uncertain_parameters(base, named(base))}
    assert "minus" in doubted


@pytest.mark.parametrize(
    ("id", "values", "expected"),
    [
        ("dead-time", {"share": 0.1, "emf": 0.9, "ripple": 0.02}, {"share"}),
        ("dead-zone", {"plus": 0.05, "minus": 0.05, "jump": 0.1}, {"plus", "jump"}),
        ("gravity-load", {"cosine": 0.5, "sine": 0.7}, {"cosine", "sine"}),
        ("thermal-fade", {"loss": 0.3, "time": 20.0}, {"loss"}),
    ],
)
def test_numbers_that_only_shape_an_effect_are_no_sign_of_it(
    id: str, values: dict[str, float], expected: set[str]
) -> None:
    u, y = lagging()  # never backwards: no log shows a zone on that side
    record = Record(u, y, 0.05, (Channel("volts", "V"),), (Channel("omega", "rad/s"),))
    base = fit_baseline([record], None, [e for e in chain_effects() if e.id == id])
    search, q = base.search, base.model.q.copy()
    mine = {name: search.model.index[id, name, 0] for name in values}
    for name, k in mine.items():
        q[k] = values[name]
    node = search.evaluate((id,), q, (*base.model.free, *mine.values()))
    alone = _acting_alone(base, node, tuple(mine.values()))
    assert {name for name, k in mine.items() if k in alone} == expected


def test_a_name_that_does_not_stand_is_dropped_with_the_reason(base: Base) -> None:
    scales = full_drive(base.parts.estimation)
    study = DiagnosisSession(base, noise_of(base), scales, 0)
    kept, dropped = confirmed(study, named(base))
    assert kept.selected == ()
    assert kept.final is base.model
    (gone,) = dropped
    assert gone.id == "dead-zone"
    assert gone.reason
    assert "dead-zone" in dict(kept.minor)


def test_beside_a_name_less_asks_for_more(
    base: Base,
) -> None:
    noise = noise_of(base)
    study = DiagnosisSession(base, noise, full_drive(base.parts.estimation), 0)
    rng, errors = np.random.default_rng(2), base.model.errors

    def of(size: float, effects: tuple[str, ...]) -> CandidateModel:
        white = tuple(size * noise.high * rng.standard_normal(e.shape) for e in errors.holdout)
        return replace(base.model, effects=effects, errors=replace(errors, holdout=white))

    between = (VERDICT.residual_to_noise_later + VERDICT.residual_to_noise) / 2.0
    assert study.remains(of(between, ())) == 0.0
    assert study.remains(of(between, ("dead-zone",))) == RULE.in_loop


def test_a_number_on_a_bound_is_said_to_be_on_it() -> None:
    value = Value("kappa[omega]", -0.9, 0.0, "1/drive", bounded=True)
    said = sentence_of(about("concave-gain"), [value], ())
    assert "static gain rises" in said
    assert "± 0" not in said
    assert "= -0.9 1/drive (on the bound of the search)" in said
    assert value.to_json()["on_bound"] is True


def test_a_side_never_driven_is_not_plus_minus_nothing() -> None:
    seen = Value("plus[omega]", 0.2, 0.01, "drive")
    said = sentence_of(about("dead-zone"), [seen, Value("minus[omega]", math.nan, None, "")], ())
    assert "minus[omega] is not seen in this log" in said


@pytest.mark.parametrize("id", ["quantisation", "held-telemetry", "dropouts"])
def test_what_only_the_samples_show_is_no_missing_effect(id: str) -> None:
    quiet = Remaining(None, None)  # type: ignore[arg-type]
    assert verdict_of([id], quiet, False) == "no-missing-effect"
    assert verdict_of([id, "dead-zone"], quiet, False) == "effects-found"
    assert verdict_of([id], quiet, True) == "unexplained"


@pytest.mark.parametrize(
    ("ratio", "remains", "words"),
    [
        (
            0.5,
            "partly explained",
            "Without it the held-out error is 2 times as large; partly",
        ),
        (0.25, "", "Without it the held-out error is 4 times as large."),
        (None, "", ""),  # read off the samples
    ],
)
def test_an_entry_gives_the_error_without_it(ratio: float | None, remains: str, words: str) -> None:
    evidence = None if ratio is None else Evidence(-9.0, 9.0, 1.0, ratio, 0.0)
    entry = NamedEffect("x", "motor", (), (), evidence, (), "", remains)
    assert entry.fit_words.startswith(words)
    assert bool(entry.fit_words) == bool(words)
