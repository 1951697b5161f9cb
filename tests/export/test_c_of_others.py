"""C for structures that are not ours: from their step, or their own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler, worst_error
from hand_made import hand_made

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.export.c.step import c_step
from sysid.structures import special_runs
from sysid.structures.linear.families import ARX
from sysid.structures.special_runs import CStep

Step = Callable[[Any, Any], tuple[Any, Any]]


def over_namespace(x: Any, u: Any) -> tuple[Any, Any]:
    """Written over the arrays' namespace."""
    xp = x.__array_namespace__()
    y = 0.8 * x[:1] - 0.1 * xp.tanh(x[1:]) + xp.where(u > 0.3, u - 0.3, 0.0)
    return xp.concatenate([y, xp.clip(x[:1], -0.5, 0.5)]), y


def in_numpy(x: Any, u: Any) -> tuple[Any, Any]:
    """As somebody writes it who thinks of NumPy alone: its functions, an array filled by index."""
    after = np.roll(x, 1)
    y = 0.7 * x[0] + np.sin(u[0]) * np.exp(-np.abs(x[1])) / (1.0 + x[1] ** 2)
    after[0] = y
    return after, np.array([y])


WEIGHTS = np.random.default_rng(5).normal(size=(40, 3))


def network(x: Any, u: Any) -> tuple[Any, Any]:
    """A hidden layer of 40, with a norm and a largest value over it: loops."""
    hidden = np.tanh(WEIGHTS @ np.concatenate([x, u]))
    y = 0.3 * np.mean(hidden) - 0.2 * np.max(hidden, axis=0) + 0.1 * np.sqrt(np.sum(hidden**2))
    return np.stack([y, x[0]]), np.stack([y])


def table(x: Any, u: Any) -> tuple[Any, Any]:
    """A table that is looked up by a signal."""
    xp = x.__array_namespace__()
    points, values = np.linspace(-1.0, 1.0, 9), xp.asarray(np.linspace(-1.0, 1.0, 9) ** 3)
    k = xp.clip(xp.searchsorted(points, u, side="right") - 1, 0, 7)
    y = 0.5 * x[:1] + values[k]
    return xp.concatenate([y, x[:1]]), y


class _Theirs(ARX):
    """Somebody's structure: all that C looks at is its step."""

    name: ClassVar[str] = "theirs"
    advance: ClassVar[Step] = over_namespace

    def n_states(self, theta: Array) -> int:
        return 2

    def step(self, theta: Array) -> Step:
        return type(self).advance

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        x, y = np.zeros(2), np.zeros((len(u), 1))
        for k, now in enumerate(u):
            x, y[k] = type(self).advance(x, now)
        return y


def theirs(way: Step, kind: type[_Theirs] = _Theirs) -> Any:
    made = type("Made", (kind,), {"advance": staticmethod(way)})
    return hand_made(made.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1), np.array([0.5, 0.5]))


@needs_compiler
@pytest.mark.parametrize("way", [over_namespace, in_numpy, network, table])
def test_c_is_recorded_from_the_step_of_any_structure(tmp_path: Path, way: Step) -> None:
    model = theirs(way)
    programs = build(tmp_path, model, "selftest", "driver")
    u = np.random.default_rng(2).uniform(-1.0, 1.0, size=(200, 1))
    expected = model.simulate(u)
    # another libm and another order of sums: 1e-16 a sample, forgotten in a few samples
    np.testing.assert_allclose(driven(programs["driver"], u), expected, rtol=0, atol=1e-13)
    assert worst_error(programs["selftest"]) < 1e-13


def test_code_of_a_network_does_not_grow_with_its_units() -> None:
    lines = len(c_step(theirs(network)).body)
    assert lines < 60  # 40 units of 3 weights written out would take 240


@needs_compiler
def test_a_structure_may_bring_c_of_its_own(tmp_path: Path) -> None:
    class Own(_Theirs):
        pass

    @special_runs.c_step.register
    def _(structure: Own, theta: Array) -> CStep:
        body = ("    x[0] = theirs(x[0], v[0]);", "    out[0] += x[0];")
        support = (
            "static double theirs(double x, double v)",
            "{",
            f"    return {theta[0]!r} * x + 0.25 * v;".replace("np.float64(0.5)", "0.5"),
            "}",
            "",
        )
        return CStep(1, ("By hand.",), body, support)

    def way(x: Any, u: Any) -> tuple[Any, Any]:
        return np.array([0.5 * x[0] + 0.25 * u[0], 0.0]), np.array([0.5 * x[0] + 0.25 * u[0]])

    build_and_check = build(tmp_path, theirs(way, Own), "selftest")
    assert worst_error(build_and_check["selftest"]) < 1e-14
    assert "By hand." in (tmp_path / "plant.c").read_text()


def filled(x: Any, u: Any) -> tuple[Any, Any]:
    after = np.zeros(2)
    after[0] = x[0] + u[0]
    return after, after[:1]


def decided(x: Any, u: Any) -> tuple[Any, Any]:
    return (x, x[:1]) if u[0] > 0 else (0.5 * x, x[:1])


def misshapen(x: Any, u: Any) -> tuple[Any, Any]:
    return x[:1], x[:1]


def unknown(x: Any, u: Any) -> tuple[Any, Any]:
    return np.sort(x), x[:1]


def broken(x: Any, u: Any) -> tuple[Any, Any]:
    return x[5], x[:1]


@pytest.mark.parametrize(
    ("way", "words"),
    [
        (filled, "xp.stack"),
        (decided, "xp.where"),
        (misshapen, "a step gives states (1,)"),
        (unknown, "use sort, for which there is no C"),
        (broken, "index 5 is out of bounds"),
    ],
)
def test_what_cannot_be_recorded_is_refused_in_one_sentence(way: Step, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        c_step(theirs(way))
    assert words in str(caught.value)
    assert "cannot be written as C" in str(caught.value)
    assert "\n" not in str(caught.value)
