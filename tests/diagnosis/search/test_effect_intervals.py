"""What is known of an effect's numbers: intervals that hold the truth, places never visited."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sysid.data.documents import plain
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis import findings
from sysid.diagnosis.augment import model_of, values_of
from sysid.diagnosis.base_model import Base, fit_baseline
from sysid.diagnosis.diagnosis import Value
from sysid.diagnosis.search.intervals import intervals_of
from sysid.diagnosis.search.selection import CandidateModel, Interval, Selection
from sysid.effects.catalogue import chain_effects, effect
from sysid.structures.augmented.structure import Augmented

DT, GAIN, TAU, NOISE = 0.05, 20.0, 0.25, 0.2
INPUTS = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
OUTPUTS = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
EDGES = {"plus": 0.17, "minus": 0.23, "jump": 0.08}


def commands(seed: int, samples: int = 500, grid: float = 0.0, forward: bool = False) -> Array:
    """Commands held for 12 samples, up to 0.8 of full drive, on a grid where one is given."""
    rng = np.random.default_rng(seed)
    d = rng.uniform(0.0 if forward else -0.8, 0.8, (samples // 12 + 1, 2))
    d = np.round(d / grid) * grid if grid else d
    return np.repeat(d, 12, axis=0)[:samples]


def recorded(drive: Array, d: Array, seed: int) -> Record:
    """Two first-order tracks behind what became of their commands, with noise on the readings."""
    a = np.exp(-DT / TAU)
    y = np.zeros_like(drive)
    for k in range(1, len(drive)):
        y[k] = a * y[k - 1] + GAIN * (1.0 - a) * drive[k - 1]
    y += NOISE * np.random.default_rng(1000 + seed).standard_normal(y.shape)
    return Record(20000.0 * d, y, DT, INPUTS, OUTPUTS, name="made.csv", sha256=str(seed))


def behind_a_dead_zone(seed: int, grid: float = 0.0, forward: bool = False) -> Record:
    d = commands(seed, grid=grid, forward=forward)
    width = np.where(d >= 0.0, EDGES["plus"], EDGES["minus"])
    beyond = np.maximum(np.abs(d) - width, 0.0)
    return recorded(np.sign(d) * (beyond + EDGES["jump"] * (beyond > 0.0)), d, seed)


def with_effect(record: Record, id: str) -> tuple[Base, CandidateModel]:
    """The plain base, and the node with the effect as the search leaves it."""
    base = fit_baseline([record], None, chain_effects())
    (judged,) = base.search.candidates(base.model, [effect(id)])
    base.search.origin = base.model.q
    return base, base.search.fitted(judged.model)


@cache
def measured(seed: int, grid: float = 0.0, forward: bool = False) -> tuple[Base, Selection]:
    """A dead zone with a jump, its numbers with their intervals."""
    base, node = with_effect(behind_a_dead_zone(seed, grid, forward), "dead-zone")
    node, intervals = intervals_of(base.search, node)
    return base, Selection(base.model, node, (), (), (), intervals)


def holds(told: Interval, true: float) -> bool:
    low = -np.inf if told.low is None else told.low
    high = np.inf if told.high is None else told.high
    return bool(low <= true <= high)


@pytest.mark.slow
def test_intervals_hold_edges_and_jump() -> None:
    inside, by_slopes = [], []
    for seed in (0, 1, 2):
        base, naming = measured(seed)
        for k, told in naming.intervals.items():
            slot = base.search.model.parameters[k]
            inside.append(holds(told, EDGES[slot.name]))
            error = told.std_error(float(naming.final.q[k]))
            if error is not None:
                by_slopes.append(abs(naming.final.q[k] - EDGES[slot.name]) <= 2.0 * error)
    assert len(inside) == 18
    # numbers of one track hang together: of 6 tracks' worth at 95 %, two miss in 3 % of the cases
    assert np.mean(inside) >= 0.66
    assert np.mean(by_slopes) >= 0.66


def test_an_interval_holds_the_estimate_it_belongs_to() -> None:
    # walkers may leave the best place on a ragged likelihood for a broader one
    assert Interval(0.7, 1.8).holding(2.3) == Interval(0.7, 2.3)
    assert Interval(0.7, 1.8).holding(0.2) == Interval(0.2, 1.8)
    assert Interval(None, 1.8).holding(-3.0) == Interval(None, 1.8)
    base, naming = measured(0)
    for k, told in naming.intervals.items():
        assert holds(told, float(naming.final.q[k])), base.search.model.parameters[k]


def test_the_estimate_moves_to_where_the_likelihood_is_highest() -> None:
    base, node = with_effect(behind_a_dead_zone(0), "dead-zone")
    selection = measured(0)[1]
    cost = [
        float(np.nansum(np.concatenate(n.errors.estimation) ** 2)) for n in (node, selection.final)
    ]
    assert cost[1] < 0.99 * cost[0]
    for name, true in EDGES.items():
        assert holds(selection.intervals[base.search.model.index["dead-zone", name, 0]], true)


def test_commands_on_a_grid_cannot_tell_width_from_jump() -> None:
    base, naming = measured(0, grid=0.1)
    for k, told in naming.intervals.items():
        assert holds(told, EDGES[base.search.model.parameters[k].name])
    said = " ".join(findings.indistinct_edges(base, naming, base.parts.estimation))
    assert "pwm_l has no command between 2000 and 4000 µs" in said
    assert "pwm_l has no command between -4000 and -6000 µs" in said
    ramp = np.linspace(-0.8, 0.8, 500)[:, None] * np.array([1.0, 1.0])
    dense = recorded(ramp, ramp, 0)
    assert not findings.indistinct_edges(base, naming, [dense])


def test_a_side_that_is_never_driven_is_not_visited() -> None:
    base, naming = measured(1, forward=True)
    values = {v.name: v for v in values_of(base, naming.final, "dead-zone", naming.intervals)}
    for name in ("minus[omega_l]", "minus[omega_r]"):
        assert not values[name].visited
        assert values[name].words == "not seen in this log"
        assert plain(values[name]) == {
            "name": name, "value": None, "std_error": None, "unit": "drive",
            "interval": None, "visited": False, "on_bound": False,
        }  # fmt: skip
    assert values["plus[omega_l]"].visited
    rows = {p.name: p for p in model_of(base, naming.final, naming.intervals).parameter_table()}
    assert not rows["dead-zone.minus[omega_l]"].visited
    assert rows["dead-zone.plus[omega_l]"].visited
    assert rows["dead-zone.plus[omega_l]"].std_error > 0.0


def test_the_model_has_the_errors_of_the_intervals() -> None:
    base, naming = measured(0)
    rows = {p.name: p for p in model_of(base, naming.final, naming.intervals).parameter_table()}
    values = values_of(base, naming.final, "dead-zone", naming.intervals)
    assert [rows[f"dead-zone.{v.name}"].value for v in values] == [v.value for v in values]
    known = {v.name: v.std_error for v in values if v.std_error is not None}
    assert len(known) == 6  # sizes of two tracks and of their jumps
    for name, error in known.items():
        assert rows[f"dead-zone.{name}"].std_error == pytest.approx(error)


# Words --------------------------------------------------------------------------------------------


def sentence(id: str, **values: float) -> str:
    shown = [
        Value(k.replace("__", "[") + "]" * ("__" in k), v, 0.01, "") for k, v in values.items()
    ]
    return findings.sentence_of(effect(id), shown, ())


def test_sentences_follow_the_sign() -> None:
    assert sentence("concave-gain", kappa__y=0.3).startswith("The static gain falls")
    assert sentence("concave-gain", kappa__y=-0.3).startswith("The static gain rises")
    mixed = sentence("concave-gain", kappa__a=0.3, kappa__b=-0.3)
    assert "gain falls" in mixed
    assert "On b the opposite: the static gain rises" in mixed
    assert "helps" in sentence("cross-coupling", share__a=-0.1, share__b=-0.2)
    assert "loads" in sentence("cross-coupling", share__a=0.1, share__b=0.2)


def test_every_value_of_an_equation_stands_beside_its_channel() -> None:
    structure = Augmented(1, 1, (1.0, 1.0), DT, ("dead-zone",))
    theta = np.array([20.0, -0.8, 20.0, -0.8, 0.3, 0.1, 0.07, 0.2, 0.1, 0.0])
    lines = structure.equations(theta, INPUTS, OUTPUTS)
    (line,) = [x for x in lines if x.startswith("dead-zone")]
    for words in (
        "plus[omega_l] = 0.3", "plus[omega_r] = 0.2", "minus[omega_l] = 0.1",
        "minus[omega_r] = 0.1", "jump[omega_l] = 0.07",
    ):  # fmt: skip
        assert words in line
    assert "jump[omega_r]" not in line  # it does nothing there
    single = replace(structure, scales=(1.0,))
    (line,) = [
        x for x in single.equations(theta[[0, 1, 4, 5, 6]], INPUTS[:1], OUTPUTS[:1])
        if x.startswith("dead-zone")
    ]  # fmt: skip
    assert "plus = 0.3" in line


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (Value("a", 0.5, 0.01, "V"), "= 0.5 ± 0.02 V"),
        (Value("a", 0.5, 0.01, "V", (0.45, 0.52)), "= 0.5 (0.45 to 0.52) V"),
        (Value("a", 0.5, None, "V", (0.45, None)), "is at least 0.45 V"),
        (Value("a", 0.5, None, "V", (None, 0.52)), "is at most 0.52 V"),
        (Value("a", float("nan"), None, "V"), "is not seen in this log"),
    ],
)
def test_a_number_says_what_is_known_of_it(value: Value, words: str) -> None:
    assert value.shown == words


def test_another_cause_of_error_widens_both_sides() -> None:
    assert Interval(0.7, 1.3).widened(1.0, 0.4) == Interval(0.5, 1.5)
    assert Interval(None, 1.3).widened(1.0, 0.4) == Interval(None, 1.5)


def test_a_delay_is_no_surer_than_its_sampling() -> None:
    """A clean log of hundreds of changes, and nobody knows when in a sample a board acts."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, (60, 1)), 12, axis=0)
    y = np.zeros_like(u)
    for k in range(3, len(u)):
        y[k] = 0.8 * y[k - 1] + 0.2 * 10.0 * u[k - 3]
    record = Record(u, y + 1e-3 * rng.standard_normal(y.shape), 0.05)
    base = fit_baseline([record], None, (effect("input-delay"),))
    model = base.search.model
    (k,) = model.of("input-delay")
    q = base.model.q.copy()
    q[k] = 0.1 - 0.05 * max(base.search.delay - 1, 0)
    core = [model.index["core", "gain", 0], model.index["core", "f1", 0]]
    q[core] = 10.0, -0.8
    node = base.search.evaluate(("input-delay",), q, (*core, k))
    node, intervals = intervals_of(base.search, node)
    error = intervals[k].std_error(float(node.q[k]))
    assert error is not None
    assert 0.03 * record.dt <= error < 0.05 * record.dt
