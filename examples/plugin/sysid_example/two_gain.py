"""A structure: a linear difference equation whose input counts differently in each direction."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Channel, Record
from sysid.errors import Termination, UsageError
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Initial, Parameter, Problem
from sysid.fitting.searchable import InitialGuesses, Searchable, StartReport
from sysid.fitting.uncertainty import uncertainty
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.methods.search import by_search
from sysid.structures.base import NamedStructure, refuse_options
from sysid.structures.motion import poles
from sysid.structures.special_runs import CStep, c_step
from sysid.structures.traits import Traits

INSIDE = 0.999
"""A pole on the unit circle is brought in by so much: it then forgets in a thousand samples."""


@dataclass(frozen=True)
class TwoGain(NamedStructure, Searchable):
    """y(t) = Σ a_k y(t−k) + b⁺ max(u(t−1), 0) + b⁻ min(u(t−1), 0) + e(t); θ = (a₁ … a_na, b⁺, b⁻).

    The state of the free run is the observer form's: y = x₁, x_k⁺ = a_k y + x_(k+1) (+ drive, k=1).

    Attributes:
        na: past outputs in the equation.
    """

    na: int

    name: ClassVar[str] = "two-gain"
    traits: ClassVar[Traits] = Traits(
        title="Linear equation with a gain for each direction of the input",
        equation="A(q) y(t) = b⁺ max(u(t−1), 0) + b⁻ min(u(t−1), 0) + e(t)",
        when="drives that pull harder one way than the other: a worm gear, a hoist",
        order_names=("na",),
        has_noise_model=True,  # 1/A
        # the kink lies at u = 0: nothing may be removed from the data
        physical=True,
    )

    # ------------------------------------------------------------- what users type, what is stored

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with these orders."""
        refuse_options(cls.name, options, ())
        if (nu, ny) != (1, 1):
            raise UsageError(f"{cls.name} needs one input and one output, got {nu} and {ny}")
        if set(raw) != {"na"} or raw["na"] < 1:
            raise UsageError(f"{cls.name} needs one order, na of at least 1, such as na=2")
        return cls(int(raw["na"]))

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Tried where no orders are given."""
        return tuple({"na": n} for n in (1, 2, 3))

    def order_values(self) -> dict[str, Any]:
        """What ``from_orders`` needs to make it again."""
        return {"na": self.na}

    @property
    def nu(self) -> int:
        """One input."""
        return 1

    @property
    def ny(self) -> int:
        """One output."""
        return 1

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names and units of θ."""
        unit = f"{outputs[0].unit or 'y'}/{inputs[0].unit or 'u'}"
        past = [Parameter(f"a{k}") for k in range(1, self.na + 1)]
        return (*past, Parameter("b_plus", unit), Parameter("b_minus", unit))

    # ------------------------------------------------------------- free run

    def n_states(self, theta: Array) -> int:
        """As many as past outputs."""
        return self.na

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y)."""
        a, (plus, minus) = theta[: self.na], theta[self.na :]

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            drive = plus * xp.maximum(u[:1], 0.0) + minus * xp.minimum(u[:1], 0.0)
            shifted = xp.concatenate([x[1:], xp.zeros(1)])
            first = xp.concatenate([drive, xp.zeros(self.na - 1)])
            return a * x[0] + shifted + first, x[:1]

        return advance

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """The same run at once; the filter has the same state."""
        start = np.zeros(self.na) if x0 is None else x0
        drive = self._drive(theta, u)
        y, _ = lfilter([0.0, 1.0], self.denominator(theta), drive, zi=start)
        return np.asarray(y)[:, None]

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """x0 by least squares: the run is linear in it."""
        samples = min(samples, len(y))
        still = np.zeros((samples, 1))
        responses = [self.simulate(theta, still, x0)[:, 0] for x0 in np.eye(self.na)]
        rest = y[:samples, 0] - self.simulate(theta, u[:samples])[:, 0]
        return np.asarray(np.linalg.lstsq(np.transpose(responses), rest, rcond=None)[0])

    def stable(self, theta: Array) -> bool:
        """All poles inside the unit circle."""
        return bool(np.all(np.abs(poles(self, theta)) < 1.0))

    # ------------------------------------------------------------- prediction

    def first_sample(self) -> int:
        """Before it past outputs are missing."""
        return self.na

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        """∂ŷ/∂θ, (1, N, n): the regressors themselves; zero where they are missing."""
        out = np.zeros((len(y), self.na + 2))
        n = self.na
        if len(y) > n:
            past = [y[n - k : len(y) - k, 0] for k in range(1, n + 1)]
            held = u[n - 1 : -1, 0]
            out[n:] = np.column_stack([*past, np.maximum(held, 0.0), np.minimum(held, 0.0)])
        return out[None]

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """y − ŷ one step ahead; NaN where past outputs are missing."""
        e = y - (self.gradients(theta, u, y)[0] @ theta)[:, None]
        e[: self.na] = np.nan
        return e

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """k steps ahead: k − 1 predictions put back into the equation."""
        shown = np.full(y.shape, np.nan)
        drive = self._drive(theta, u)
        first = self.na + horizon - 1
        if len(y) <= first:
            return shown
        at = np.arange(first, len(y))
        past = [y[at - horizon + 1 - k, 0] for k in range(1, self.na + 1)]
        for k in range(horizon):
            new = theta[: self.na] @ np.array(past) + drive[at - horizon + k]
            past = [new, *past[:-1]]
        shown[first:, 0] = past[0]
        return shown

    # ------------------------------------------------------------- fit

    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        """One least-squares problem, for the search that serves held values, bounds and losses."""
        return (_Errors(self, records, focus),)

    def starts(self, records: Sequence[Record], focus: Focus) -> InitialGuesses:
        """Where that search begins."""
        return (("least squares", _solved(self, records)),)

    def stabilised(self, theta: Array) -> Array:
        """Poles outside the unit circle mirrored into it."""
        inside = poles(self, theta)
        outside = np.abs(inside) >= 1.0
        inside[outside] = INSIDE / np.conj(inside[outside])
        return np.concatenate([-np.real(np.poly(inside))[1:], theta[self.na :]])

    # ------------------------------------------------------------- words

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The equation with its numbers."""
        y, u = outputs[0].name, inputs[0].name
        past = " ".join(f"{a:+.5g}·{y}(t−{k})" for k, a in enumerate(theta[: self.na], 1))
        plus, minus = theta[self.na :]
        return (f"{y}(t) = {past} {plus:+.5g}·max({u}(t−1), 0) {minus:+.5g}·min({u}(t−1), 0)",)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Facts that are shown, and stored with the model."""
        plus, minus = (theta[self.na :] / float(np.sum(self.denominator(theta)))).tolist()
        return {"stable": self.stable(theta), "gain_forward": plus, "gain_backward": minus}

    # ------------------------------------------------------------- its own

    def denominator(self, theta: Array) -> Array:
        """A as coefficients of q⁰, q⁻¹ …"""
        return np.concatenate([[1.0], -theta[: self.na]])

    def _drive(self, theta: Array, u: Array) -> Array:
        plus, minus = theta[self.na :]
        return np.asarray(plus * np.maximum(u[:, 0], 0.0) + minus * np.minimum(u[:, 0], 0.0))


@poles.register
def _(s: TwoGain, theta: Array) -> NDArray[np.complex128]:
    """Roots of A; time constants follow from them."""
    return np.roots(s.denominator(theta)).astype(np.complex128)


@c_step.register
def _(s: TwoGain, theta: Array) -> CStep:
    """C of its own: fewer lines than what recording ``step`` gives."""
    a, (plus, minus) = theta[: s.na], theta[s.na :]
    return CStep(
        n_states=s.na,
        words=("observer form with a gain for each direction of the input",),
        body=(
            "    const double now = x[0];",
            f"    const double drive = v[0] > 0.0 ? {plus:.17g} * v[0] : {minus:.17g} * v[0];",
            "    out[0] += now;",
            *(f"    x[{k}] = {a[k]:.17g} * now + x[{k + 1}];" for k in range(s.na - 1)),
            f"    x[{s.na - 1}] = {a[-1]:.17g} * now;",
            "    x[0] += drive;",
        ),
    )


class _Errors(Problem):
    """Errors of all records one step ahead, or of free runs that begin at the measured past."""

    def __init__(self, structure: TwoGain, records: Sequence[Record], focus: Focus) -> None:
        self.structure, self.records, self.focus = structure, records, focus
        self.index, self.n_initial = np.arange(structure.na + 2), 0
        self.lengths = tuple(len(r) - structure.na for r in records)
        self.channels = (0,) * len(records)

    def _runs(self, theta: Array) -> list[tuple[Array, Array]]:
        """(ŷ, what it is put together from) of each record, from the first sample on."""
        s, n = self.structure, self.structure.na
        found = []
        for r in self.records:
            y = r.y
            if self.focus is Focus.SIMULATION:
                y = s.simulate(theta, r.u, s.fitted_state(theta, r.u, r.y, n))
            columns = s.gradients(theta, r.u, y)[0, n:]
            found.append((columns @ theta, columns))
        return found

    def residual(self, p: Array) -> Array:
        """ε (M,)."""
        with np.errstate(over="ignore", invalid="ignore"):
            runs = zip(self.records, self._runs(p), strict=True)
            e = np.concatenate([r.y[self.structure.na :, 0] - y for r, (y, _) in runs])
        return np.nan_to_num(e, nan=1e100, posinf=1e100, neginf=-1e100)

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂θ; in free run what came out before comes back through 1/A."""
        columns = [c for _, c in self._runs(p)]
        if self.focus is Focus.SIMULATION:
            columns = [lfilter([1.0], self.structure.denominator(p), c, axis=0) for c in columns]
        return np.asarray(-np.concatenate(columns))


def _solved(s: TwoGain, records: Sequence[Record]) -> Array:
    """θ by linear least squares over all records."""
    n, unused = s.na, np.zeros(s.na + 2)
    columns = [s.gradients(unused, r.u, r.y)[0, n:] for r in records]
    measured = [r.y[n:, 0] for r in records]
    found = np.linalg.lstsq(np.concatenate(columns), np.concatenate(measured), rcond=None)
    return np.asarray(found[0])


def _fit(
    structure: Any,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """In one step where nothing but one-step errors counts, by the search everybody has if not."""
    free = all(
        p.fixed is None and not np.isfinite([p.lower, p.upper]).any() for p in parameters
    ) and not any(r.weights is not None for r in records)
    if not free or options.focus is Focus.SIMULATION or options.robust or options.stable:
        return by_search(structure, records, options, parameters, initial_guesses)
    theta = _solved(structure, records)
    problem = _Errors(structure, records, options.focus)
    e = problem.residual(theta)
    worth = uncertainty(
        problem.jacobian(theta),
        e,
        tuple(zip(problem.channels, problem.lengths, strict=True)),
        np.ones(len(e)),
    )
    return FitOutcome(
        structure,
        parameters,
        theta,
        worth.covariance,
        worth.null,
        termination=Termination.CLOSED_FORM,
        starts=(StartReport("all", "least squares", None, None, 1),),
    )


METHOD = Method(_fit)
