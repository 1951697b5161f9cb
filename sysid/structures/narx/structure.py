"""NARX with a nonlinearity estimator, such as a wavelet network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from sysid.data.record import Array, Channel
from sysid.data.schema import completed
from sysid.fitting.problem import Data, Parameter, Problem
from sysid.structures.base import refuse_options
from sysid.structures.difference_equations.expressions import parse, written
from sysid.structures.difference_equations.free_run import Limits
from sysid.structures.difference_equations.regressors import Row, columns, custom
from sysid.structures.difference_equations.signals import lagged_signals
from sysid.structures.difference_equations.structure import RecursiveStructure
from sysid.structures.narx import options as narx_options
from sysid.structures.narx import words as narx_words
from sysid.structures.narx.compiled import compiled_runs
from sysid.structures.narx.options import NarxOptions
from sysid.structures.narx.run import LONG, Maps, NarxRun
from sysid.structures.narx.wavelet_network import KINDS, Kind, RowDesign
from sysid.structures.orders import spread
from sysid.structures.traits import Traits

BLOCK = 8192
"""Samples whose units are held at a time."""


class OneStepRow(Problem):
    """ε(t) = y(t) − F(x(t)) of one output.

    Args:
        data: (u, y) of each record.
    """

    def __init__(self, run: NarxRun, output: int, data: Data) -> None:
        first, maps = run.first, run.maps
        self.index = run.theta_index[output]
        self.n_initial = 0
        self.lengths = tuple(max(len(y) - first, 0) for _, y in data)
        self.channels = (output,) * len(data)
        self._maps = Maps((maps.rows[output],), (maps.sizes[output],), maps.estimator)
        self._frames = [run.frames[output]]
        self._known = np.concatenate([columns(self._maps.signals, u, y)[first:] for u, y in data])
        self._y = np.concatenate([y[first:, output] for _, y in data])

    def residual(self, p: Array) -> Array:
        place = self._maps.signals.index
        of_inputs, of_outputs = self._maps.parts(np, p, self._frames, place)
        blocks = [self._known[a : a + BLOCK].T for a in range(0, len(self._known), BLOCK)]
        values = [of_outputs(known, of_inputs(known))[0] for known in blocks]
        return np.asarray(self._y - np.concatenate([np.zeros(0), *values]))

    def jacobian(self, p: Array) -> Array:
        n = len(self._known)
        # powers of two: records of other lengths find what was compiled
        padded = np.zeros((1 << max(n - 1, 0).bit_length(), self._known.shape[1]))
        padded[:n] = self._known
        slopes = compiled_runs(self._maps).partial(p, self._frames, padded)
        return -np.asarray(slopes)[:n, 0]


@dataclass(frozen=True)
class NarxWavelet(RecursiveStructure):
    """NARX: regressors, a linear part and a network of wavelets (thesis 3.26–3.30; Zhang 1997).

    na, nb, nk name the standard regressors of each output; expressions may be added. The map of
    each output is linear in all regressors, plus products of low degree, plus units of a network
    over the principal components of some of them, see ``sysid.structures.narx.wavelet_network``.
    What is selected, and where the units lie at first, is read off the data by the fit. In free run
    everything nonlinear sees its regressors kept inside the training range widened by a margin,
    and so is every output kept: the model says nothing about where it has seen no data.
    """

    options_given: NarxOptions = field(default_factory=NarxOptions, metadata={"alias": "options"})
    customs: tuple[Row, ...] = field(default=(), metadata={"alias": "regressors"})
    designs: tuple[RowDesign, ...] = ()

    name: ClassVar[str] = "narx-wavelet"
    traits: ClassVar[Traits] = Traits(
        title="NARX with a wavelet network",
        equation="y(t) = y₀ + L x(t) + Σ p_k Π x(t) + Σ a_k f(b_k (x(t) Q − c_k)) + e(t)",
        when="friction, dead zones, saturation: nonlinearities of unknown form",
        options=narx_options.OPTIONS,
        order_names=("na", "nb", "nk"),
        has_noise_model=True,
    )
    # products and units see their regressors clipped: what leaves the data comes back more often
    runaway: ClassVar[float] = 3.0

    @property
    def margin(self) -> float:
        return self.options_given.margin

    @property
    def kind(self) -> Kind:
        return KINDS[self.options_given.estimator]

    # ----------------------------------------------------------------- making one

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "NarxWavelet":
        refuse_options(cls.name, options, tuple(cls.traits.options))
        orders = spread(raw, "ab", nu, ny, cls.name)
        given = dict(options or {})
        customs = custom(given["regressors"], orders) if "regressors" in given else ()
        narx_options.check_regressors(orders, customs)
        return cls(orders, options_given=narx_options.read(given), customs=customs)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Few: each is a whole fit that leaves out what it does not need.

        Several outputs: each by its own past at two samples, or by that of all at one, which is
        enough where the outputs are the states.
        """
        largest = max(1, min(4 if nu * ny == 1 else 2, samples // (60 * (nu + ny))))
        if ny > 1:
            largest_orders = {"na": largest, "nb": largest, "nk": delay}
            return (largest_orders, {"na": [[1] * ny] * ny, "nb": 1, "nk": delay})
        return tuple({"na": n, "nb": n, "nk": delay} for n in range(min(2, largest), largest + 1))

    def settings(self) -> dict[str, Any]:
        """Custom regressors as text."""
        return super().settings() | {"regressors": [[*map(written, row)] for row in self.customs]}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "NarxWavelet":
        known, nu, ny = raw["settings"], int(raw["nu"]), int(raw["ny"])
        customs = tuple(tuple(parse(e, nu, ny) for e in row) for row in known["regressors"])
        orders = spread(raw["orders"], "ab", nu, ny, cls.name)
        structure = completed(cls, known, orders=orders, customs=customs)
        if structure.options_given.estimator not in KINDS:
            raise ValueError(f"unknown estimator {structure.options_given.estimator!r}")
        narx_options.check_designs(structure.rows, structure.designs)
        return structure

    # ----------------------------------------------------------------- what θ stands for

    @property
    def rows(self) -> tuple[Row, ...]:
        """Regressors of each output: standard ones, then custom ones."""
        extra = self.customs or ((),) * self.ny
        return tuple((*lagged_signals(self.orders, i), *extra[i]) for i in range(self.ny))

    @property
    def maps(self) -> tuple[RowDesign, ...]:
        """What else makes each row; linear before a fit."""
        return self.designs or tuple(RowDesign.plain(len(row)) for row in self.rows)

    def free_run(self, limits: Limits | None = None, compiled_from: int = LONG) -> NarxRun:
        estimator = self.options_given.estimator
        kept = limits or self.limits
        return NarxRun(self.rows, self.maps, estimator, self.nu, kept, compiled_from)

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """y0, one coefficient a regressor and a product, then the units'."""
        return tuple(
            p
            for i, (row, d) in enumerate(zip(self.rows, self.maps, strict=True))
            for p in narx_words.parameters(row, d, self.kind, inputs, outputs, i)
        )

    def one_step(self, i: int, data: Data) -> OneStepRow:
        return OneStepRow(self.free_run(), i, data)

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """Linear part and products in full, the units by number and place."""
        run = self.free_run()
        return tuple(
            narx_words.equation(
                row, d, self.kind, d.weights(theta[run.theta_index[i]]), inputs, outputs, i
            )
            for i, (row, d) in enumerate(zip(self.rows, self.maps, strict=True))
        )

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Sizes of the network, its regressors, and where the free run is held."""
        properties: dict[str, Any] = {
            "stable": self.stable(theta),
            "estimator": self.options_given.estimator,
            "outputs": [
                {
                    "regressors": [written(e) for e in row],
                    "products": len(d.terms),
                    "units": len(d.flags),
                    "scaling_functions": sum(1 - f for f in d.flags),
                    "network_regressors": [written(row[k]) for k in d.seen_by_units()],
                    "regressors_a_unit": d.sizes[3] if d.views else len(d.seen_by_units()),
                }
                for row, d in zip(self.rows, self.maps, strict=True)
            ],
        }
        if self.output_range:
            margin = 100.0 * self.options_given.margin
            properties["free_run_limits"] = [list(pair) for pair in self.limits]
            properties["note"] = (
                "In free run every output is kept inside its training range and "
                f"{margin:g} % on either side, and so is what the nonlinear part sees of every "
                "regressor: the model does not extrapolate."
            )
        return properties
