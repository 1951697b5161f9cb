"""The C code of nonlinear plants does what the Python plants do, to rounding."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler, worst_error
from hand_made import DT, hand_made

from sysid.data.record import Array
from sysid.effects.catalogue import chain_effects
from sysid.errors import ModelError
from sysid.export.c.parameters import theta_numbers
from sysid.export.c.step import c_sources, c_step, tunable_parameters
from sysid.export.package import package_files
from sysid.plant.package import CARD
from sysid.plant.selftest import make_selftest
from sysid.runners.compiled import jax_module
from sysid.runners.trace.program import Program
from sysid.runners.trace.traced import TRACE, Traced
from sysid.structures.augmented.given_base import GivenBase
from sysid.structures.augmented.structure import Augmented
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.static.kinds import KINDS
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.difference_equations.expressions import FUNCTIONS
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.physics import Constant, Physics, Sampling
from sysid.structures.grey_box.structure import GreyBox, grey_box_traits
from sysid.structures.grey_box.tanks import Tanks, TanksPhysics
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_network import KINDS as ESTIMATORS
from sysid.structures.narx.wavelet_network import RowDesign
from sysid.structures.registry import structure_class
from sysid.structures.traits import Traits

EXACT = 1e-10
"""Relative to the output's range: other orders of addition and another libm cost some 1e-16 a
sample, and none of these models amplifies that by more than 1e5 before it forgets it."""


def narmax(text: str, theta: list[float], nu: int = 1, ny: int = 1, **fields: Any) -> Model:
    made = NARMAX.from_orders({"na": [[3] * ny] * ny, "nb": 3, "nk": 0}, nu, ny, {"terms": text})
    return hand_made(replace(made, **fields), np.array(theta), (2.0, 30.0))


def narx(estimator: str, ny: int = 1, additive: bool = False, **options: str) -> Model:
    """Random small networks over scaled regressors, bounded by their limits."""
    rng = np.random.default_rng(len(estimator) + ny)
    degree = {} if estimator == "polynomial" else {"units": "3"}
    made = NarxWavelet.from_orders(
        {"na": 2, "nb": 2, "nk": 1}, 1, ny, {"estimator": estimator, **degree, **options}
    )
    designs = []
    for row in made.rows:
        d = len(row)
        units = 0 if estimator == "polynomial" else 3
        designs.append(
            RowDesign(
                tuple(0.1 * rng.normal(size=d)),
                tuple(0.5 + rng.random(d)),
                (-2.0,) * d,
                (2.0,) * d,
                ((0, 0), (0, 1, d - 1), (1, d - 2)),
                tuple(map(tuple, rng.normal(size=(d, 2)))) if units else (),
                (0, 1, 1)[:units],
                ((0,), (1,), (1,)) if additive else (),
            )
        )
    made = replace(
        made, designs=tuple(designs), output_range=((-1.0, 1.0),) * ny, input_range=((-1.0, 1.0),)
    )
    theta = np.concatenate([0.25 * rng.normal(size=d.n) for d in designs])
    return hand_made(made, theta, (1.0, -3.0))


def large_narx(estimator: str, additive: bool = False) -> Model:
    """A network so large that the code loops over tables: 40 units, 9 regressors, 30 products."""
    rng = np.random.default_rng(3)
    made = NarxWavelet.from_orders(
        {"na": 4, "nb": 5, "nk": 1}, 1, 1, {"estimator": estimator, "units": "40"}
    )
    d, q = len(made.rows[0]), 1 if additive else 3
    design = RowDesign(
        tuple(0.1 * rng.normal(size=d)),
        tuple(0.5 + rng.random(d)),
        (-2.0,) * d,
        (2.0,) * d,
        tuple((j, k) for j in range(d) for k in range(j, d))[:30],
        tuple(map(tuple, np.eye(d) if additive else rng.normal(size=(d, 3)))),
        (0, 1) * 20,
        tuple((k % d,) for k in range(40)) if additive else (),
    )
    made = replace(made, designs=(design,), output_range=((-1.0, 1.0),), input_range=((-1.0, 1.0),))
    n = [1 + d, 30, 40, 40 * (1 + q)]
    scale = np.repeat([0.2, 0.02, 0.02, 1.0], n)
    return hand_made(made, scale * rng.normal(size=sum(n)), (1.0, -3.0))


def every_expression() -> str:
    calls = {1: "{}(u(t-1))", 2: "{}(u(t-1), y(t-2))"}
    named = [calls[count].format(name) for name, (count, _, _) in FUNCTIONS.items()]
    return ", ".join([*named, "|u(t)|", "-y(t-1)^3/4 + 2.5*u(t-1)", "sqrt(|y(t-1)|)*sign(u(t))"])


def static_parameters(kind: str, size: int) -> list[float]:
    if kind in ("piecewise", "spline"):
        x = np.linspace(-1.5, 1.5, size)
        return [*(x if kind == "piecewise" else ()), *np.tanh(x)][-len(KINDS[kind].names(size)) :]
    return {"abs": [0.1], "polynomial": [1.0, 0.3, -0.2][:size]}.get(
        kind, [-0.2, 0.3] if len(KINDS[kind].names(size)) == 2 else [0.4]
    )


def hammerstein_wiener(kind: str, channels: int = 1) -> Model:
    size = {"polynomial": 3, "piecewise": 5, "spline": 6}.get(kind, 0)
    text = f"{kind}:{size}" if size else kind
    made = HammersteinWiener.from_orders(
        {"nb": 2, "nf": 2, "nk": 0 if channels == 1 else 1}, channels, channels,
        {"input": text, "output": f"abs,{text}" if kind != "abs" else "piecewise:4"},
    )  # fmt: skip
    made = replace(made, requested=None)
    own = static_parameters(kind, size)
    after = [0.1, *own] if kind != "abs" else [-1.0, 0.0, 1.0, 2.0, -1.0, 0.0, 2.0, 2.5]
    layers = made.chain.layers
    parts: list[float] = []
    for k, layer in enumerate(layers):
        if k == 1:
            parts += [0.4, -0.1, -1.2, 0.5] * channels**2
            continue
        for c in range(channels):
            parts += own if k == 0 else [*after, *([0.7] if layer.has_y0(c) else [])]  # type: ignore[union-attr]
    return hand_made(made, np.array(parts), (5.0, 2.0), (-2.0, 2.0))


def wiener_hammerstein() -> Model:
    made = WienerHammerstein.from_orders(
        {"nb1": 1, "nf1": 1, "nb": 2, "nf": 2, "nk": 1}, 2, 1, {"static": "dead-zone"}
    )
    first = [0.5, -0.5] * 2
    static = [-0.2, 0.3] * 2
    second = [0.4, -0.1, -1.2, 0.5] * 2
    return hand_made(replace(made, requested=None), np.array([*first, *static, *second, 0.5]))


def motor(
    n: int, numbers: Mapping[str, Any], options: Mapping[str, str], substeps: int = 4
) -> Model:
    physics = MotorPhysics.from_options({"input": "voltage", **options}, n, n)
    reach = 20000.0 if physics.input == "pwm" else 6.0
    made = DCMotor(physics, Sampling(DT, substeps))
    return hand_made(made, physics.pack(dict(numbers)), reach=(-reach, reach))


MOTOR = {
    "gain": 2.0, "time_constant": 0.15, "coulomb": 0.8, "breakaway": 1.6, "stribeck": 0.5,
    "limit": 5.0, "offset": 0.2, "coulomb_back": 1.2, "viscous_back": 1.1, "drag": 0.03,
    "coupling": -0.3,
}  # fmt: skip


def tanks() -> Model:
    made = Tanks(TanksPhysics(1, 1), Sampling(4.0, 4))
    theta = made.physics.pack({"limit1": 2.0, "limit2": 5.0, "d2": 0.1, "k4": 0.01, "k3": 0.2})
    return replace(hand_made(made, theta, reach=(0.0, 3.0)), dt=4.0)


def equations(name: str, unit: str) -> Model:
    """A bundled file of equations at its starts."""
    path = Path(__file__).parents[2] / "datasets" / "equations" / f"{name}.ode.yaml"
    made = structure_class(str(path)).from_orders({}, 1, 1)
    assert isinstance(made, FromFile)
    made = replace(made, sampling=Sampling(DT, 4))
    return hand_made(made, made.physics.pack({}), reach=(0.0, 3.0), unit=unit)


def augmented(effects: tuple[str, ...], order: int = 2, delay: int = 3) -> Model:
    made = Augmented(order, delay, (2.0, 2.0), DT, effects)
    core = [3.0, -1.2, 0.4, 0.1] if order == 2 else [3.0, -0.8]
    sizes = {"lag": 0.03, "delay": 0.07, "speed": 0.4, "ratio": 0.8, "rate": 2.0, "time": 5.0}
    theta = core * 2
    for id in effects:
        e = next(x for x in chain_effects() if x.id == id)
        theta += [sizes.get(p.name, 0.1) for p in e.parameters] * (1 if e.shared else 2)
    return hand_made(made, np.array(theta), reach=(-2.0, 2.0))


def behind(inner: Callable[[], Model]) -> Model:
    """Effects around a model that drives the core."""
    model = inner()
    offsets = np.array([0.2, -0.1]), np.array([0.5, 0.3])
    given = GivenBase(
        model.structure, model.theta, *offsets, np.array([2.0, 1.5]), np.array([-0.7, -0.8])
    )
    made = Augmented(1, 1, (1.0, 1.0), DT, ("dead-zone", "coulomb-friction", "sensor-lag"), given)
    effects = [0.1, 0.12, 0.02] * 2 + [0.05, 0.1, 1.0, 0.0] * 2 + [0.03] * 2
    return hand_made(made, np.array([2.0, -0.7, 1.5, -0.8, *effects]), reach=(-2.0, 2.0))


CASES = {
    "narmax-products": partial(
        narmax, "constant, y(t-1), y(t-2)^2*u(t), u(t-1)^3, e(t-1), u(t-2)*y(t-3)",
        [0.1, 0.6, -0.2, 0.3, 0.5, 0.05],
    ),
    "narmax-held-at-its-limits": partial(
        narmax, "y(t-1), u(t-1)^2", [1.1, 0.5], output_range=((-1.0, 1.0),),
        input_range=((-1.0, 1.0),), input_step=(2.0,),
    ),
    "narmax-several": partial(
        narmax, "y(t-1), u2(t-1)*u(t), y2(t-2); y2(t-1), y(t-1)*y2(t-1), u(t)",
        [0.5, 0.4, 0.1, 0.6, -0.05, 0.3], 2, 2,
    ),
    "narmax-without-memory": partial(narmax, "u(t), u(t)^2", [1.0, -0.4]),
    **{f"narx-{name}": partial(narx, name) for name in ESTIMATORS},
    **{f"large-{name}": partial(large_narx, name) for name in ESTIMATORS if name != "polynomial"},
    "large-additive": partial(large_narx, "wavelet", True),
    "narx-additive": partial(narx, "wavelet", additive=True),
    "narx-several": partial(narx, "wavelet", 2),
    "narx-expressions": partial(narx, "neural", regressors=every_expression()),
    **{f"hw-{kind}": partial(hammerstein_wiener, kind) for kind in KINDS if kind != "identity"},
    "hw-several": partial(hammerstein_wiener, "dead-zone", 2),
    "wh": wiener_hammerstein,
    "motor": partial(motor, 1, MOTOR, {"friction": "full"}),
    "motor-rk4": partial(motor, 1, MOTOR, {"friction": "full", "integrator": "rk4"}, 1),
    "motor-position": partial(motor, 1, MOTOR, {"output": "position"}),
    "motor-tracks": partial(motor, 2, MOTOR, {}),
    "motor-tracks-rk4": partial(motor, 2, MOTOR, {"integrator": "rk4"}),
    "motor-bench": partial(motor, 2, {}, {"parameters": "bench", "input": "pwm"}),
    "tanks": tanks,
    "pendulum.ode": partial(equations, "pendulum", "rad"),
    "two_tanks.ode": partial(equations, "two_tanks", "V"),
    **{f"effect-{e.id}": partial(augmented, (e.id,)) for e in chain_effects()},
    "behind-narx": partial(behind, partial(narx, "wavelet", 2)),
    "behind-hw": partial(behind, partial(hammerstein_wiener, "dead-zone", 2)),
    "behind-motor": partial(behind, partial(motor, 2, MOTOR, {})),
    "effects-of-every-place": partial(
        augmented, ("dead-zone", "stiction", "freewheel", "speed-ripple"), 1, 1
    ),
}  # fmt: skip


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("case", CASES)
def test_c_equals_python(tmp_path: Path, case: str) -> None:
    model = CASES[case]()
    programs = build(tmp_path, model, "selftest", "driver")
    assert worst_error(programs["selftest"]) < EXACT
    low, high = model.ranges[: len(model.inputs)].T
    rng = np.random.default_rng(7)
    u = (low + (high - low) * rng.random((100, len(low)))).repeat(3, axis=0)
    u[40:80] = 0.5 * (low + high)  # long enough to come to rest
    expected = model.simulate(u)
    moved = np.ptp(expected, axis=0)
    assert np.all(moved > 0)
    np.testing.assert_allclose(
        driven(programs["driver"], u), expected, rtol=0, atol=EXACT * float(np.max(moved))
    )

    other = with_other_numbers(model)
    assert [n.name for n in theta_numbers(model)] == [n.name for n in theta_numbers(other)]
    changed = [t.value for t in tunable_parameters(other)]
    assert len(changed) == len(tunable_parameters(model))
    expected = other.simulate(u)
    outputs = driven(programs["driver"], u, changed)
    assert not np.allclose(outputs, model.simulate(u), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        outputs, expected, rtol=0, atol=EXACT * float(np.max(np.ptp(expected, axis=0)))
    )


def with_other_numbers(model: Model) -> Model:
    """The model with every number of θ, and of a model inside, moved by up to a hundredth."""
    rng = np.random.default_rng(11)

    def moved(theta: Array) -> Array:
        return np.asarray(theta * (1.0 + 0.01 * rng.random(len(theta))))

    structure = model.structure
    if isinstance(structure, Augmented) and structure.given is not None:
        given = replace(structure.given, theta=moved(structure.given.theta))
        structure = replace(structure, given=given)
    return replace(model, structure=structure, theta=moved(model.theta))


@pytest.mark.parametrize(
    "case",
    ["narmax-products", "narx-expressions", "hw-spline", "motor", "effect-backlash", "behind-hw"],
)
def test_a_step_runs_in_jax_as_in_numpy(case: str) -> None:
    jnp = jax_module().numpy
    model = CASES[case]()
    step = model.structure.step(model.theta)
    rng = np.random.default_rng(1)
    x = 0.3 * rng.normal(size=model.structure.n_states(model.theta))
    u = rng.normal(size=len(model.inputs))
    for result, expected in zip(step(jnp.asarray(x), jnp.asarray(u)), step(x, u), strict=True):
        # one step: some 1e-16 of numbers of size one
        np.testing.assert_allclose(np.asarray(result), expected, rtol=0, atol=1e-12)


@needs_compiler
def test_a_wrong_number_is_seen(tmp_path: Path) -> None:
    model = motor(1, MOTOR, {})
    build(tmp_path, model)
    wrong = motor(1, MOTOR | {"gain": 2.0 + 1e-6}, {})
    (tmp_path / "plant.c").write_text(c_sources(wrong, make_selftest(wrong))["plant.c"])
    import subprocess

    from c_programs import COMPILER, FLAGS

    command = [str(COMPILER), *FLAGS, "-o", "selftest", "plant.c", "selftest.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert float(done.stdout) > 1e-8


def test_packages_of_nonlinear_plants_hold_the_code_and_say_how_to_build_it() -> None:
    files = package_files(tanks())
    assert {"c/plant.h", "c/plant.c", "c/selftest.c"} <= set(files)
    assert "cc -std=c99" in files[CARD].decode()
    for forbidden in ("malloc", "printf", "extern double"):
        assert forbidden not in files["c/plant.c"].decode()


class _Filling(Physics):
    """A tank written in a way of which C knows nothing."""

    way: ClassVar[str] = "sinc"

    @property
    def constants(self) -> tuple[Constant, ...]:
        return (Constant("k"),)

    @property
    def state_names(self) -> tuple[str, ...]:
        return ("h",)

    def rates(self, xp: Any, x: Any, u: Any, p: Mapping[str, Any]) -> Any:
        if self.way == "sinc":
            return xp.sinc(x) + u
        return u - x if x > 1.0 else u - p["k"] * x

    def reading(self, xp: Any, x: Any, p: Mapping[str, Any]) -> Any:
        return x

    def first_guess(self, records: Any) -> Any:
        return ()


class _Float(_Filling):
    way: ClassVar[str] = "float"

    def reading(self, xp: Any, x: Any, p: Mapping[str, Any]) -> Any:
        return np.array([[float(x[0, 0])]])


class _Deciding(_Filling):
    way: ClassVar[str] = "if"


class _Box(GreyBox[_Filling]):
    name: ClassVar[str] = "filling"
    traits: ClassVar[Traits] = grey_box_traits(
        title="Filling",
        equation="dh/dt = u - k h",
        when="tests",
    )


def filling(kind: type[_Filling]) -> Model:
    return hand_made(_Box(kind(1, 1), Sampling(DT, 1)), np.array([0.5]))


@pytest.mark.parametrize(
    ("kind", "words"), [(_Filling, "use sinc"), (_Deciding, "xp.where"), (_Float, "xp.stack")]
)
def test_what_c_cannot_say_is_refused_in_words(kind: type[_Filling], words: str) -> None:
    model = filling(kind)
    assert words in why_no_c_code(model)
    with pytest.raises(ModelError, match="cannot be written as C"):
        c_sources(model, make_selftest(motor(1, MOTOR, {})))


def why_no_c_code(model: Model) -> str:
    with pytest.raises(ModelError) as caught:
        c_step(model)
    return str(caught.value)


def test_a_package_without_code_says_why() -> None:
    model = filling(_Filling)
    files = package_files(model)
    assert not any(name.startswith("c/") for name in files)
    card = files[CARD].decode()
    assert f"There is no C code: {why_no_c_code(model)}." in card
    assert "cc -std=c99" not in card


def test_recording_leaves_out_what_is_not_needed_and_computes_numbers_at_once() -> None:
    program = Program()
    x = Traced(program.inputs("x", 2))
    unused = TRACE.exp(x[0])
    y = 1.0 * x[1] + 0.0 * x[0] + np.float64(2.0) * (np.ones(1) + 1.0)
    assert unused.shape == ()
    assert list(program.lines(y.cells.ravel())) == [
        "const double t1 = x[1];",
        "const double t3 = t1 + 4.0;",
    ]
    assert TRACE.maximum(1.0, np.array([0.0, 3.0])).tolist() == [1.0, 3.0]
