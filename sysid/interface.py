"""The functions of ``import sysid``: each gathers its arguments and calls one function."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.data.finding import Finding
from sysid.data.inspection import inspect_records
from sysid.data.io import read_log, read_logs
from sysid.data.record import Record
from sysid.errors import UsageError
from sysid.estimation import pem
from sysid.estimation.identify import Identification, Request
from sysid.estimation.identify import identify as identify_request
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.orders import parse_orders
from sysid.structures.registry import structure_class

if TYPE_CHECKING:
    from pandas import DataFrame

    from sysid.data.reading.read_options import ReadOptions
    from sysid.diagnosis.diagnosis import Diagnosis
    from sysid.estimation.assessment.forecast import Forecast
    from sysid.estimation.assessment.responses import FrequencyCurve, ResponseCurve
    from sysid.estimation.look.summary import Look
    from sysid.estimation.selection.comparison import Ranking
    from sysid.robot.calibration.dynamic_motors import KnownMotors
    from sysid.robot.calibration.vehicle_fit import VehicleFit
    from sysid.robot.mission.localize import Localization
    from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns
    from sysid.robot.mission.plan import Plan
    from sysid.robot.mission.result import MissionResult
    from sysid.robot.mission.spec import Mission
    from sysid.robot.mission.tuning.tuned import Tuning
    from sysid.structures.plant import Plant
    from sysid.vehicle.kinematics import Geometry

Log = "Record | str | Path | DataFrame"
"""A log: as it was read, its file, or a table with a column of time."""

Records = Any
"""One log or several, each a :data:`Log`."""

Orders = str | Mapping[str, Any]


def _several(records: Records) -> tuple[Record, ...]:
    """Records of logs however they are given; files and tables are read as ``read_log`` does."""
    if isinstance(records, Record):
        return (records,)
    if isinstance(records, str | Path):
        return read_logs([records])
    if hasattr(records, "to_csv"):
        return (from_dataframe(records),)
    if not isinstance(records, Iterable):
        raise UsageError(f"{records!r} is no log; give a record, a file or a table first")
    return tuple(r for log in records for r in _several(log))


def from_dataframe(frame: "DataFrame", **options: Any) -> Record:
    """A table as a record: columns are distinguished as those of a CSV file are.

    Args:
        frame: a column of time, or ``ts`` among the options; an index with a name is a column.
        options: fields of :class:`ReadOptions`: inputs, outputs, units, ts …

    Raises:
        DataError: the table cannot serve; where and why is in the sentence.
        UsageError: an option does not fit it.
    """
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        file = Path(folder) / "table.csv"
        frame.to_csv(file, index=frame.index.name is not None)
        return read_log(file, **options)


def inspect(records: Records) -> tuple[Finding, ...]:
    """Findings about a log before any fit, each with a severity, a sentence and an advice."""
    return tuple(inspect_records(_several(records)))


def look(records: Records, kernel: str = "DC") -> "Look":
    """What logs show before any model: responses with bands, delays, noise, distortions.

    Args:
        kernel: prior of the impulse response, TC, DC or SS.

    Raises:
        DataError: there are no inputs, or too few samples.
    """
    from sysid.estimation.look.summary import look as looked

    return looked(_several(records), kernel)


def structure(
    records: Records, name: str, orders: Orders, options: Mapping[str, str] | None = None
) -> Structure:
    """A structure with orders, for the channels of a log.

    Args:
        records: whose number of inputs and outputs counts.
        name: as ``sysid structures`` lists them, e.g. ``oe``.
        orders: text such as ``"nb=2 nf=2 nk=1"``, or a mapping; a matrix by output and input
            where there are several.
        options: of the structure, as text.

    Raises:
        UsageError: the name, an order or an option does not exist or does not fit.
    """
    first = _several(records)[0]
    raw = parse_orders(orders) if isinstance(orders, str) else orders
    return structure_class(name).from_orders(raw, first.nu, first.ny, options)


def fit(
    records: Records,
    structure_or_name: Structure | str,
    orders: Orders | None = None,
    options: FitOptions | None = None,
    *,
    detrend: str = "auto",
) -> Model:
    """Fit one structure to one or several experiments.

    Minimises Σ ε(k, θ)² (Ljung 1999, ch. 7). Orders that are not given are searched on held-out
    samples of the records, as ``sysid fit`` does.

    Args:
        records: experiments with equal channels and sample time: records, files or tables.
        structure_or_name: a structure with its orders, or a name such as ``"oe"``.
        orders: for a name: text such as ``"nb=2 nf=2 nk=1"``, or a mapping; None searches them.
        options: focus, initial states, loss, constraints.
        detrend: treatment of offsets: auto, none, level, mean or linear.

    Raises:
        DataError: the records are not usable.
        UsageError: name, orders or options are wrong.
        ModelError: no start leads anywhere.
    """
    given = options or FitOptions()
    if isinstance(structure_or_name, Structure):
        return pem.fit(structure_or_name, _several(records), given, detrend=detrend)
    if orders is not None:
        made = structure(records, structure_or_name, orders, given.structure_options)
        return pem.fit(made, _several(records), given, detrend=detrend)
    request = Request((structure_or_name,), options=given, detrend=detrend)
    return identify_request(_several(records), (), request).assessments[0].model


def identify(
    records: Records,
    validation: Records = (),
    *,
    structures: Sequence[str] = (),
    orders: str | None = None,
    criterion: str = "fit",
    split: float | None = None,
    options: FitOptions | None = None,
    detrend: str = "auto",
    jobs: int = 1,
) -> Identification:
    """Choose orders and structures, fit and judge them: the whole of ``sysid fit``.

    Args:
        records: estimation data.
        validation: never used to choose, only to judge.
        structures: names; empty for the default ones (``usual_orders`` adds by the data).
        orders: text, ranges such as ``"na=1:4 nb=1:4 nk=1"`` too; None to search.
        criterion: what ranks: fit, aic, bic …
        split: share of each record to fit on; the rest judges.
        detrend: treatment of offsets: auto, none, level, mean or linear.

    Returns:
        Judged models, the winner first (``assessments[0].model``), and why it is ahead.

    Raises:
        DataError: the data are not usable.
        UsageError: the request contradicts itself or the data.
    """
    request = Request(
        structures=tuple(structures),
        orders=orders,
        options=options or FitOptions(),
        detrend=detrend,
        criterion=criterion,
        split=split,
        jobs=jobs,
    )
    return identify_request(_several(records), _several(validation), request)


def compare(
    records: Records,
    models: Mapping[str, Model] | Sequence[Model],
    criterion: str = "fit",
    *,
    name: str = "the log",
) -> "Ranking":
    """Rank models on a log that none of them was fitted to.

    Args:
        records: what judges; information criteria are of the data each model was fitted to, so
            with these give the estimation data.
        models: by the name to be shown, or one after the other.
        criterion: fit, rmse, aic, bic …
        name: what the data are called in words.

    Raises:
        ModelError: no model can be compared on these records.
        UsageError: the criterion is unknown.
    """
    from sysid.estimation.selection.comparison import Contender
    from sysid.estimation.selection.comparison import compare as rank

    judged_on = _several(records)
    if not isinstance(models, Mapping):
        models = {f"{k} {m.structure.name}": m for k, m in enumerate(models, 1)}
    contenders = [Contender(key, model, judged_on, {}) for key, model in models.items()]
    return rank(contenders, criterion, (judged_on, name))


def step_response(model: Model, *, seconds: float | None = None) -> "tuple[ResponseCurve, ...]":
    """Responses to a step of each input by path, with standard errors.

    Args:
        seconds: how long; until every output has settled unless given.

    Raises:
        ModelError: the model has no inputs.
    """
    from sysid.estimation.assessment.responses import step_curves

    return step_curves(model, seconds=seconds)


def forecast(record: Records, model: Model, steps: int, *, at: float | None = None) -> "Forecast":
    """What comes after a log: outputs with 95 % bands that grow.

    Args:
        record: the log so far; a file or a table is read as ``read_log`` does.
        steps: samples to forecast.
        at: the last instant that is used [s]; the log's end when None.

    Raises:
        ModelError: the log does not fit the model, or the model is not linear.
        UsageError: steps or the instant do not fit.
    """
    from sysid.estimation.assessment.forecast import forecast as forecast_of

    return forecast_of(model, _several(record)[-1], steps, at)


def frequency_response(model: Model, frequencies: Any = None) -> "tuple[FrequencyCurve, ...]":
    """Frequency responses of a linear model by path, with standard errors of gain and phase.

    Args:
        frequencies: ω [rad/s]; 100 over three decades unless given.

    Raises:
        ModelError: the model is not linear or has no inputs.
    """
    from sysid.estimation.assessment.responses import frequency_curves

    return frequency_curves(model, frequencies)


def load_model(path: str | Path, accept_changes: bool = False) -> Model:
    """Read a model: a JSON file, one of a workspace, or the model of a plant package.

    Args:
        path: the file, or the folder or zip of a package.
        accept_changes: take a package whose content was changed after the export.

    Raises:
        ModelError: the file cannot be read as a model.
    """
    from sysid.plant.package import load_model as of_package

    where = Path(path)
    if where.is_dir() or where.suffix == ".zip" or where.name == "plant.json":
        return of_package(where, accept_changes)
    return Model.load(where)


def simulate(
    mission: "Mission | str | Path", plant: "Plant | Model", *, seed: int = 0
) -> "MissionResult":
    """Drive a plant through a mission in closed loop.

    Args:
        mission: a mission, or the file that holds one.
        plant: what drives; a plant that is no robot is wired as one (``mission.robot``).
        seed: of the sensors' noise; without sensors nothing is random.

    Raises:
        DataError: the mission file cannot be read.
        ModelError: the plant cannot drive it.
    """
    from sysid.robot.mission.simulator import simulate as drive
    from sysid.robot.mission.tracks.mapping import as_robot

    spec = _mission(mission)
    robot, _ = as_robot(plant.plant() if isinstance(plant, Model) else plant, spec)
    return drive(spec, robot, seed)


def simulate_runs(
    mission: "Mission | str | Path",
    plant: "Plant | Model | Sequence[Model]",
    runs: int,
    *,
    seed: int = 0,
    vary: Sequence[str] | None = None,
) -> "MissionRuns":
    """Drive a mission many times, with what is not known for sure drawn for every run.

    Args:
        mission: a mission, or the file that holds one.
        plant: what drives; a model's parameters are drawn from their covariance. Several models
            where they vary, the first nominal.
        vary: names of what varies; None for what the mission says.

    Raises:
        DataError: the mission file cannot be read.
        ModelError: the plant cannot drive it.
        UsageError: a name or a number makes no sense.
    """
    from sysid.robot.mission.monte_carlo.runs import simulate_runs as drive

    plants = list(plant) if isinstance(plant, Sequence) else [plant]
    return drive(_mission(mission), plants, runs, seed, vary)


def plan(mission: "Mission | str | Path") -> "Plan":
    """Where the guidance of a mission leads, without a plant: its way, and where others end.

    Args:
        mission: a mission, or the file that holds one.

    Raises:
        DataError: the mission file cannot be read.
    """
    from sysid.robot.mission.plan import plan as follow

    return follow(_mission(mission))


def localize(
    log: str | Path,
    mission: "Mission | str | Path",
    *,
    columns: Mapping[str, str] | None = None,
    options: "ReadOptions | None" = None,
) -> "Localization":
    """Where a robot was, with its covariance, from a log of its sensors.

    Args:
        log: file with wheel speeds and columns of sensors.
        mission: its navigation, sensors, geometry and start, or the file that holds them.
        columns: measurement → column, where the names differ; ``-column`` where its sign does.
        options: how to read the log.

    Raises:
        DataError: a file cannot be read, or holds no reading.
        UsageError: a column or unit named is not there.
    """
    from sysid.robot.mission.localize import localize as follow

    return follow(log, _mission(mission), columns, options)


def _mission(mission: "Mission | str | Path") -> "Mission":
    """A mission, read where its file is given."""
    from sysid.robot.mission.spec import Mission, load_mission

    return mission if isinstance(mission, Mission) else load_mission(mission)


def tune(
    mission: "Mission | str | Path",
    plant: "Plant | Model",
    *,
    trials: int = 256,
    robust: int = 8,
    seed: int = 0,
) -> "Tuning":
    """Gains of a mission's controller by driving many sets of them, a front to choose from.

    Args:
        mission: a mission, or the file that holds one.
        plant: what drives; only a model has a covariance to draw other plants from.
        robust: plants that each set drives; 1 for the estimated one.
        seed: of sets, plants and sensor noise.

    Returns:
        The front, the proposed set (``best``), margins, and what rules read off the plant.

    Raises:
        DataError: the mission file cannot be read.
        UsageError: the controller has no gains, or a number makes no search.
        ModelError: no set of gains brings the robot to the goal.
    """
    from sysid.robot.mission.tuning.search import SearchOptions
    from sysid.robot.mission.tuning.search import tune as search

    return search(_mission(mission), plant, SearchOptions(trials, robust, seed))


def diagnose(
    records: Records,
    validation: Records | None = None,
    *,
    model: Model | None = None,
    mission: str | Path | None = None,
    geometry: "Geometry | None" = None,
    bench: str | Path | None = None,
    seed: int = 0,
) -> "Diagnosis":
    """Where a model and logs disagree, which effects are missing, and what adding them changes.

    Args:
        records: logs that effects are searched on.
        validation: logs that judge; None holds out blocks of ``records``.
        model: the model to diagnose; None fits a first-order baseline first.
        mission: the mission that the logs drove.
        geometry: the vehicle's lengths, where the log has a pose.
        bench: file of ``sysid bench power``: effects of battery and bridge are looked for near what
            it measured.

    Raises:
        DataError: the logs are not usable.
        ModelError: the model cannot be run on them.
        UsageError: there is no such mission file, or a log that judges is one of ``records``.
    """
    from sysid.diagnosis.diagnose import diagnose as search
    from sysid.effects.measured import read_measured

    if mission is not None and not Path(mission).is_file():
        raise UsageError(f"{mission}: file not found")
    return search(
        _several(records),
        None if validation is None else _several(validation),
        model=model,
        mission=None if mission is None else Path(mission),
        geometry=geometry,
        measured=None if bench is None else read_measured(bench),
        seed=seed,
    )


def fit_vehicle(
    records: Records,
    validation: Records = (),
    *,
    geometry: "Geometry | None" = None,
    motion: str = "slip",
    motors: "KnownMotors | Model | float | None" = None,
) -> "VehicleFit":
    """Radii, width, slip, lags and lever arm of a vehicle, or its masses and frictions.

    Args:
        records: logs, read with ``ReadOptions(held="keep")`` so that every row is there.
        validation: logs that judge; none holds out the last 30 % of ``records``.
        geometry: the lengths that ``before`` stands for; None for the bundled robot's.
        motion: what moves it: ``slip``, or ``dynamic`` for masses and frictions.
        motors: of motion dynamic: a dc-motor of the bench, or the torque at the wheel per unit of
            the command [Nm]; None where nothing of them is known.

    Raises:
        DataError: pose, wheel speeds or commands are missing, or there are too few of them.
        ModelError: the model gives no torque, or was driven on the ground.
        UsageError: there is no such motion.
    """
    from sysid.robot.calibration.dynamic_motors import motors_of_model, torque_only
    from sysid.robot.calibration.vehicle_fit import fit_vehicle as fit_of
    from sysid.structures.model import Model

    if isinstance(motors, Model):
        motors = motors_of_model(motors)
    elif isinstance(motors, int | float):
        motors = torque_only(motors)
    return fit_of(_several(records), _several(validation), geometry, motion, motors)
