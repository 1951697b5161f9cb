"""What a diagnosis names in logs that hide something, made by a twin that shares no code."""

import dataclasses
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from sysid_datasets.hidden_logs import Request, hide

from sysid.data.checks.integral import integrates
from sysid.data.documents import plain
from sysid.data.io import read_log
from sysid.data.record import Channel, Record
from sysid.diagnosis.against import compared
from sysid.diagnosis.augment import values_of
from sysid.diagnosis.base_model import Base, divided, fit_baseline
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.integrating import rates
from sysid.diagnosis.search.admission import beyond_sampling
from sysid.diagnosis.search.batched_search import information, search
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import prepare
from sysid.diagnosis.search.selection import Interval
from sysid.diagnosis.search.starts import clip_level, repeats_at_top
from sysid.effects.catalogue import chain_effects
from sysid.effects.friction import HEAVIEST
from sysid.errors import DataError
from sysid.estimation.identify import Request as FitRequest
from sysid.estimation.identify import identify
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model

DURATION = 60.0
"""One length for all logs, so that they share one compilation [s]."""


def logs(
    folder: Path, effects: str, seed: int, style: str = "steps", **more: object
) -> dict[str, Record]:
    request = Request(
        effects=tuple(e for e in effects.split("+") if e),
        seed=seed,
        style=style,
        duration=DURATION,
        **more,  # type: ignore[arg-type]
    )
    found = {}
    for name, text in hide(request).files.items():
        if name.endswith(".csv"):
            (folder / name).write_text(text, encoding="utf-8")
            found[name.removesuffix(".csv")] = read_log(folder / name)
    return found


@cache
def diagnosed(hidden: str, seed: int, style: str) -> tuple[dict[str, Record], Diagnosis]:
    """Logs that hide an effect and what is found in them, once for all tests."""
    with TemporaryDirectory() as folder:
        log = logs(Path(folder), hidden, seed, style)
    return log, diagnose([log["est"]], [log["val"]])


def entries(found: Diagnosis) -> list[set[str]]:
    return [{e.id, *e.indistinguishable} for e in found.effects]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "seed", "style"),
    [
        ("dead-zone", 11, "steps"),
        ("input-delay", 12, "prbs"),
        ("coulomb-friction", 13, "steps"),
        ("cross-coupling", 14, "steps"),
        ("unsigned-speed", 15, "prbs"),
        ("speed-ripple", 16, "steps"),
        ("freewheel", 17, "prbs"),
    ],
)
def test_the_hidden_effect_comes_first_and_the_error_falls_to_the_noise(
    hidden: str, seed: int, style: str
) -> None:
    _, found = diagnosed(hidden, seed, style)
    assert found.verdict == "effects-found"
    assert hidden in entries(found)[0]
    assert found.gap.closed_percent > 80.0
    assert found.gap.interval[0] <= found.gap.closed_percent <= found.gap.interval[1] + 1e-9


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden(tmp_path: Path) -> None:
    for seed, disturbance in ((21, "white"), (22, "ar")):
        log = logs(tmp_path, "", seed, disturbance=disturbance)
        found = diagnose([log["est"]], [log["val"]])
        assert (found.verdict, found.effects) == ("no-missing-effect", ())
        assert found.after is found.before


def test_a_log_without_validation_is_divided_and_lost_readings_do_not_count(tmp_path: Path) -> None:
    log = logs(tmp_path, "dropouts", 41)
    found = diagnose([log["est"]])
    assert [e.id for e in found.effects] == ["dropouts"]
    assert any("excluded" in w for w in found.warnings)
    assert np.isfinite(found.gap.before)
    held = next(t for t in found.traces if t.role == "held-out")
    assert 0.2 < np.mean(held.counted) < 0.4


@pytest.mark.slow
def test_a_changed_robot_is_told_from_a_missing_effect(tmp_path: Path) -> None:
    log = logs(tmp_path, "changed-parameter", 51, clean=True)
    fit = identify([log["clean"]], [], FitRequest(structures=("oe",), orders="nb=1 nf=1 nk=1"))
    model = fit.assessments[0].model
    found = diagnose([log["est"]], [log["val"]], model=model)
    assert found.effects[0].id == "changed-parameter"
    assert found.before is model
    # the model with its new core is an ordinary model: saved, read and run again
    again = Model.from_json(found.after.to_json())
    u = log["val"].u[:50]
    np.testing.assert_array_equal(again.simulate(u), found.after.simulate(u))


@pytest.mark.slow
def test_a_given_model_is_taken_as_it_is_and_may_have_absorbed_the_effect() -> None:
    made, plain = diagnosed("dead-zone", 11, "steps")
    asked = FitRequest(structures=("oe",), orders="nb=1 nf=1 nk=1")
    model = identify([made["est"]], [], asked).assessments[0].model
    found = diagnose([made["est"]], [made["val"]], model=model)
    assert found.before is model
    assert any("absorbed" in w for w in found.warnings)
    # without it the baseline is the base, and the model is only compared with the result
    assert entries(plain) == [{"dead-zone"}]
    assert plain.gap.closed_percent > 95.0
    beside = compared("oe-1", model, plain.traces)
    assert beside is not None
    errors = made["val"].y - model.simulate(made["val"].u)
    expected = np.sqrt(np.mean(errors**2, axis=0))
    np.testing.assert_allclose(list(beside.rmse.values()), expected, rtol=0.02)
    assert "oe-1 has a held-out error of" in beside.sentence(plain.gap)


@pytest.mark.slow
def test_the_augmented_model_runs_as_the_search_did() -> None:
    _, found = diagnosed("dead-zone", 11, "steps")
    assert isinstance(found.after.structure, Augmented)
    held = next(t for t in found.traces if t.role == "held-out")
    x0 = found.after.fitted_state(held.record, 1)
    np.testing.assert_allclose(
        found.after.simulate(held.record.u, x0), held.after, atol=1e-9 * np.abs(held.after).max()
    )
    named = found.effects[0]
    assert {"plus[omega_l]", "minus[omega_l]"} <= {p.name for p in named.parameters}
    # an edge lies between two commands, and the jump with it: here they are up to 0.1 apart
    assert all(p.std_error is not None and p.std_error < 0.05 for p in named.parameters)


@pytest.mark.slow
def test_the_same_log_gives_the_same_diagnosis() -> None:
    log, found = diagnosed("coulomb-friction", 13, "steps")
    once = found.to_json()
    again = diagnose([log["est"]], [log["val"]]).to_json()
    assert {k: v for k, v in once.items() if k != "seconds"} == {
        k: v for k, v in again.items() if k != "seconds"
    }


def test_a_log_with_three_inputs_and_two_outputs_is_refused(tmp_path: Path) -> None:
    log = logs(tmp_path, "", 21)["est"]
    third = Channel("pwm_c", "µs")
    u = np.column_stack([log.u, log.u[::-1, 0]])
    three = dataclasses.replace(log, u=u, inputs=(*log.inputs, third))
    with pytest.raises(DataError, match="one input for each output, or one of either"):
        diagnose([three])


# The parts ----------------------------------------------------------------------------------------


def model() -> FullModel:
    return FullModel(chain_effects(), 1, 2, np.array([10.0, 10.0]), 0.05)


def record(samples: int = 400, seed: int = 3) -> Record:
    rng = np.random.default_rng(seed)
    u = 20000.0 * np.repeat(rng.uniform(-1, 1, size=(samples // 10, 2)), 10, axis=0)
    channels = [Channel(f"pwm_{s}", "µs") for s in "lr"], [Channel(f"omega_{s}") for s in "lr"]
    return Record(u, np.zeros_like(u), 0.05, *map(tuple, channels), name="made")


def core(m: FullModel, gain: float = 20.0, pole: float = -0.8) -> np.ndarray:
    q = m.null.copy()
    for i in range(2):
        q[m.index["core", "gain", i]] = gain + i
        q[m.index["core", "f1", i]] = pole
    return q


def test_the_search_finds_the_numbers_of_its_own_run_from_far_away() -> None:
    m, r = model(), record()
    scales = np.full(2, 20000.0)
    truth = core(m)
    for i in range(2):
        truth[m.index["dead-zone", "plus", i]] = 0.2
        truth[m.index["dead-zone", "minus", i]] = 0.1
    y = m.run(truth, prepare([r], scales, 1))[0][: len(r)]
    data = prepare([dataclasses.replace(r, y=y)], scales, 1)
    free = (*m.of("core"), *(k for k in m.of("dead-zone") if m.parameters[k].name != "jump"))
    start = core(m, 15.0, -0.6)
    for k in m.of("dead-zone"):
        start[k] = 0.0 if m.parameters[k].name == "jump" else 0.05
    q, cost = search(m, start[None], [free], data, 60, 1e-12)
    np.testing.assert_allclose(q[0][list(free)], truth[list(free)], rtol=1e-5)
    assert cost.sum() < 1e-8 * np.sum(y**2)
    H = information(m, q[0], free, data)
    assert np.all(np.linalg.eigvalsh(H) > 0.0)


def test_records_run_on_their_own_and_padding_does_not_count() -> None:
    m, a, b = model(), record(300, 1), record(200, 2)
    scales, q = np.full(2, 20000.0), core(model())
    both = prepare([a, b], scales, 1)
    runs = both.split(m.run(q, both)[0])
    for r, run in zip((a, b), runs, strict=True):
        alone = m.run(q, prepare([r], scales, 1))[0][: len(r)]
        np.testing.assert_allclose(run, alone, atol=1e-12)
    assert both.weight[500:].sum() == 0.0


def test_a_bound_holds_and_names_with_a_number_on_it_are_not_admitted() -> None:
    m, r = model(), record()
    scales = np.full(2, 20000.0)
    data = prepare([r], scales, 1)
    limit = m.index["coulomb-friction", "level", 0]
    q, _ = search(m, core(m)[None], [(limit,)], data, 20)
    assert m.parameters[limit].lower <= q[0][limit] <= m.parameters[limit].upper
    s = ForwardSelection(m, [r], [r], scales, 1)
    s.origin = core(m)
    row = core(m)
    row[limit] = m.parameters[limit].upper
    assert not s.admissible(s.evaluate(("coulomb-friction",), row, (*s.core, limit)))


def test_little_friction_is_none_at_its_null_however_far_the_search_may_go() -> None:
    m, r = model(), record()
    s = ForwardSelection(m, [r], [r], np.full(2, 20000.0), 1)
    s.origin = core(m)
    level = m.index["coulomb-friction", "level", 0]
    for size, stands in ((0.01, True), (0.0, False)):
        row = core(m)
        row[level] = size * m.parameters[level].upper / HEAVIEST
        node = s.evaluate(("coulomb-friction",), row, (*s.core, level))
        assert s.admissible(node) is stands


def test_a_clip_is_seen_where_one_largest_reading_repeats() -> None:
    rng = np.random.default_rng(5)
    y = 5.0 * rng.standard_normal(2000)
    assert not repeats_at_top(y)
    assert clip_level(y) == np.inf
    assert clip_level(np.clip(y, -6.0, 6.0)) == 6.0
    late = np.clip(y, -6.0, 6.0) + 0.05 * rng.standard_normal(2000)
    assert abs(clip_level(late) - 6.0) < 0.1


def test_a_position_is_known_for_the_integral_of_its_drive() -> None:
    rng = np.random.default_rng(6)
    u = np.repeat(rng.uniform(-1, 1, size=(300, 1)), 20, axis=0)
    v = np.zeros(len(u))
    for k in range(len(u) - 1):
        v[k + 1] = 0.99 * v[k] + 0.01 * u[k, 0]
    made = Record(
        u,
        np.cumsum(v)[:, None] * 0.01,
        0.01,
        (Channel("force"),),
        (Channel("position", "m"),),
        name="axis",
    )
    assert integrates([made])
    assert not integrates([dataclasses.replace(made, y=v[:, None])])
    rate = rates([made], 2)[0]
    assert (rate.output_names, rate.outputs[0].unit, rate.dt) == (("position_rate",), "m/s", 0.02)
    in_mm = dataclasses.replace(made, outputs=(Channel("position", "m", 1e-3, "mm"),))
    assert rates([in_mm], 2)[0].outputs[0].to_file == (pytest.approx(1e3), "mm/s")
    # central differences over ±2 samples of a speed that forgets over 100
    np.testing.assert_allclose(rate.y[:, 0], v[2 : 2 * len(rate) + 2 : 2], atol=0.02)


def test_an_effect_that_was_left_alone_is_accounted_for_though_it_was_no_candidate() -> None:
    # a swap may name what the first round of candidates did not hold
    m, r = model(), record()
    s = ForwardSelection(m, [r], [r], np.full(2, 20000.0), 1)
    s.origin = core(m)
    base, row = s.evaluate((), core(m), s.core), core(m)
    row[m.index["coulomb-friction", "level", 0]] = 1.0
    levels = tuple(m.index["coulomb-friction", "level", i] for i in range(2))
    found = s.account(
        base, s.evaluate(("coulomb-friction",), row, (*s.core, *levels)), m.effects, []
    )
    assert [n.id for n in found] == ["coulomb-friction"]
    assert set(found[0].rivals) == {"coulomb-friction"}
    assert found[0].touched.tolist() == [True, False]


def test_a_lightly_damped_swing_is_followed_by_the_plainest_base() -> None:
    # poles 0.995 exp(±0.12j), 1 % noise: a base of real poles names a stand-in for the swing
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, size=30), 50)
    f1, f2 = -2.0 * 0.995 * np.cos(0.12), 0.995**2
    y = np.zeros(len(u))
    for k in range(2, len(u)):
        y[k] = 0.004 * u[k - 1] + 0.003 * u[k - 2] - f1 * y[k - 1] - f2 * y[k - 2]
    y += 0.01 * np.std(y) * rng.standard_normal(len(y)) + 0.4
    log = Record(u[:, None], y[:, None], 0.02, (Channel("torque"),), (Channel("angle"),), name="a")
    base = fit_baseline([log], None, chain_effects())
    assert base.model.holdout_rmse < 0.02 * np.std(y)


def test_a_lag_below_one_sample_is_the_sampling_and_no_effect() -> None:
    m, r = model(), record()
    s = ForwardSelection(m, [r], [r], np.full(2, 20000.0), 1)
    s.origin = core(m)
    for id in ("input-delay", "actuator-lag", "sensor-lag"):
        slots = m.of(id)[:2]
        for samples, stands in ((0.5, False), (1.5, True)):
            row = core(m)
            row[list(slots)] = samples * m.dt
            node = s.evaluate((id,), row, (*s.core, *slots))
            assert s.admissible(node) == stands, (id, samples)
            row[slots[1]] = 0.5 * m.dt
            assert beyond_sampling(m, id, row).tolist() == [stands, False]


def test_a_share_of_the_largest_command_is_told_in_the_unit_of_the_input() -> None:
    # throttle up to 80 %: a share of that is no share of full throttle
    m = FullModel(chain_effects(), 1, 1, np.array([10.0]), 0.05)
    u = np.full((100, 1), 80.0)
    u[50:] = 20.0
    log = Record(u, 0.0 * u, 0.05, (Channel("throttle", "%"),), (Channel("v", "m/s"),), name="a")
    scales = np.array([80.0])
    s = ForwardSelection(m, [log], [log], scales, 1)
    row, at = m.null.copy(), m.index["input-saturation", "plus", 0]
    row[m.index["core", "gain", 0]], row[m.index["core", "f1", 0]] = 20.0, -0.8
    row[at] = 0.75
    node = s.evaluate(("input-saturation",), row, (*s.core, at))
    base = Base(divided([log], None), s, node, "")
    value = values_of(base, node, "input-saturation", {at: Interval(0.7, 0.8)})[0]
    assert (value.value, value.unit) == (0.75, "drive")
    assert value.in_log_units.shown == "= 60 (56 to 64) %"
    assert plain(value)["in_file"]["interval"] == pytest.approx([56.0, 64.0])
