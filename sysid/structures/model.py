"""Model: a structure with parameters, their covariance, and provenance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from sysid.criteria.fit import fit_percent
from sysid.data import documents
from sysid.data.files import contents, write_atomic
from sysid.data.operating_point import OperatingPoint, shifted
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.data.same_kind import SAME_CLOCK, difference
from sysid.data.schema import DAMAGED, Null, checked, completed
from sysid.errors import ModelError, Termination
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import StartReport
from sysid.fitting.uncertainty import Determined, unvisited
from sysid.structures import model_text
from sysid.structures.base import Structure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.transfer import control_model
from sysid.structures.motion import initial_state_window, poles
from sysid.structures.plant import Plant
from sysid.structures.registry import require_readable, structure_from_json, structure_to_json

if TYPE_CHECKING:
    from scipy.signal import StateSpace

SCHEMA = "sysid-model/1"


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter with its estimate: one row of the parameter table.

    ``visited`` is False where the log never goes where the parameter acts; its value, which the
    model then runs with, says nothing of the plant.
    """

    name: str
    value: float
    std_error: float
    unit: str
    fixed: bool
    at_bound: bool
    visited: bool = True

    def to_json(self) -> dict[str, Any]:
        """Its fields; no value where it says nothing."""
        written = documents.by_field(self)
        del written["visited"]
        return written if self.visited else written | {"value": None}


@dataclass(frozen=True)
class Source:
    """One experiment a model was fitted to."""

    name: str
    sha256: str
    first: float
    samples: int


@dataclass(frozen=True)
class Provenance:
    """Where a model came from: enough to make it again.

    Attributes:
        options: focus, initial states, loss, detrending, how the files were read …
    """

    data: tuple[Source, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    version: str = ""


@dataclass(frozen=True)
class _StoredParameter:
    """A parameter in a model file."""

    name: str
    value: float
    unit: str
    lower: Annotated[float, Null(-np.inf)]
    upper: Annotated[float, Null(np.inf)]
    fixed: bool

    def parameter(self) -> Parameter:
        """The parameter, fixed at its value or free between its bounds."""
        fixed = self.value if self.fixed else None
        return Parameter(self.name, self.unit, self.lower, self.upper, fixed)


_Covariance = Annotated[Array, Null(np.inf)]


@dataclass(frozen=True, eq=False)
class Model:
    """A fitted structure.

    Attributes:
        theta: parameters, shape (n,).
        covariance: covariance of θ, (n, n); infinite where the data hold no information.
        parameters: names, units, bounds and fixed values of θ.
        dt: sample time [s].
        inputs, outputs: channels in the model's units.
        detrend: offsets and trends removed before the fit, applied again by every method here.
        noise_covariance: covariance of the one-step errors, (ny, ny).
        n_estimated: number of estimated numbers, initial states included.
        criteria: criteria of the one-step errors on the estimation data, by name; an older model
            may lack those that came later.
        initial_states: free-run state at the start of each experiment.
        ranges: lowest and highest value of each input and output seen, (nu + ny, 2).
        at_bound: names of the parameters that ended on a bound.
        null_directions: directions of θ without information, each as {name: weight}.
        determined: what is known of functions of θ in spite of these, where the fit says it.
        warnings: what a user should know about this fit.
        operating_point: how the offsets in ``detrend`` were found, and their standard errors.
    """

    structure: Structure
    theta: Array
    covariance: _Covariance
    parameters: tuple[Parameter, ...]
    dt: float = field(metadata={"alias": "sample_time"})
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    detrend: Detrend
    noise_covariance: Array
    n_estimated: int
    criteria: Mapping[str, Annotated[float, Null()]]
    termination: Termination
    initial_states: tuple[Array, ...] = ()
    ranges: Array = field(default_factory=lambda: np.zeros((0, 2)))
    at_bound: tuple[str, ...] = ()
    null_directions: tuple[Mapping[str, float], ...] = ()
    starts: tuple[StartReport, ...] = ()
    warnings: tuple[str, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)
    operating_point: OperatingPoint = field(
        default_factory=OperatingPoint, metadata={"alias": "level"}
    )
    determined: Determined | None = None

    def __post_init__(self) -> None:
        n, nu, ny = len(self.theta), len(self.inputs), len(self.outputs)
        errors = (self.operating_point.u_error, self.operating_point.y_error)
        fitting = (
            (self.structure.nu, self.structure.ny) == (nu, ny)
            and len(self.parameters) == n
            and self.covariance.shape == (n, n)
            and self.noise_covariance.shape == (ny, ny)
            and (len(self.detrend.u_offset), len(self.detrend.y_offset)) == (nu, ny)
            and len(self.ranges) in (0, nu, nu + ny)
            and (self.determined is None or self.determined.fits(n))
            and all(len(e) in (0, k) for e, k in zip(errors, (nu, ny), strict=True))
        )
        if not fitting:
            raise ModelError("the parts of the model do not fit each other; fit it again")
        if not 0.0 < self.dt < np.inf:
            raise ModelError(f"the sample time {self.dt:g} s is not positive; fit the model again")

    def __repr__(self) -> str:
        return model_text.line(self)

    def _repr_html_(self) -> str:
        return model_text.as_html(self)

    def summary(self) -> str:
        """Facts, parameters with 95 % intervals, equations and warnings as text."""
        return model_text.summary(self)

    @property
    def plot(self) -> Any:
        """Figures: ``plot.step()``, ``plot.bode(record)``, ``plot.fit(record, other)``.

        Pictures lie above models, so that they are found by name where they are asked for.
        """
        return import_module("sysid.report.model_plots").ModelPlots(self)

    @property
    def stable(self) -> bool:
        return self.structure.stable(self.theta)

    def tried(self) -> "Model":
        """The model itself once it has made a step from rest, as one read from a file must.

        Raises:
            ArithmeticError, LookupError, TypeError, ValueError: its numbers cannot be run.
        """
        with np.errstate(all="ignore"):
            plant = self.plant()
            plant.step(plant.initial_state(), plant.u_offset)
            self.equations()
        return self

    def parameter_table(self) -> tuple[ParameterEstimate, ...]:
        """Value ± standard error of every parameter, in θ's order."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        unseen = {unvisited(d) for d in self.null_directions}
        return tuple(
            ParameterEstimate(
                p.name,
                float(v),
                0.0 if p.fixed is not None else float(s),
                p.unit,
                p.fixed is not None,
                p.name in self.at_bound,
                p.fixed is not None or p.name not in unseen or self.structure.traits.linear,
            )
            for p, v, s in zip(self.parameters, self.theta, errors, strict=True)
        )

    def equations(self) -> tuple[str, ...]:
        """The fitted equations in physical numbers: offsets stand where they were removed."""
        return self.structure.equations(
            self.theta,
            shifted(self.inputs, self.detrend.u_offset.tolist()),
            shifted(self.outputs, self.detrend.y_offset.tolist()),
        )

    def operating_point_sentence(self) -> str:
        """Where the model counts from, in one line; empty where that is zero without question."""
        return self.operating_point.sentence(self.detrend, self.inputs, self.outputs)

    def check(self, record: Record) -> None:
        """Refuse a record this model cannot be run on.

        Raises:
            ModelError: number of channels, names or sample time differ.
        """
        if unlike := difference(record, self, "the model", unstated_fits=True):
            raise ModelError(unlike)

    def fitted_to(self, records: Sequence[Record]) -> bool:
        """Whether one of these logs is among those it was fitted to."""
        known = {s.sha256 for s in self.provenance.data}
        return any(r.sha256 in known for r in records)

    def fits_clock(self, record: Record) -> bool:
        """Whether a record has the model's sample time."""
        return abs(record.dt - self.dt) <= SAME_CLOCK * self.dt

    def simulate(self, u: Array | Record, x0: Array | None = None, t0: float = 0.0) -> Array:
        """Free run for inputs ``u`` (N, nu) in physical units from state x0, shape (N, ny).

        Args:
            u: of one input also (N,); or a record, whose inputs and first instant are then taken.
        """
        if isinstance(u, Record):
            self.check(u)
            t0, u = u.t0, u.u
        u = np.asarray(u, dtype=np.float64)
        u = u[:, None] if u.ndim == 1 else u
        t = t0 + self.dt * np.arange(len(u), dtype=np.float64)
        run = self.structure.simulate(self.theta, self.detrend.remove_input(u, t), x0)
        return self.detrend.restore_output(run, t)

    def fit_percent(self, record: Record) -> dict[str, float]:
        """100 (1 − ‖y − ŷ‖/‖y − ȳ‖) of the free run by output, from a state fitted to the head."""
        self.check(record)
        window = initial_state_window(self.structure, self.theta)
        x0 = self.fitted_state(record, window) if window else None
        fits = fit_percent([record.y], [self.simulate(record.u, x0, record.t0)])
        return dict(zip(record.output_names, fits.tolist(), strict=True))

    def fitted_state(self, record: Record, samples: int) -> Array:
        """Free-run state that meets the first ``samples`` of the record best."""
        plain = self.detrend.remove(record)
        return self.structure.fitted_state(self.theta, plain.u, plain.y, samples)

    def errors(self, record: Record, window: int) -> Array:
        """One-step prediction errors (N, ny), NaN where a sample before the record is needed."""
        self.check(record)
        plain = self.detrend.remove(record)
        return self.structure.errors(self.theta, plain.u, plain.y, window)

    def residuals(self, record: Record) -> Array:
        """``errors`` from an initial state fitted to the head of the record, (N, ny)."""
        return self.errors(record, initial_state_window(self.structure, self.theta))

    def predict(self, record: Record, horizon: int = 1, window: int | None = None) -> Array:
        """k-step-ahead predictions (N, ny), NaN where they need samples before the record.

        Args:
            horizon: k ≥ 1; the free run is ``simulate``.
            window: samples at the head from which unknown initial states are fitted; as many as
                the model remembers unless given.

        Raises:
            ModelError: the record does not fit the model, or ``horizon`` < 1.
        """
        if horizon < 1:
            raise ModelError(f"the prediction horizon must be at least 1 sample, got {horizon}")
        self.check(record)
        plain = self.detrend.remove(record)
        if window is None:
            window = initial_state_window(self.structure, self.theta)
        run = self.structure.predict(self.theta, plain.u, plain.y, horizon, window)
        return self.detrend.restore_output(run, record.t)

    def plant(self) -> Plant:
        """The model as a thing that is stepped sample by sample, in physical units."""
        return Plant.of_structure(
            self.structure,
            self.theta,
            self.dt,
            self.inputs,
            self.outputs,
            self.detrend,
            self.ranges,
        )

    def step_response(
        self, samples: int = 200, size: float = 1.0, channel: int = 0
    ) -> tuple[Array, Array]:
        """Answer to a step of one input from rest at the operating point.

        Args:
            size: of the step, in the input's unit.

        Returns:
            Time (N,) in s and outputs (N, ny) in their units.
        """
        u = np.zeros((samples, len(self.inputs)))
        u[:, channel] = size
        run = self.structure.simulate(self.theta, u) + np.asarray(self.detrend.y_offset)
        return self.dt * np.arange(samples, dtype=np.float64), run

    def poles(self) -> NDArray[np.complex128]:
        """Poles in the z plane, those at the origin left out.

        Raises:
            ModelError: the model is not linear.
        """
        every = poles(self._linear("poles"), self.theta)
        return np.asarray(every[every != 0.0])

    def zeros(self, channel: int = 0, output: int = 0) -> NDArray[np.complex128]:
        """Zeros in the z plane of the path from one input to one output.

        Raises:
            ModelError: the model is not linear.
        """
        return self._linear("zeros").transfer(self.theta).zeros(output, channel)

    def bode(self, frequencies: Array | None = None) -> tuple[Array, NDArray[np.complex128]]:
        """Frequency response G(e^{jω dt}) from inputs to outputs.

        Args:
            frequencies: ω [rad/s]; 300 up to the Nyquist frequency over three decades unless given.

        Returns:
            ω (n,) and the response (n, ny, nu) in units of output over input.

        Raises:
            ModelError: the model is not linear.
        """
        transfer = self._linear("frequency response").transfer(self.theta)
        w = np.geomspace(1e-3, 1.0, 300) * np.pi / self.dt if frequencies is None else frequencies
        return np.asarray(w, dtype=np.float64), transfer.response(np.asarray(w) * self.dt)

    def to_scipy(self) -> "StateSpace":
        """``scipy.signal.StateSpace`` of the deterministic part, about the operating point.

        Raises:
            ModelError: the model is not linear.
        """
        from scipy.signal import StateSpace

        return StateSpace(*self._linear("state space").matrices(self.theta), dt=self.dt)

    def to_control(self, continuous: bool = False) -> Any:
        """``control.StateSpace`` of the deterministic part, about the operating point.

        Args:
            continuous: in continuous time: what a held input makes these samples of; a dead time
                that the structure names is then a Padé approximation.

        Raises:
            ModelError: the model is not linear, has no continuous counterpart, or python-control is
                not installed.
        """
        structure = self._linear("state space")
        matrices = structure.matrices(self.theta)
        if continuous:
            matrices = structure.in_continuous_time(self.theta, self.dt)
        names = ([c.name for c in channels] for channels in (self.inputs, self.outputs))
        return control_model(matrices, 0.0 if continuous else self.dt, *names)

    def _linear(self, what: str) -> LinearStructure:
        if not isinstance(self.structure, LinearStructure):
            raise ModelError(
                f"{self.structure.name} is not linear and has no {what}; simulate it, or fit a "
                "linear structure such as oe"
            )
        return self.structure

    def to_json(self) -> dict[str, Any]:
        """Everything about the model as JSON-able values; non-finite numbers as null.

        Raises:
            ModelError: a structure of another package does not read back what it writes.
        """
        require_readable(self.structure)
        parameters = [
            _StoredParameter(p.name, float(v), p.unit, p.lower, p.upper, p.fixed is not None)
            for p, v in zip(self.parameters, self.theta, strict=True)
        ]
        own = documents.by_field(self)
        del own["structure"], own["theta"]
        return documents.plain_object(
            {"schema": SCHEMA}
            | structure_to_json(self.structure)
            | own
            | {"parameters": parameters}
        )

    @staticmethod
    def from_json(raw: Mapping[str, Any]) -> "Model":
        """Undo ``to_json``.

        Raises:
            ModelError: the description is damaged or of another schema.
        """
        if not isinstance(raw, Mapping) or raw.get("schema") != SCHEMA:
            raise ModelError(f"this is not a model of schema {SCHEMA}; fit it again")
        try:
            stored = checked(tuple[_StoredParameter, ...], raw["parameters"])
            structure, detrend = structure_from_json(raw), checked(Detrend, raw["detrend"])
            n = len(stored)
            given: dict[str, Any] = {}
            if raw.get("level") is None:  # as version 0.1.0 wrote it
                given["operating_point"] = OperatingPoint.of_detrend(detrend)
            if "determined" not in raw:  # nor did 0.1.0 write that
                given["determined"] = None
            model = completed(
                Model,
                raw,
                structure=structure,
                theta=np.array([p.value for p in stored], dtype=np.float64),
                parameters=tuple(p.parameter() for p in stored),
                covariance=checked(_Covariance, raw["covariance"]).reshape(n, n),
                detrend=detrend,
                termination=_termination(raw["termination"]),
                ranges=checked(Array, raw["ranges"]).reshape(-1, 2),
                **given,
            )
            names = [p.name for p in structure.parameters(model.inputs, model.outputs)]
            if names != [p.name for p in stored]:
                raise ValueError("its parameters do not fit its orders")
            return model.tried()
        except DAMAGED as error:
            what = f"{error} is missing" if isinstance(error, KeyError) else error
            raise ModelError(f"the model is damaged ({what}); fit it again") from None

    def save(self, path: Path) -> None:
        """Write the model as readable JSON (temporary name first, then renamed)."""
        write_atomic(path, documents.text(self.to_json()))

    @staticmethod
    def load(path: Path) -> "Model":
        """Read what ``save`` wrote, or a model of a workspace (``models/<id>.json``).

        Raises:
            ModelError: the file cannot be read as a model.
        """
        try:
            raw = documents.parsed(contents(path))
        except OSError as error:
            raise ModelError(f"cannot read the model {path}: {error.strerror}") from None
        except ValueError as error:
            raise ModelError(f"{path} is damaged ({error}); fit the model again") from None
        if isinstance(raw, dict) and "schema" not in raw and isinstance(raw.get("model"), dict):
            raw = raw["model"]  # a workspace keeps what the fit said beside it
        try:
            return Model.from_json(raw)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None


def _termination(code: str) -> Termination:
    for member in Termination:
        if member.code == code:
            return member
    raise ValueError(f"unknown termination {code!r}")
