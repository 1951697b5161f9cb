"""One small truth of every registered structure, on which the laws are tried.

A structure is tested by being registered: ``test_laws`` walks the registry and asks here for the
case of each name. To add one, add a function to ``CASES``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.grey_box.dc_motor.structure import DCMotor
from sysid.structures.grey_box.file.physics import FilePhysics
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.grey_box.tanks import Tanks
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_network import RowDesign
from sysid.structures.registry import structure_class

DT = 0.1


@dataclass(frozen=True, eq=False)
class Case:
    """A truth, and how a fit is asked for it.

    Attributes:
        structure: with everything that a fit would have read off data.
        theta: its parameters.
        asked: what is given to the fit.
        slow: θ with a slower motion; None where no initial state is ever fitted.
        runaway: θ whose free run is unbounded; None where there is none.
        level, span: input, random levels of level ± span.
        noise: standard deviation of the errors.
        options: of the fit.
        unique: whether the data tell θ itself, not only the run.
        samples: of each record.
        warm: whether the fit begins at given values.
        untold: why time constants are not known.
        scaled: the case in other units of input and output, where it holds numbers in units.
    """

    structure: Structure
    theta: Array
    asked: Structure
    slow: Array | None
    runaway: Array | None
    level: float = 0.0
    span: float = 1.0
    noise: float = 0.02
    options: FitOptions = field(default_factory=FitOptions)
    unique: bool = True
    samples: int = 400
    warm: bool = False
    untold: str = ""
    scaled: Callable[["Case", float, float], "Case"] | None = None

    def inputs(self, samples: int, seed: int) -> Array:
        """Random levels held for three samples, after one of rest."""
        rng = np.random.default_rng(seed)
        held = rng.uniform(-1.0, 1.0, (samples // 3 + 1, self.structure.nu))
        return self.level + self.span * np.repeat(held, 3, axis=0)[:samples]

    def record(self, seed: int, samples: int | None = None) -> Record:
        """A log from rest whose one-step errors are white with ``noise``."""
        n = samples or self.samples
        u = self.inputs(n, seed)
        e = self.noise * np.random.default_rng(seed + 1000).standard_normal((n, self.structure.ny))
        inputs = tuple(Channel(f"u{k + 1}", "V") for k in range(u.shape[1]))
        return Record(u, driven_by(self.structure, self.theta, u, e), DT, inputs)


def driven_by(structure: Structure, theta: Array, u: Array, e: Array) -> Array:
    """y (N, ny) whose one-step errors are e; samples without prediction keep the free run."""
    y = structure.simulate(theta, u)
    if not structure.traits.has_noise_model:
        return y + e
    for t in range(len(u)):  # a prediction looks back only: the first miss is the error itself
        y[t] += np.nan_to_num(e[t] - structure.errors(theta, u[: t + 1], y[: t + 1], 0)[t])
    return y


@cache
def case_of(name: str) -> Case:
    """The case of a structure."""
    return CASES[name]()


@cache
def records_of(name: str) -> tuple[Record, Record]:
    """Its two estimation records."""
    case = case_of(name)
    return case.record(1), case.record(2)


def fitted(case: Case, records: tuple[Record, ...]) -> Model:
    """The fit that the case asks for."""
    initial_guesses = [("near the truth", 1.05 * case.theta)] if case.warm else []
    nothing = Detrend.none(case.structure.nu, case.structure.ny)
    return fit(case.asked, records, case.options, detrend=nothing, initial_guesses=initial_guesses)


@cache
def model_of(name: str) -> Model:
    """The fit of both records."""
    return fitted(case_of(name), records_of(name))


# ------------------------------------------------------------------------------- truths

LOCAL = "a map of lagged signals has a time constant only about each point; its head is three lags"


def _polynomial(
    name: str,
    orders: Mapping[str, int],
    theta: list[float],
    slow: list[float] | None,
    runaway: list[float] | None,
) -> Case:
    nu = int(structure_class(name).traits.takes_inputs)
    made = structure_class(name).from_orders(orders, nu, 1)
    own = [None if t is None else np.array(t) for t in (slow, runaway)]
    return Case(made, np.array(theta), made, *own, noise=0.1)


def _narx() -> Case:
    """A line with one product, solved directly."""
    options = {"degree": "2", "units": "0", "refine": "none"}
    plain = NarxWavelet.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1, options)
    design = RowDesign((0.0,) * 2, (1.0,) * 2, (-4.0,) * 2, (4.0,) * 2, ((0, 1),))
    truth = replace(
        plain, designs=(design,), output_range=((-3.0, 3.0),), input_range=((-1.0, 1.0),)
    )
    theta = np.array([0.05, 0.6, 0.5, -0.1])
    slow, runaway = np.array([0.0, 0.97, 0.03, 0.0]), np.array([0.05, 1.2, 0.5, 0.0])
    return Case(truth, theta, plain, slow, runaway, unique=False, untold=LOCAL)


def _narmax() -> Case:
    """Terms given, so that the fit finds coefficients alone."""
    terms = {"terms": "y(t-1), u(t-1), u(t-1)*y(t-1)", "selection": "err"}
    plain = NARMAX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1, terms)
    truth = replace(
        plain, output_range=((-3.0, 3.0),), input_range=((-1.0, 1.0),), input_step=(2.0,)
    )
    slow, runaway = np.array([0.97, 0.03, 0.0]), np.array([1.2, 0.5, 0.0])
    theta = np.array([0.6, 0.5, -0.1])
    return Case(truth, theta, plain, slow, runaway, untold=LOCAL)


def _hammerstein_wiener() -> Case:
    orders = {"nb": 1, "nf": 1, "nk": 1}
    options = {"input": "dead-zone", "output": "identity"}
    made = structure_class("hammerstein-wiener").from_orders(orders, 1, 1, options)
    return Case(
        _settled(made),
        np.array([-0.2, 0.3, 0.5, -0.7, 0.0]),
        made,
        np.array([-0.2, 0.3, 0.05, -0.97, 0.0]),
        np.array([-0.2, 0.3, 0.5, -1.1, 0.0]),
        unique=False,
    )


def _wiener_hammerstein() -> Case:
    orders = {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, "nk": 1}
    made = structure_class("wiener-hammerstein").from_orders(orders, 1, 1, {"static": "dead-zone"})
    return Case(
        _settled(made),
        np.array([0.5, -0.5, -0.2, 0.3, 0.5, -0.7, 0.0]),
        made,
        np.array([0.5, -0.5, -0.2, 0.3, 0.05, -0.97, 0.0]),
        np.array([0.5, -0.5, -0.2, 0.3, 0.5, -1.1, 0.0]),
        unique=False,
    )


def _settled(made: Structure) -> Structure:
    """A block structure as one that has its own statics, not those somebody asked for."""
    return replace(made, requested=None)  # type: ignore[call-arg]


def _dc_motor() -> Case:
    plain = structure_class("dc-motor").from_orders(
        {}, 1, 1, {"friction": "none", "input": "voltage", "output": "speed", "substeps": "1"}
    )
    assert isinstance(plain, DCMotor)
    truth = replace(plain, sampling=Sampling(DT, 1, ((-1.0, 1.0),)))
    theta, slow, runaway = (
        plain.physics.pack({"gain": 2.0, "time_constant": tau}) for tau in (0.3, 5.0, -0.3)
    )
    return Case(truth, theta, plain, slow, runaway)


def _tanks() -> Case:
    plain = structure_class("tanks").from_orders({}, 1, 1, {"substeps": "2"})
    assert isinstance(plain, Tanks)
    truth = replace(plain, sampling=Sampling(DT, 2, ((0.0, 5.0),)))
    own = {"k1": 2.0, "k2": 1.6, "k3": 1.5, "limit1": 4.0, "share": 0.4}
    theta, slow, runaway = (
        plain.physics.pack(own | more)
        for more in ({}, {"k1": 0.2, "k2": 0.16, "k3": 0.075}, {"k2": -1.6, "limit2": 1e9})
    )
    return Case(truth, theta, plain, slow, runaway, level=2.5, span=2.5, unique=False)


MOTOR_FILE = """
inputs: {u: }
states: {w: {}}
parameters:
  gain: {start: 1.5}
  tau: {start: 0.5, bounds: [-10, 10]}
equations: {w: (gain*u - w)/tau}
outputs: {y: {equation: w}}
"""


def _in_seconds(name: str, orders: Mapping[str, int], truth: Sequence[float]) -> Case:
    """A first-order lag with dead time, of which the second number decides how slow it is."""
    plain = structure_class(name).from_orders(orders, 1, 1)
    assert isinstance(plain, ContinuousStructure)
    theta = np.array(truth)
    pole = {"process": (5.0, -0.3), "tf": (0.2, -3.0)}[name]
    slow, runaway = (np.array([truth[0], p, truth[2]]) for p in pole)
    return Case(replace(plain, dt=DT), theta, plain, slow, runaway)


def _ode() -> Case:
    plain = FromFile(FilePhysics(1, 1, MOTOR_FILE), Sampling(substeps=1))
    truth = replace(plain, sampling=Sampling(DT, 1, ((-1.0, 1.0),)))
    theta, slow, runaway = (np.array([2.0, tau]) for tau in (0.3, 5.0, -0.3))
    return Case(truth, theta, plain, slow, runaway)


def _augmented() -> Case:
    made = Augmented(1, 1, (1.0,), DT, ("dead-zone",))
    theta, slow, runaway = (np.array([2.0, f, 0.2, 0.1, 0.0]) for f in (-0.7, -0.97, -1.1))

    def scaled(case: Case, of_u: float, of_y: float) -> Case:
        """Full drive in the input's unit, the gain in both."""
        wider = replace(made, scales=(of_u,))
        return replace(case, asked=wider, theta=theta * [of_y, 1.0, 1.0, 1.0, 1.0])

    return Case(made, theta, made, slow, runaway, unique=False, warm=True, scaled=scaled)


CASES: Mapping[str, Callable[[], Case]] = {
    "arx": lambda: _polynomial(
        "arx", {"na": 1, "nb": 1, "nk": 1}, [-0.7, 0.5], [-0.97, 0.5], [-1.1, 0.5]
    ),
    "armax": lambda: _polynomial(
        "armax",
        {"na": 1, "nb": 1, "nc": 1, "nk": 1},
        [-0.7, 0.5, 0.4],
        [-0.97, 0.5, 0.4],
        [-1.1, 0.5, 0.4],
    ),
    "oe": lambda: _polynomial(
        "oe", {"nb": 1, "nf": 1, "nk": 1}, [0.5, -0.7], [0.5, -0.97], [0.5, -1.1]
    ),
    "bj": lambda: _polynomial(
        "bj",
        {"nb": 1, "nc": 1, "nd": 1, "nf": 1, "nk": 1},
        [0.5, 0.4, -0.6, -0.7],
        [0.5, 0.4, -0.6, -0.97],
        [0.5, 0.4, -0.6, -1.1],
    ),
    "ss": lambda: _polynomial(
        "ss",
        {"n": 2},
        [-0.42, 1.3, 0.5, 0.3, 0.5, 0.3],
        [-0.485, 1.47, 0.5, 0.3, 0.5, 0.3],
        [-0.55, 1.6, 0.5, 0.3, 0.5, 0.3],
    ),
    "ar": lambda: _polynomial("ar", {"na": 2}, [-1.2, 0.5], None, [-1.2, 1.1]),
    "arma": lambda: _polynomial("arma", {"na": 1, "nc": 1}, [-0.7, 0.4], None, [-1.1, 0.4]),
    "ma": lambda: _polynomial("ma", {"nc": 1}, [0.5], None, None),
    "narx-wavelet": _narx,
    "narmax": _narmax,
    "hammerstein-wiener": _hammerstein_wiener,
    "wiener-hammerstein": _wiener_hammerstein,
    "dc-motor": _dc_motor,
    "tanks": _tanks,
    "process": lambda: _in_seconds("process", {"np": 1}, [2.0, 0.3, 0.05]),
    "tf": lambda: _in_seconds("tf", {"np": 1}, [7.0, 3.0, 0.05]),
    "ode": _ode,
    "augmented": _augmented,
}
