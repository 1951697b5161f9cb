"""Every parser of files and texts: what is given to it, valid, and how it is called."""

import contextlib
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from command_lines import COMMANDS, good_logs, inspect_and_fit, run_command
from mutations import DEEP, NESTED

from sysid.data import documents
from sysid.errors import SysidError

ROOT = Path(__file__).resolve().parent.parent.parent
DATA = ROOT / "datasets"


@dataclass(frozen=True)
class Parser:
    """One reader.

    Attributes:
        suffix: of its file.
        seeds: valid documents (written as JSON, or YAML where the suffix says so), texts or bytes.
        read: reads the file, and uses what was read as a command would first.
        share: inputs of it in the tests, every other one among the slow ones, by what one costs; a
            study takes many times these.
    """

    suffix: str
    seeds: Callable[[], Sequence[Any]]
    read: Callable[[Path], object]
    share: int


def encoded(document: Any, suffix: str) -> bytes:
    """The bytes of the file that holds a document, a text or bytes."""
    if isinstance(document, bytes):
        return document
    if isinstance(document, str):
        return document.encode("utf-8", "surrogatepass")
    if suffix == ".yaml":
        text = yaml.safe_dump(document, allow_unicode=True, default_flow_style=None)
    else:
        text = json.dumps(document)
    return text.encode().replace(json.dumps(DEEP).encode(), NESTED).replace(DEEP.encode(), NESTED)


# ------------------------------------------------------------------------------- models


@cache
def _models() -> tuple[Any, ...]:
    from hand_made import hand_made
    from laws.cases import CASES, case_of

    made = [hand_made(case_of(n).structure, case_of(n).theta) for n in CASES]
    older = (ROOT / "tests/data/0.1/workspace/models").glob("*.json")
    return (*made, *(json.loads(p.read_text())["model"] for p in sorted(older)))


def _model_files() -> list[Any]:
    return [m if isinstance(m, dict) else json.loads(json.dumps(m.to_json())) for m in _models()]


def _plant_files() -> list[Any]:
    from sysid.plant.description import describe

    return [
        json.loads(json.dumps(describe(m, {}, "plant")))
        for m in _models()
        if not isinstance(m, dict)
    ]


def _use_model(path: Path) -> None:
    from sysid.structures.model import Model

    model = Model.load(path)
    _run(model.plant())
    model.simulate(np.ones((4, len(model.inputs))))
    model.equations()
    model.parameter_table()
    model.operating_point_sentence()
    documents.text(model.to_json())


def _use_plant(path: Path) -> None:
    from sysid.plant.description import from_text, to_model

    raw = from_text(path.read_bytes(), path.name)
    _run(to_model(raw, path.name).plant())
    to_model(raw, path.name).equations()


def _run(plant: Any) -> None:
    state = plant.initial_state()
    for _ in range(3):
        state, _ = plant.step(state, np.ones(len(plant.inputs)))


def _workspace(path: Path) -> None:
    """What the file holds, as each of the three files of a workspace."""
    from sysid.workspace.store import Workspace

    for name in ("models/arx-1f00ba.json", "index.json", "state.json"):
        place = path.parent / "ws" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(path.read_bytes())
        try:
            with contextlib.suppress(SysidError):
                Workspace(path.parent / "ws").chosen(None)
        finally:
            place.unlink()


def _workspaces() -> list[Any]:
    entry = {"id": "arx-1f00ba", "model": _model_files()[0], "report": {}}
    latest = {"value": "arx-1f00ba", "order": 1}
    return [
        entry,
        ["arx-1f00ba"],
        {"latest": latest, "best": {"value": ["arx-1f00ba"], "order": 2}},
    ]


# ------------------------------------------------------------------------------- hand-written files


def _yaml_of(*folders: str) -> list[Any]:
    return [
        yaml.safe_load(p.read_text()) for f in folders for p in sorted((DATA / f).glob("*.yaml"))
    ]


FULL_MISSION = {
    "goal": [6, 3],
    "start": [0, 0, 0],
    "timeout": 120,
    "obstacles": [[2, 3.5], [3, 1, 0.2], {"at": [5, 3], "radius": 0.15, "velocity": [0.1, 0]}],
    "walls": [[[1, 1], [2, 1], [2, 2]]],
    "polygons": [[[4, 0], [5, 0], [5, 1]]],
    "waypoints": [[1, 3], [2, 5]],
    "guidance": {"theta": 1, "Kg": 0.3},
    "control": {"kind": "pi-p", "period": 0.1, "compensate": "identified"},
    "navigation": {"kind": "ekf"},
    "sensors": {"gyroscope": {"noise": 0.01}},
    "motion": {"kind": "slip", "slip": 0.1},
    "vehicle": {"r": 0.03, "B": 0.2, "mass": 3.0},
    "vary": {"noise": True, "mass": 0.1},
    "limits": {"from_plant": True},
}


def _missions() -> list[Any]:
    return [
        *_yaml_of("missions"),
        FULL_MISSION,
        *({"goal": [6, 3], k: FULL_MISSION[k]} for k in FULL_MISSION),
    ]


def _mission(path: Path) -> None:
    from sysid.robot.mission.spec import load_mission

    mission = load_mission(path)
    mission.scene()
    mission.complete_guidance.start(mission.scene(), np)  # type: ignore[attr-defined]


def _vehicle(path: Path) -> None:
    from sysid.vehicle.wheels.description import load_vehicle
    from sysid.vehicle.wheels.summary import summary
    from sysid.vehicle.wheels.urdf_writing import urdf_text

    vehicle = load_vehicle(path)
    summary(vehicle)
    urdf_text(vehicle)


def _urdf() -> list[str]:
    from sysid.vehicle.wheels.description import load_vehicle
    from sysid.vehicle.wheels.urdf_writing import urdf_text

    return [urdf_text(load_vehicle(p)) for p in sorted((DATA / "vehicles").glob("*.yaml"))]


def _soils(path: Path) -> None:
    from sysid.vehicle.ground.presets import read_soil
    from sysid.vehicle.wheels.description import load_tracks

    for read in (read_soil, load_tracks):
        with contextlib.suppress(SysidError):
            read(path)


def _motors(path: Path) -> None:
    from sysid.robot.calibration.dynamic_motors import read_motors

    read_motors(path)


def _map(path: Path) -> None:
    from sysid.data.bags.mapping import mapping_of

    mapping_of([str(path)])


def _measured(path: Path) -> None:
    from sysid.effects.measured import read_measured

    read_measured(path)


# ------------------------------------------------------------------------------- texts


def _orders(path: Path) -> None:
    from sysid.estimation.selection.grid import parse_grid, parse_grids
    from sysid.structures.registry import structure_class

    text = path.read_bytes().decode("utf-8", "replace")
    for name in ("arx", "bj", "narx-wavelet", "hammerstein-wiener"):
        with contextlib.suppress(SysidError):
            for orders in parse_grid(text)[:3]:
                structure_class(name).from_orders(orders, 2, 1)
    parse_grids(text, ["arx", "oe"])


def _statics(path: Path) -> None:
    from sysid.structures.registry import structure_class

    name, *given = path.read_bytes().decode("utf-8", "replace").split("|")
    options = dict(g.partition("=")[::2] for g in given)
    orders = {
        "hammerstein-wiener": {"nb": 1, "nf": 1},
        "wiener-hammerstein": {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1},
    }
    fallback = {"na": 1, "nb": 1, "nk": 1} if name.startswith("nar") else {}
    structure_class(name).from_orders(orders.get(name, fallback), 1, 1, options)


STATICS = (
    "hammerstein-wiener|input=dead-zone|output=identity",
    "hammerstein-wiener|input=abs,polynomial:3|output=piecewise:8",
    "wiener-hammerstein|static=saturation",
    "narx-wavelet|degree=2|units=3|refine=none",
    "narmax|degree=2|terms=y(t-1), u(t-1)*y(t-1)",
    "dc-motor|friction=none|input=voltage|output=speed|substeps=1",
    "tanks|substeps=2",
)


# ------------------------------------------------------------------------------- logs


def _logs() -> list[str]:
    from written_logs import LOGGERS

    return ["\n".join(make().text.splitlines()[:60]) + "\n" for make in LOGGERS.values()]


def _log(path: Path) -> None:
    from sysid.data.io import read_file

    read_file(path)


def _parquet() -> list[bytes]:
    import pandas as pd

    k = np.arange(40.0)
    plain = pd.DataFrame({"t": 0.1 * k, "u": k % 5, "y": k % 7})
    forms = (
        plain,
        plain.set_index("t"),
        plain.set_index(
            pd.date_range("2024-01-01", periods=40, freq="100ms", tz="UTC", name="time")
        ),
        plain.set_index(pd.Index(k, name="y")),
        plain.assign(u=pd.Categorical(["on", "off"] * 20), y=plain.y.astype("Int64")),
    )
    made = []
    for frame in forms:
        made.append(io.BytesIO())
        frame.to_parquet(made[-1])
    return [m.getvalue() for m in made]


def _sensors(path: Path) -> None:
    from sysid.robot.mission.localize import read_sensors

    read_sensors(path)


def _sensor_logs() -> list[str]:
    rows = "".join(f"{0.1 * k:.1f},{k % 5},{k % 7},{k % 3},{k},{k},0.1\n" for k in range(30))
    return ["t,omega_l,omega_r,gyro_z,x,y,psi\n" + rows]


def _bench(path: Path) -> None:
    from sysid.testbench.motor.files import read_bench_files

    read_bench_files([path], {}, 1.0, {})


def _bench_logs() -> list[str]:
    return [
        "\n".join(p.read_text().splitlines()[:30]) + "\n"
        for p in sorted((DATA / "bench").glob("*.csv"))
    ]


def _swing(path: Path) -> None:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.testbench.pendulum.swing import read_swing

    read_swing(path, ReadOptions(), 0.3)


def _swings() -> list[str]:
    t = 0.02 * np.arange(80)
    rows = [f"{a:.2f},{0.2 * np.cos(5 * a):.4f}" for a in t]
    marks = [f"{a:.2f},{np.cos(a):.4f},0,0,{np.sin(a):.4f}" for a in t]
    return ["t,angle\n" + "\n".join(rows) + "\n", "t,qw,qx,qy,qz\n" + "\n".join(marks) + "\n"]


def _power(path: Path) -> None:
    from sysid.testbench.power.power_log import read_power_log

    read_power_log(path)


def _power_logs() -> list[str]:
    rows = "".join(
        f"{0.1 * k:.1f},{7.4 - 0.01 * k:.2f},{k % 4},{0.1 * (k % 9)},{k % 5}\n" for k in range(40)
    )
    return ["t,battery_voltage_V,battery_current_A,pwm,motor_voltage_V\n" + rows]


def _returns(path: Path) -> None:
    from sysid.robot.calibration.square_runs import read_returns
    from sysid.vehicle.kinematics import Geometry

    read_returns(path, 4.0, Geometry())


def _selftest(path: Path) -> None:
    from sysid.plant.selftest import read_csv

    plant = next(m for m in _models() if not isinstance(m, dict)).plant()
    read_csv(path.read_bytes(), plant, path.name)


PARSERS: dict[str, Parser] = {
    "model": Parser(".json", _model_files, _use_model, 500),
    "plant": Parser(".json", _plant_files, _use_plant, 300),
    "workspace": Parser(".json", _workspaces, _workspace, 300),
    "mission": Parser(".yaml", _missions, _mission, 80),
    "mission-text": Parser(".yaml", lambda: [yaml.safe_dump(FULL_MISSION)], _mission, 30),
    "vehicle": Parser(".yaml", lambda: _yaml_of("vehicles"), _vehicle, 60),
    "urdf": Parser(".urdf", _urdf, _vehicle, 300),
    "soil": Parser(
        ".yaml",
        lambda: [
            {"soil": {"kc": 13.19, "kphi": 692.15, "n": 0.5, "c": 4.14, "phi": 13, "K": 0.006}},
            {"vehicle": {"r": 0.03, "B": 0.2, "L": 0.2, "mass": 3, "soil": "clay"}},
            "clay",
        ],
        _soils,
        80,
    ),
    "motors": Parser(
        ".yaml",
        lambda: [{"resistance": [2.4, 0.1], "back_emf": 0.01, "gear": 45, "inertia": 1e-6}],
        _motors,
        80,
    ),
    "map": Parser(
        ".yaml",
        lambda: [
            {"omega_l": "/joint_states.velocity[wheel_left]", "y [m]": "-/odom.x", "z": "0.5*/a.b"}
        ],
        _map,
        100,
    ),
    "measured": Parser(
        ".json", lambda: [{"measured": {"R": {"value": 1.0, "std_error": 0.1}}}], _measured, 500
    ),
    "orders": Parser(
        ".txt",
        lambda: [
            "na=1:4 nb=2 nk=0:3",
            "na=1,0;0,1 nb=2",
            "arx: na=2 nb=2; oe: nb=2 nf=2",
            "nb=1,2 nf=1,1",
        ],
        _orders,
        800,
    ),
    "options": Parser(".txt", lambda: list(STATICS), _statics, 300),
    "log": Parser(".csv", _logs, _log, 250),
    "parquet": Parser(".parquet", _parquet, _log, 300),
    "sensors": Parser(".csv", _sensor_logs, _sensors, 150),
    "bench": Parser(".csv", _bench_logs, _bench, 300),
    "swing": Parser(".csv", _swings, _swing, 150),
    "power": Parser(".csv", _power_logs, _power, 150),
    "returns": Parser(".csv", lambda: ["direction,x,y\ncw,0.1,-0.2\nccw,0.1,0.1\n"], _returns, 500),
    "selftest": Parser(".csv", lambda: ["t,u,y\n0,1,2\n0.05,1,2.5\n"], _selftest, 400),
    "first commands": Parser(".csv", lambda: list(good_logs()), inspect_and_fit, 5),
    "command": Parser(".txt", lambda: list(COMMANDS), run_command, 10),
}
