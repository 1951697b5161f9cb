"""Every registered structure against every law. A new one is tested by being registered."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler
from cases import CASES, Case, case_of, fitted, model_of, records_of
from hand_made import hand_made
from problem_cases import problems_of

from sysid.data.record import Array
from sysid.fitting.problem import Focus, Problem
from sysid.runners.compiled import jax_module
from sysid.structures import special_runs
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.model import Model
from sysid.structures.motion import LONGEST_HEAD, initial_state_window, time_constants
from sysid.structures.registry import (
    MADE,
    structure_classes,
    structure_from_json,
    structure_to_json,
)
from sysid.structures.special_runs import rest, stable_each, traced_step

REGISTERED = [*structure_classes(), *MADE]

every = pytest.mark.parametrize("name", [n for n in REGISTERED if n in CASES])
every_quick = pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            n, marks=pytest.mark.slow if n in ("augmented", "tanks", "wiener-hammerstein") else ()
        )
        for n in REGISTERED
        if n in CASES
    ],
)
"""Every structure; those whose fit takes seconds among the slow tests."""
LONG = ("augmented", "tanks", "wiener-hammerstein")
moving = pytest.mark.parametrize(
    "name", [n for n in REGISTERED if n in CASES and case_of(n).structure.nu]
)

each_focus = pytest.mark.parametrize(
    ("name", "focus"),
    [
        (n, focus)
        for n in REGISTERED
        if n in CASES
        for focus in Focus
        if case_of(n).structure.nu or focus is Focus.PREDICTION
    ],
)

LONG = 3000
"""Samples of a long run: over a hundred of the slowest time constants of every case."""


def test_every_registered_structure_has_a_case() -> None:
    missing = [n for n in REGISTERED if n not in CASES]
    assert not missing, (
        f"no law is tried on {', '.join(missing)}: add a small truth of it to tests/laws/cases.py"
    )


# ------------------------------------------------------------------------------- fits


@pytest.mark.slow
@every
def test_its_own_truth_is_recovered(name: str) -> None:
    """θ within its errors, and the free run under fresh inputs well inside the noise."""
    case, model = case_of(name), model_of(name)
    assert model.termination.good
    if case.unique:
        for truth, p in zip(case.theta, model.parameter_table(), strict=True):
            # 4.5 standard errors of some 30 parameters: a false alarm in 5000 choices of seeds;
            # a thousandth of a grey box is what its integration may differ by
            assert abs(p.value - truth) <= 4.5 * p.std_error + 1e-3 * abs(truth), p.name
    u = case.inputs(case.samples, 9)
    off = model.structure.simulate(model.theta, u) - case.structure.simulate(case.theta, u)
    # n parameters cost sqrt(n / N) of the noise; an equation's noise grows at most threefold in
    # the free runs of these cases
    n, samples = np.sum([p.fixed is None for p in model.parameters]), 2 * case.samples
    assert np.sqrt(np.mean(off**2)) <= 3.0 * 2.0 * case.noise * np.sqrt(n / samples)


@every_quick
def test_a_saved_model_is_the_same_model(name: str, tmp_path: Path) -> None:
    model, (record, _) = model_of(name), records_of(name)
    model.save(tmp_path / "a.json")
    again = Model.load(tmp_path / "a.json")
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert again.structure == model.structure
    assert structure_from_json(structure_to_json(model.structure)) == model.structure
    np.testing.assert_array_equal(again.theta, model.theta)
    np.testing.assert_array_equal(again.simulate(record.u), model.simulate(record.u))
    np.testing.assert_array_equal(again.predict(record, 5, 20), model.predict(record, 5, 20))


@every_quick
def test_units_of_the_channels_do_not_matter(name: str) -> None:
    """Powers of two, so that rounding is the same and only the searches' paths differ."""
    case, (record, other) = case_of(name), records_of(name)
    of_u, of_y = 16.0, 0.125
    scaled = tuple(replace(r, u=of_u * r.u, y=of_y * r.y, sha256="") for r in (record, other))
    if case.scaled is not None:
        case = case.scaled(case, of_u, of_y)
    found, model = fitted(case, scaled), model_of(name)
    u = case_of(name).inputs(200, 5)
    run = model.simulate(u)
    # far inside the noise: searches end within their tolerance of one minimum
    np.testing.assert_allclose(found.simulate(of_u * u) / of_y, run, atol=0.1 * case.noise)


# ------------------------------------------------------------------------------- problems


def settled_problems(case: Case, records: tuple, focus: Focus) -> tuple[Problem, ...]:  # type: ignore[type-arg]
    return tuple(p.given(case.theta) for p in problems_of(case.structure, records, focus))


@each_focus
def test_several_records_are_one_joined_problem(name: str, focus: Focus) -> None:
    """From rest, the errors of two records together are those of each.

    The second is the first with its outputs turned round, so that all spread alike.
    """
    case, first = case_of(name), records_of(name)[0]
    records = (first, replace(first, y=-first.y, sha256=""))
    joined = settled_problems(case, records, focus)
    apart = [settled_problems(case, (r,), focus) for r in records]
    for both, *single in zip(joined, *apart, strict=True):
        if not len(both.index):  # nothing of a moving average is seen in its free run
            continue
        theta = 1.01 * case.theta
        found = [np.sort(p.residual(p.initial_guess(theta))) for p in (both, *single)]
        each = np.sort(np.concatenate(found[1:]))
        # one weight of all errors, such as 1 over the spread of the outputs, changes no minimum
        weight = np.linalg.norm(each) / max(float(np.linalg.norm(found[0])), 1e-300)
        np.testing.assert_allclose(weight * found[0], each, atol=1e-9 * np.ptp(each))


@each_focus
def test_slopes_of_the_errors_are_those_of_differences(name: str, focus: Focus) -> None:
    case, (record, _) = case_of(name), records_of(name)
    for problem in settled_problems(case, (record.rows(0, 120),), focus):
        p = problem.initial_guess(case.theta)
        if not len(p):
            continue
        free = np.array([q.fixed is None for q in parameters_of(case)])[problem.index]
        found, rough = problem.jacobian(p)[:, free], differences(problem, p)[:, free]
        size = np.max(np.abs(rough), axis=0) + 1e-12
        error = np.abs(found - rough) / size
        # a kink (dead zone, rim of a tank) lies inside the difference of a few samples at most
        assert np.median(error) < 1e-5
        assert np.mean(error > 1e-3) < 0.05


def parameters_of(case: Case) -> tuple:  # type: ignore[type-arg]
    model = hand_made(case.structure, case.theta)
    return model.parameters


def differences(problem: Problem, p: Array) -> Array:
    """∂ε/∂p by central differences."""
    columns = []
    for k in range(len(p)):
        h = np.zeros(len(p))
        h[k] = 1e-5 * max(abs(p[k]), 0.1)
        columns.append((problem.residual(p + h) - problem.residual(p - h)) / (2.0 * h[k]))
    return np.array(columns).T


# ------------------------------------------------------------------------------- runs


@every
def test_the_step_is_the_simulation(name: str) -> None:
    case = case_of(name)
    s, theta = case.structure, case.theta
    u, step, x = case.inputs(150, 4), s.step(theta), rest(s, theta)
    assert len(x) == s.n_states(theta)
    rows, readout = [], special_runs.readout(s, theta)
    for row in u:
        read = readout(x, row)
        x, y = step(x, row)
        np.testing.assert_array_equal(read, y)
        rows.append(np.array(y, dtype=np.float64))
    # the same operations in another order
    np.testing.assert_allclose(np.array(rows), s.simulate(theta, u), rtol=1e-9, atol=1e-9)


@moving
def test_many_parameters_run_compiled_as_one_after_the_other(name: str) -> None:
    """The step of traced parameters, three of them side by side, is the step of each."""
    case, jax = case_of(name), jax_module()
    if isinstance(case.structure, ContinuousStructure):
        pytest.skip("how many states wait in a dead time follows from θ: its runs are not compiled")
    s = case.structure
    u, start = case.inputs(25, 4), rest(s, case.theta)
    thetas = case.theta * (1.0 + 1e-3 * np.arange(3)[:, None])
    assert stable_each(s, thetas).tolist() == [s.stable(theta) for theta in thetas]

    @jax.jit
    @jax.vmap
    def run(theta: Any) -> Any:
        return jax.lax.scan(traced_step(s, theta, case.theta), jax.numpy.asarray(start), u)[1]

    for theta, together in zip(thetas, run(thetas), strict=True):
        step, x = s.step(theta), start
        for row, y_together in zip(u, np.asarray(together), strict=True):
            x, y = step(x, row)
            # some tens of steps, each rounded otherwise
            np.testing.assert_allclose(y_together, y, rtol=1e-10, atol=1e-10)


@every
def test_long_horizons_predict_what_the_free_run_simulates(name: str) -> None:
    case, (record, _) = case_of(name), records_of(name)
    s, theta = case.structure, case.theta
    slowest = float(np.max(time_constants(s, theta), initial=3.0))
    horizon = int(20.0 * slowest)  # e^-20 of what was measured before is left
    run = s.simulate(theta, record.u)
    far = s.predict(theta, record.u, record.y, horizon, 0)
    kept = ~np.isnan(far[:, 0])
    kept[:horizon] = False
    assert np.count_nonzero(kept) > 50
    scale = float(np.std(record.y))
    np.testing.assert_allclose(far[kept], run[kept], atol=1e-6 * scale)
    if s.traits.has_noise_model:  # and the next sample is told better by what was measured
        near = s.predict(theta, record.u, record.y, 1, 0)
        missed = [np.nanstd((record.y - p)[kept]) for p in (near, far)]
        assert missed[0] < missed[1]


@needs_compiler
@moving
def test_the_c_code_is_the_python_plant(name: str, tmp_path: Path) -> None:
    case = case_of(name)
    model = hand_made(
        case.structure, case.theta, reach=(case.level - case.span, case.level + case.span)
    )
    u = case.inputs(150, 4)
    program = build(tmp_path, model, "driver")["driver"]
    run = case.structure.simulate(case.theta, u)
    # other orders of addition and another libm
    np.testing.assert_allclose(driven(program, u), run, atol=1e-9 * float(np.ptp(run)))


@moving
def test_stable_means_bounded_on_a_long_run(name: str) -> None:
    case = case_of(name)
    s, u = case.structure, case.inputs(LONG, 6)
    u[LONG // 2 :] = case.level + case.span  # and one end held
    assert s.stable(case.theta)
    run = np.abs(s.simulate(case.theta, u))
    # whatever settles is as large after a hundred time constants as at first
    assert np.all(run[LONG // 2 :] <= 2.0 * np.max(run[: LONG // 2]) + case.noise)


@every
def test_what_runs_away_is_not_called_stable(name: str) -> None:
    case = case_of(name)
    if case.runaway is None:
        pytest.skip("no parameters make it run away")
    assert not case.structure.stable(case.runaway)
    assert not case.structure.stable(np.full(len(case.theta), np.nan))


@every
def test_time_constants_decide_how_long_a_head_is(name: str) -> None:
    """A state is fitted over two of the slowest time constants, if there is any."""
    case = case_of(name)
    s = case.structure
    if case.slow is None:
        assert s.n_states(case.theta) == 0
        assert initial_state_window(s, case.theta) == 0
        return
    if case.untold:
        pytest.skip(case.untold)
    slow = float(np.max(np.abs(time_constants(s, case.slow))))
    assert initial_state_window(s, case.slow) == int(min(2.0 * slow, LONGEST_HEAD))
    assert initial_state_window(s, case.slow) > 2 * initial_state_window(s, case.theta)


@every
def test_time_constants_are_those_of_the_free_run(name: str) -> None:
    """What a state still does after the slowest time constants is 1/e of what it did."""
    case = case_of(name)
    s, theta = case.structure, case.slow
    if theta is None or case.untold:
        pytest.skip(case.untold or "nothing moves without noise")
    slowest = float(np.max(time_constants(s, theta)))
    n = int(3.0 * slowest)
    u = np.full((n, s.nu), case.level)
    x = rest(s, theta)
    driven_x, step = x, s.step(theta)
    for row in case.inputs(30, 3):
        driven_x, _ = step(driven_x, row)
    away = np.abs(s.simulate(theta, u, driven_x) - s.simulate(theta, u, settled(case, theta)))
    early, late = away[int(slowest)].max(), away[int(2.0 * slowest)].max()
    # a factor of e, to a third for what bends on the way
    assert np.exp(-1.33) < late / early < np.exp(-0.66)


def settled(case: Case, theta: Array) -> Array:
    """State after a long time at the middle of the input."""
    x, step = rest(case.structure, theta), case.structure.step(theta)
    for _ in range(int(20 * np.max(time_constants(case.structure, theta)))):
        x, _ = step(x, np.full(case.structure.nu, case.level))
    return x
