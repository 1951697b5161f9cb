"""NARMAX: a polynomial in lagged outputs, inputs and errors, its terms chosen from the data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.record import Array, Channel, Index, Record
from sysid.data.schema import completed
from sysid.data.unit_words import ratio
from sysid.errors import UsageError
from sysid.fitting.problem import Data, Parameter
from sysid.structures.base import counts_from_zero, lacks_constant, refuse_options
from sysid.structures.difference_equations.free_run import Limits
from sysid.structures.difference_equations.monomials import (
    MAX_DEGREE,
    Term,
    is_noise,
    parsed,
    pool,
    printed,
    typed_name,
)
from sysid.structures.difference_equations.signals import Signal, lagged_signals
from sysid.structures.difference_equations.structure import RecursiveStructure
from sysid.structures.narmax.problems import OneStep
from sysid.structures.narmax.runs import PolynomialRun
from sysid.structures.options import (
    MARGIN,
    by_output,
    choice,
    margin,
    whole_number,
)
from sysid.structures.orders import MAX_ORDER, Orders, spread
from sysid.structures.traits import Traits

SELECTIONS = ("auto", "err", "simulation")
"""What chooses the terms, the usual one first."""


def explicit_terms(text: str, orders: Orders) -> tuple[tuple[Term, ...], ...]:
    """The terms a user names: outputs divided by ``;``, terms by ``,``."""
    equations = []
    for i, entries in enumerate(by_output(text, "terms", orders.ny, one_for_all=False)):
        terms = [parsed(entry, orders.nu, orders.ny, i) for entry in entries]
        if len(set(terms)) != len(terms) or not any(not is_noise(t) for t in terms):
            raise UsageError(
                f"`structure_options['terms']`: {','.join(entries)!r} must name at least one term "
                "without e, each once"
            )
        # terms of the process first: they are what the noise terms are added to
        equations.append(tuple(sorted(terms, key=is_noise)))
    require_inside(equations, orders)
    return tuple(equations)


def require_inside(rows: Sequence[Sequence[Term]], orders: Orders) -> None:
    """Refuse terms with lags that the orders do not have."""
    for i, row in enumerate(rows):
        allowed = set(lagged_signals(orders, i))
        for f in (f for t in row for f in t if f.kind != "e"):
            if f not in allowed:
                raise UsageError(
                    f"`structure_options['terms']`: {f.kind}{f.channel + 1}(t-{f.lag}) in the "
                    f"equation of output {i + 1} lies outside na, nb and nk; raise the orders"
                )


OPTIONS: Mapping[str, str] = {
    "degree": "largest degree of a product, 1 to 6; the best of 1, 2 and 3 unless given",
    "terms": "number of terms of each output, or the terms themselves such as "
    '"y(t-1), u(t-1)*y(t-2)^2" (outputs divided by ;); chosen on the data unless given',
    "noise_lags": "past errors e(t-1) … in the equation, by extended least squares; 0 unless given",
    "selection": "what chooses the terms: err (one-step error reduction), simulation (free "
    "run) or auto, the better of both on held-out data (default)",
    "margin": "how far an output may leave its training range in free run, as a share of it; "
    "0.15 unless given",
}


@dataclass(frozen=True)
class NARMAX(RecursiveStructure):
    """Polynomial NARMAX (thesis 3.25; Leontaritis & Billings 1985; Billings 2013).

    The equation of each output is a sum of monomials in past outputs, inputs and, where asked for,
    past errors. na, nb, nk say which lags may occur; which products of them do is found by
    orthogonal least squares (error reduction ratio) and by the error of batched free runs,
    each size judged on an inner hold-out. In free run past errors are zero and every output is
    kept within its training range widened by a margin on either side: a polynomial says nothing
    about where it has seen no data.
    """

    degree: int = 0
    size: int = 0
    noise_lags: int = 0
    selection: str = "auto"
    margin: float = MARGIN
    terms: tuple[tuple[Term, ...], ...] = ()
    err: tuple[tuple[float, ...], ...] = field(default=(), metadata={"alias": "err_percent"})
    input_step: tuple[float, ...] = ()

    name: ClassVar[str] = "narmax"
    traits: ClassVar[Traits] = Traits(
        title="NARMAX: polynomial with selected terms",
        equation="y(t) = Σ θ_k Π y(t−·) Π u(t−·) Π e(t−·) + e(t)",
        when="smooth nonlinearities; a readable equation",
        options=OPTIONS,
        chooses_products=True,
        order_names=("na", "nb", "nk"),
        has_noise_model=True,
    )
    # a polynomial that has left its data by their own width does not come back
    runaway: ClassVar[float] = 1.0

    # ----------------------------------------------------------------- making one

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "NARMAX":
        refuse_options(cls.name, options, tuple(cls.traits.options))
        orders = spread(raw, "ab", nu, ny, cls.name)
        given = dict(options or {})

        def number(name: str, low: int, high: int) -> int:
            return whole_number(given, name, low, high, cls.name) or 0

        degree = number("degree", 1, MAX_DEGREE)
        text = given.get("terms", "").replace(" ", "")
        named = bool(text) and not text.isdigit()
        for i in range(ny):
            pool(orders, i, degree or 1)  # refuses pools beyond all bounds
        return cls(
            orders,
            degree=degree,
            size=number("terms", 1, 1000) if "terms" in given and not named else 0,
            noise_lags=number("noise_lags", 0, MAX_ORDER),
            selection=choice(given, "selection", SELECTIONS),
            margin=margin(given),
            terms=explicit_terms(text, orders) if named else (),
        )

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """One pool of lags: fitting tries smaller ones inside it and drops what it does not need.

        With one input and no delay beyond the hold's the pool holds u(t), too: a record whose input
        was sampled and not held may need it, and the fit takes it up only where it clearly helps.
        """
        largest = 5 if nu * ny == 1 else 3 if nu * ny <= 4 else 2
        largest = max(1, min(largest, samples // (30 * (nu + ny))))
        if nu * ny == 1 and int(np.max(delay)) <= 1:
            return ({"na": largest, "nb": largest + 1, "nk": 0},)
        return ({"na": largest, "nb": largest, "nk": delay},)

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "NARMAX":
        plain = cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))
        structure = completed(cls, raw["settings"], orders=plain.orders)
        require_inside(structure.terms, structure.orders)
        return structure

    # ----------------------------------------------------------------- what θ stands for

    @property
    def rows(self) -> tuple[tuple[Term, ...], ...]:
        """Terms of each output: the chosen ones, or all linear ones before anything was chosen."""
        return self.terms or tuple(pool(self.orders, i, 1) for i in range(self.ny))

    def with_ranges(self, records: Sequence[Record]) -> Self:
        """The structure with the range of each channel and the largest change of each input."""
        changes = np.concatenate([np.abs(np.diff(r.u, axis=0)) for r in records])
        step = tuple(np.max(changes, axis=0, initial=0.0).tolist())
        return replace(super().with_ranges(records), input_step=step)

    def largest_input_step(self) -> Sequence[float]:
        return self.input_step

    def row_index(self, i: int) -> Index:
        sizes = [len(row) for row in self.rows]
        return np.arange(sum(sizes[:i]), sum(sizes[: i + 1]))

    def free_run(self, limits: Limits | None = None) -> PolynomialRun:
        return PolynomialRun(self.rows, self.nu, limits or self.limits)

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """One coefficient a term, called like the term; its output in brackets where several."""
        parameters = []
        for i, row in enumerate(self.rows):
            tag = "" if self.ny == 1 else f"[{outputs[i].name}]"
            for t in row:
                unit = _unit(outputs[i].unit, t, inputs, outputs)
                parameters.append(Parameter(typed_name(t, inputs, outputs) + tag, unit))
        return tuple(parameters)

    def one_step(self, i: int, data: Data) -> OneStep:
        return OneStep(self.rows[i], int(self.row_index(i)[0]), i, data, self.first_sample())

    def first_sample(self) -> int:
        return max((f.lag for row in self.rows for t in row for f in t if f.kind != "e"), default=0)

    # ----------------------------------------------------------------- runs

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """k-step-ahead predictions: free runs of k steps from the measured past, at every sample.

        Errors up to the start of each run are known, later ones are zero.
        """
        if horizon == 1:
            return y - self.errors(theta, u, y, window)
        e = np.nan_to_num(self.errors(theta, u, y, window))
        # known errors act like further inputs
        rows = tuple(
            tuple(
                tuple(Signal("u", self.nu + f.channel, f.lag) if f.kind == "e" else f for f in t)
                for t in row
            )
            for row in self.rows
        )
        run = PolynomialRun(rows, self.nu + self.ny, self.limits)
        driven = np.concatenate([u, e], axis=1)
        return run.predictions(theta, driven, y, horizon, self.first_sample(), unknown=self.ny)

    # ----------------------------------------------------------------- words

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """``y(t) = 0.81·y(t−1) + 0.12·u(t−1)·y(t−2)² + e(t)``, one line an output."""
        lines = []
        for i, row in enumerate(self.rows):
            parts: list[str] = []
            for value, t in zip(theta[self.row_index(i)], row, strict=True):
                what = printed(t, inputs, outputs)
                number = f"{abs(value):.5g}" + (f"·{what}" if what else "")
                sign = "-" if value < 0 else "+"
                parts.append(f"{sign} {number}" if parts else f"{sign.strip('+')}{number}")
            error = "e(t)" if self.ny == 1 else f"e_{outputs[i].name}(t)"
            lines.append(f"{outputs[i].name}(t) = {' '.join(parts)} + {error}")
        return tuple(lines)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Terms with coefficient and ERR, degree, and the limits of the free run."""
        u = [Channel("u" if self.nu == 1 else f"u{j + 1}") for j in range(self.nu)]
        y = [Channel("y" if self.ny == 1 else f"y{j + 1}") for j in range(self.ny)]
        err = self.err or tuple((float("nan"),) * len(row) for row in self.rows)
        properties: dict[str, Any] = {
            "stable": self.stable(theta),
            "degree": max((len(t) for row in self.rows for t in row), default=0),
            "terms": [
                {
                    "output": i,
                    "term": typed_name(t, u, y),
                    "coefficient": float(value),
                    "err_percent": share if np.isfinite(share) else None,
                }
                for i, row in enumerate(self.rows)
                for t, value, share in zip(row, theta[self.row_index(i)], err[i], strict=True)
            ],
        }
        if self.output_range:
            ends = " and ".join(
                f"{low:.4g} … {high:.4g} ({c.name})"
                for c, (low, high) in zip(y, self.limits, strict=True)
            )
            properties["free_run_limits"] = [list(pair) for pair in self.limits]
            properties["note"] = (
                f"In free run the output is kept inside {ends} about the operating point, its "
                f"training range and {100 * self.margin:g} % on either side: beyond it a "
                "polynomial does not extrapolate."
            )
        return properties


@counts_from_zero.register
def _(s: NARMAX) -> bool:
    """Where the user gave the terms: they are products of the measurements themselves."""
    return bool(s.terms)


@lacks_constant.register
def _(s: NARMAX) -> str:
    """Where the user gave terms and 1 is none of them."""
    if not s.terms or all(() in row for row in s.terms):
        return ""
    return "the terms given hold none; the term constant is one"


def _unit(top: str, t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """Unit of a term's coefficient: the output's over those of the factors."""
    below = [inputs[f.channel].unit if f.kind == "u" else outputs[f.channel].unit for f in t]
    below = sorted(unit for unit in below if unit)
    if top in below:
        below.remove(top)
        top = ""
    return ratio(top, "·".join(below))
