"""The shared algebra of ARX, ARMAX, OE and BJ: A y = (B/F) u + (C/D) e (Ljung 1999, eq. 4.33)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Channel, Index
from sysid.data.unit_words import ratio
from sysid.fitting.normal_equations import residual_row
from sysid.fitting.problem import Parameter
from sysid.structures.base import refuse_options
from sysid.structures.linear import many_thetas
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.polynomials import Polynomials, adjugate, determinant
from sysid.structures.linear.predictor import RowErrors, RowLayout, impulse
from sysid.structures.linear.transfer import TransferMatrix
from sysid.structures.motion import poles
from sysid.structures.orders import Orders, spread
from sysid.structures.special_runs import stable_each, stable_parts, traced_step
from sysid.structures.traits import Traits

linear_traits = partial(
    Traits, tells="gain, delay, time constants or poles", linear=True, by_default=True
)


@dataclass(frozen=True)
class PolynomialStructure(LinearStructure):
    """Base of the four polynomial structures; each only says which polynomials it has.

    θ stacks, output after output, the coefficients of A, B, C, D, F in that order, each in
    ascending lags; ``b<k>`` multiplies u(t−k).
    """

    orders: Orders
    letters: ClassVar[str]

    @property
    def nu(self) -> int:
        return self.orders.nu

    @property
    def ny(self) -> int:
        return self.orders.ny

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        refuse_options(cls.name, options, ())
        return cls(spread(raw, cls.letters, nu, ny, cls.name))

    def order_values(self) -> dict[str, Any]:
        return {name: self.orders.value(name) for name in self.traits.order_names}

    def layout(self, i: int) -> RowLayout:
        """Orders of the equation of output ``i``."""
        o = self.orders
        return RowLayout(i, o.na[i], o.nb[i], o.nk[i], o.nc[i], o.nd[i], o.nf[i], o.constant)

    def row_index(self, i: int) -> Index:
        """Entries of θ that belong to output ``i``."""
        before = sum(self.layout(k).n for k in range(i))
        return np.arange(before, before + self.layout(i).n)

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names (``a1``, ``b1[omega_l,pwm_r]`` …) and units of θ."""
        single = self.nu <= 1 and self.ny == 1
        parameters = []
        for i, out in enumerate(outputs):
            lay = self.layout(i)
            for j, n in enumerate(lay.na):
                unit = "" if i == j else ratio(out.unit, outputs[j].unit)
                tag = "" if single else f"[{out.name},{outputs[j].name}]"
                parameters += [Parameter(f"a{k}{tag}", unit) for k in range(1, n + 1)]
            for j, n in enumerate(lay.nb):
                unit = ratio(out.unit, inputs[j].unit)
                tag = "" if single else f"[{out.name},{inputs[j].name}]"
                first = lay.nk[j]
                parameters += [Parameter(f"b{k}{tag}", unit) for k in range(first, first + n)]
            tag = "" if single else f"[{out.name}]"
            parameters += [Parameter(f"c{k}{tag}") for k in range(1, lay.nc + 1)]
            parameters += [Parameter(f"d{k}{tag}") for k in range(1, lay.nd + 1)]
            for j, n in enumerate(lay.nf):
                tag = "" if single else f"[{out.name},{inputs[j].name}]"
                parameters += [Parameter(f"f{k}{tag}") for k in range(1, n + 1)]
        return tuple(parameters)

    def polynomials(self, theta: Array) -> Polynomials:
        """The coefficient arrays that θ stands for."""
        p = Polynomials.of([self.layout(i) for i in range(self.ny)], theta)
        A, B, F = ([[np.array(q) for q in row] for row in M] for M in (p.A, p.B, p.F))
        return Polynomials(A, B, [np.array(q) for q in p.C], [np.array(q) for q in p.D], F)

    def transfer(self, theta: Array) -> TransferMatrix:
        """G(q) = A⁻¹ [B/F] as a transfer matrix."""
        return _transfer_of(self, np.asarray(theta, dtype=np.float64).tobytes())

    def with_constant(self, outputs: Sequence[bool]) -> Self:
        """The coefficients of the constant are b of a further input without delay."""
        o = self.orders
        rows = [int(wanted) for wanted in outputs]
        orders = replace(
            o,
            nb=tuple((*row, n) for row, n in zip(o.nb, rows, strict=True)),
            nf=tuple((*row, 0) for row in o.nf),
            nk=tuple((*row, 0) for row in o.nk),
            constant=True,
        )
        return replace(self, orders=orders)

    def without_constant(self) -> Self:
        o = self.orders
        if not o.constant:
            return self
        nb, nf, nk = (tuple(row[:-1] for row in rows) for rows in (o.nb, o.nf, o.nk))
        return replace(self, orders=replace(o, nb=nb, nf=nf, nk=nk, constant=False))

    def constant_places(self) -> tuple[Index, Index]:
        places, outputs = [], []
        for i in range(self.ny):
            _, b, *_ = self.layout(i).slices()
            if b[-1].stop > b[-1].start:
                places.append(int(self.row_index(i)[b[-1].start]))
                outputs.append(i)
        return np.array(places, dtype=np.intp), np.array(outputs, dtype=np.intp)

    def steady(self, theta: Array) -> tuple[Array, Array]:
        """A(1) and the entries B(1)/F(1)."""
        p = self.polynomials(theta)
        A = np.array([[float(x.sum()) for x in row] for row in p.A])
        with np.errstate(divide="ignore", invalid="ignore"):
            rows = [
                [float(b.sum()) / float(f.sum()) for b, f in zip(bs, fs, strict=True)]
                for bs, fs in zip(p.B, p.F, strict=True)
            ]
        return A, np.array(rows)

    def deterministic_index(self) -> Index:
        """Entries of θ that belong to A, B and F."""
        kept = []
        for i in range(self.ny):
            _, _, c, d, _ = self.layout(i).slices()
            index = self.row_index(i)
            noise = set(index[c].tolist()) | set(index[d].tolist())
            kept += [k for k in index.tolist() if k not in noise]
        return np.array(kept, dtype=int)

    def first_sample(self) -> int:
        return max(self.layout(i).start + self.layout(i).nd for i in range(self.ny))

    def n_states(self, theta: Array) -> int:
        return self.transfer(theta).n_states

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        return self.transfer(theta).fitted_state(u, y, samples)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.transfer(theta).simulate(u, x0)

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """One-step errors; unknown initial states are fitted on the first ``window`` samples."""
        out = np.full(y.shape, np.nan)
        for i in range(self.ny):
            lay = self.layout(i)
            if len(y) <= lay.start + lay.nd:
                continue
            if not lay.n_initial:
                # A y − B u without a matrix of regressors
                terms = lay.weighed(theta[self.row_index(i)])
                out[lay.start :, i] = residual_row((*y.T, *u.T), lay.start, i, terms)
                continue
            row = RowErrors(lay, self.row_index(i), [(u, y)], estimate_initial=window > 0)
            p = row.initial_guess(theta)
            if row.n_initial:
                stop = max(window, row.skipped + row.n_initial)
                head = RowErrors(lay, self.row_index(i), [(u[:stop], y[:stop])], True)
                basis = head.initial_columns(p)
                zeta = np.linalg.lstsq(basis, -head.residual(p), rcond=1e-10)[0]
                p = np.concatenate([p[: lay.n], zeta])
            out[row.skipped :, i] = row.residual(p)
        return out

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """ŷ(t|t−k) = y(t) − Σ_{l<k} h(l) e(t−l) with h the impulse response of H = A⁻¹ C/D.

        Without a noise model (H = 1) that is the free run, whatever the horizon.
        """
        if not self.traits.has_noise_model:
            x0 = self.fitted_state(theta, u, y, window) if window > 0 else None
            return self.simulate(theta, u, x0)
        e = self.errors(theta, u, y, window)
        h = self.noise_response(theta, horizon)
        k_step = np.zeros_like(e)
        for i in range(self.ny):
            for j in range(self.ny):
                if np.any(h[:, i, j]):
                    k_step[:, i] += lfilter(h[:, i, j], [1.0], np.nan_to_num(e[:, j]))
        missing = np.isnan(e)
        for lag in range(1, min(horizon, len(e))):
            missing[lag:] |= np.isnan(e[:-lag])
        return np.where(missing, np.nan, y - k_step)

    def noise_response(self, theta: Array, n: int) -> Array:
        """H(q) = A⁻¹ C/D as an impulse response."""
        p = self.polynomials(theta)
        det, adj = determinant(p.A), adjugate(p.A)
        h = np.zeros((n, self.ny, self.ny))
        with np.errstate(over="ignore", invalid="ignore"):
            for i in range(self.ny):
                for j in range(self.ny):
                    shaped = lfilter(np.convolve(adj[i][j], p.C[j]), p.D[j], impulse(n))
                    h[:, i, j] = lfilter([1.0], det, shaped)
        return h

    def stable(self, theta: Array) -> bool:
        """Whether all poles of G(q) lie inside the unit circle."""
        if not np.all(np.isfinite(theta)):
            return False
        return bool(np.all(np.abs(poles(self, theta)) < 1.0))

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        slopes = np.zeros((self.ny, len(y), len(theta)))
        for i, of_output in enumerate(slopes):
            lay, index = self.layout(i), self.row_index(i)
            if len(y) > lay.start + lay.nd:
                row = RowErrors(lay, index, [(u, y)], False)
                of_output[row.skipped :, index] = -row.jacobian(row.initial_guess(theta))
        return slopes

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The polynomials as text, one line an output and one per polynomial."""
        p = self.polynomials(theta)
        lines = []
        for i, out in enumerate(outputs):
            left = [f"{_text(p.A[i][i])}·{out.name}" if len(p.A[i][i]) > 1 else out.name]
            others = [
                f"{_text(p.A[i][j])}·{outputs[j].name}"
                for j in range(self.ny)
                if j != i and len(p.A[i][j]) > 1
            ]
            right = []
            for j, channel in enumerate(inputs):
                if self.orders.nb[i][j]:
                    bottom = f"/{_text(p.F[i][j])}" if len(p.F[i][j]) > 1 else ""
                    right.append(f"{_text(p.B[i][j])}{bottom}·{channel.name}")
            top = _text(p.C[i]) if len(p.C[i]) > 1 else ""
            bottom = f"/{_text(p.D[i])}" if len(p.D[i]) > 1 else ""
            noise = f"{top or ('1' if bottom else '')}{bottom}"
            right.append(f"{noise}·e" if noise else "e")
            lines.append(" + ".join(left + others) + " = " + " + ".join(right))
        return tuple(lines)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Poles with time constants, zeros, static gain and stability."""
        g = self.transfer(theta)
        gain = g.static_gain()
        return {
            "stable": self.stable(theta),
            "poles": [pole_words(complex(z), dt) for z in poles(self, theta)],
            "zeros": [
                {"output": i, "input": j, "re": float(z.real), "im": float(z.imag)}
                for i in range(self.ny)
                for j in range(self.nu)
                for z in g.zeros(i, j)
            ],
            "static_gain": gain.tolist(),
        }


def pole_words(z: complex, dt: float) -> dict[str, float]:
    """A pole with what it means in seconds: time constant, natural frequency, damping."""
    pole = {"re": z.real, "im": z.imag, "abs": abs(z)}
    if abs(z) > 0:
        s = np.log(z) / dt
        pole["time_constant_s"] = float(-1.0 / s.real) if s.real else float("inf")
        pole["frequency_rad_s"] = float(abs(s))
        pole["damping"] = float(-s.real / abs(s)) if abs(s) else 1.0
    return pole


def _text(polynomial: Array) -> str:
    """``(1 - 0.81 q^-1)``: the polynomial with five significant digits."""
    terms = [
        f"{'-' if value < 0 else '+'} {abs(value):.5g}" + (f" q^-{k}" if k else "")
        for k, value in enumerate(polynomial)
        if value != 0.0
    ]
    text = " ".join(terms).removeprefix("+ ") or "0"
    return f"({'-' + text[2:] if text.startswith('- ') else text})"


@lru_cache(maxsize=32)
def _transfer_of(structure: PolynomialStructure, theta: bytes) -> TransferMatrix:
    """G(q) of the last few models: states, run, poles and gains of one are asked for in turn."""
    return TransferMatrix.build(
        *structure.polynomials(np.frombuffer(theta)).rational(structure.orders.coupled)
    )


@poles.register
def _(s: PolynomialStructure, theta: Array) -> NDArray[np.complex128]:
    """Poles of G(q); of H(q) = A⁻¹ C where there is no input."""
    if s.nu:
        return s.transfer(theta).poles()
    bottom = np.trim_zeros(determinant(s.polynomials(theta).A), "b")
    return np.roots(bottom).astype(np.complex128)


@stable_parts.register
def _(s: PolynomialStructure) -> tuple[Index, ...]:
    paths: list[Index] = []
    for i in range(s.ny):
        row, (_, b, _, _, f) = s.row_index(i), s.layout(i).slices()
        paths += [np.r_[row[p], row[q]] for p, q in zip(b, f, strict=True) if len(row[q])]
    return tuple(paths)


traced_step.register(PolynomialStructure, many_thetas.traced_step)
stable_each.register(PolynomialStructure, many_thetas.stable_each)
