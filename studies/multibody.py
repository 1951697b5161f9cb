"""Missions 1 and 2 of the thesis by MuJoCo, beside its Gazebo, its robot and the other motions.

Two plants, each as sysid identifies it: both tracks from ``prbs.csv``, and the motors from the
experiments of the thesis's bench. Both drive by every motion that takes them, and by MuJoCo once
more with plant, guidance, control and command module in the C of ``sysid export --controller``. One
picture is rendered, where MuJoCo finds OpenGL by EGL, or by what MUJOCO_GL names. Ends with 1 where
a mission does not arrive, or where the C drives another path than Python by more than 1e-9 m.
"""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")  # draws without a screen; read at MuJoCo's first import

import numpy as np
import sysid_datasets

from studies import compiled_loop
from studies.mission_report import BANDS, best_by_aic, called, identified
from studies.runner import Study
from sysid.report.markdown import table
from sysid.report.missions.panels import surroundings
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.report.plots import write_picture
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.model import Model

STUDY = Study("multibody", "multibody.md")

MISSIONS = {"goal_1m": "Mission 1: one metre ahead", "obstacles_6_3": "Mission 2: to (6, 3)"}

SAME = 1e-9
"""What the C may differ by [m], [rad]: the tolerance of a package's own closed loop."""


@dataclass(frozen=True)
class Case:
    """One way to drive.

    Attributes:
        plant: ``tracks`` or ``motors``.
        motion: kind of motion.
        pose: ``odometry``, or ``given``: by the simulation, as Gazebo gives it on ``/odom``.
        compiled: whether plant and laws are the exported C.
    """

    plant: str
    motion: str
    pose: str
    compiled: bool = False

    @property
    def words(self) -> list[str]:
        """Cells of the table."""
        by = f"`{self.motion}`" + (", driven by the C" if self.compiled else "")
        return [PLANTS[self.plant], by, self.pose]


PLANTS = {"tracks": "tracks of `prbs.csv`", "motors": "motors of the bench"}
WAYS = (
    ("tracks", "kinematic", False),
    ("tracks", "multibody", False),
    ("tracks", "multibody", True),
    ("motors", "kinematic", False),
    ("motors", "dynamic", False),
    ("motors", "multibody", False),
    ("motors", "multibody", True),
)
POSES = ("odometry", "given")
CASES = tuple(Case(*way[:2], pose, way[2]) for pose in POSES for way in WAYS)

HEAD = """# The missions in another physics

Missions 1 and 2 of the thesis in
[MuJoCo](../docs/mujoco.md), which stands in for its Gazebo: a box of {length:g} × {width:g} ×
{height:g} m and {mass:g} kg on two rows of {wheels} sprung wheels, friction {friction:g}, cylinders
as obstacles. Guidance and control have the thesis's gains; nothing was tuned to these outcomes.

- **Plants**: both tracks of the robot, identified from `prbs.csv` (the one of the
  [tour](tour.md), `{tracks}`); and the motors alone, identified as
  `sysid bench motor` does from the experiments of the thesis, one for each track, at {supply:g} V.
  Only motors without their load can drive `dynamic`; under `kinematic` and `multibody` they turn as
  they do on the bench.
- **Pose**: by odometry, as the robot has it (with r and B as they are), or given by the simulation,
  as Gazebo gives it (a Kalman filter of fixes and visual odometry that err by a tenth of a
  millimetre; it reads no wheels).
- **Driven by the C**: plant, guidance, control and command module are the compiled C of
  `sysid export --controller`; MuJoCo moves the body, and navigation gives the C the pose.

Times in seconds, lengths in metres. *Off* is how far from the goal the robot truly ends; guidance
stops it where it believes to be within 0.1 m. *Curve* is the largest distance from the straight
line, *clear* the smallest from the middle of the robot to a surface.

![paths by every motion](multibody.svg)

![mission 2 in MuJoCo, with the path and where the robot is every 5 s](multibody_scene.png)

"""

TELLS = """
## What the table says

- Where the pose is given, all ways arrive as published, Gazebo's among them.
- By odometry MuJoCo's robot ends {off:.2f} m from the second goal and believes to be there: its
  tracks scrub. On the spot, wheels {wide:.3f} m apart turn this body as far as they would turn one
  that is {scrub:.3f} m wide and meets no friction to the side (from where its wheels touch). Nobody
  put that in as a formula: it is what [diagnose](../docs/diagnose.md) has to find in its log.
- `dynamic` on a floor of the same friction ends {farther:.2f} m away by odometry: there friction to
  the side holds a heading against all that is less, while points of one friction, once they slide
  along, slide to the side as well.
- Tracks of `prbs.csv` differ from each other, and pull the robot to the left in mission 1, as the
  thesis's Simulink model and robot were pulled; two equal motors go straight, as in Gazebo.
- The C and Python drive the same: the paths differ by {error:.0e} m at most.
"""


def model_of(plant: str) -> Model:
    """An identified plant."""
    if plant == "tracks":
        return best_by_aic(identified("prbs"))
    from sysid.testbench.motor.model import bench_model
    from thesis.bench_motor import bench

    found = bench_model(bench())
    assert found is not None
    return found


def mission_of(name: str, case: Case) -> Mission:
    """A bundled mission, driven in one way."""
    from sysid_datasets.twin import DEVASTATOR

    from thesis.plants import EXACT, FRICTION, MASS

    own = load_mission(sysid_datasets.path(name))
    given: dict[str, Any] = {"goal": own.goal, "obstacles": own.obstacles}
    given["motion"] = {"kind": case.motion}
    if case.plant == "motors":
        given["vehicle"] = {"command_scale": DEVASTATOR.supply, "lifted": True}
    if case.motion == "dynamic":  # the floor of the multibody
        angle = float(np.arctan(FRICTION))
        given["motion"] |= {"mass": MASS}
        given["motion"] |= {
            "soil": {"preset": "concrete", "friction_angle": angle, "lateral": FRICTION}
        }
    if case.pose == "given":
        given["navigation"] = {"kind": "ekf"}
        given["sensors"] = {
            "position_fixes": {"noise": EXACT},
            "visual_odometry": {"noise": EXACT},
        }
    return Mission.model_validate(given)


def driven(name: str, case: Case, model: Model, compiler: str) -> MissionResult:
    """A mission in one way."""
    mission = mission_of(name, case)
    if not case.compiled:
        return simulate(mission, as_robot(model.plant(), mission)[0])
    laws = mission_of(name, Case(case.plant, "kinematic", case.pose))
    with tempfile.TemporaryDirectory() as folder:
        parts = compiled_loop.compiled(model, laws, Path(folder), compiler)
        return compiled_loop.drive(model, mission, parts)


def apart(one: MissionResult, other: MissionResult) -> float:
    """The largest difference of two logs in the pose [m], [rad]; infinite for unequal lengths."""
    if one.log["t"].shape != other.log["t"].shape:
        return np.inf
    return max(float(np.max(np.abs(one.log[c] - other.log[c]))) for c in ("x", "y", "psi"))


Found = Mapping[tuple[str, Case], MissionResult]


def rows_of(name: str, found: Found) -> list[list[str]]:
    """The table of a mission: published outcomes first."""
    (band,) = (b for b in BANDS if b.mission == name)
    rows = []
    for who, said in zip(("Simulink", "Gazebo", "robot"), band.published, strict=True):
        if said != "–":
            time, place = said.split(", ", 1)
            place, _, gain = place.partition("), ")
            title = f"*thesis: {who}*" + (f" ({gain})" if gain else "")
            place = place.rstrip(")") + ")"
            rows.append([title, *[""] * 2, "arrived", time.removesuffix(" s"), place, *["–"] * 3])
    goal = np.array(load_mission(sysid_datasets.path(name)).goal)
    for case in CASES:
        r = found[name, case]
        off = float(np.hypot(*(goal - r.final[:2])))
        clear = "–" if r.min_clearance_m is None else f"{r.min_clearance_m:.2f}"
        ends = f"({r.final[0]:.2f}, {round(r.final[1], 3) + 0.0:.3f})"  # no −0
        numbers = [f"{r.time_s:.1f}", ends, f"{off:.2f}", f"{r.max_deviation_m:.3f}", clear]
        rows.append([*case.words, str(r.outcome), *numbers])
    return rows


DRAWN = (
    ("tracks", "kinematic", False),
    ("motors", "dynamic", False),
    ("tracks", "multibody", False),
    ("tracks", "multibody", True),
)
"""Plant, motion, by the C: the lines of a panel."""


def draw(path: Path, found: Found) -> None:
    """The paths of both missions, by odometry and with the pose given."""
    panels = []
    for name, title in MISSIONS.items():
        own = load_mission(sysid_datasets.path(name))
        around = surroundings(own) if own.obstacles else []
        for pose in POSES:
            lines = []
            for plant, motion, compiled in DRAWN:
                log = found[name, Case(plant, motion, pose, compiled)].log
                label = f"{motion} ({plant})" + (", by the C" if compiled else "")
                lines.append(Curve(label, log["x"], log["y"], colour=-1 if compiled else 0))
            said = f"{title}, " + ("odometry" if pose == "odometry" else "pose given")
            panels.append(panel(said, "x [m]", "y [m]", lines, bool(around), around))
    note = (
        "true paths from (0, 0); mission 1 with y enlarged; mission 2: goal green, obstacles grey"
    )
    picture = PanelPicture("The missions in MuJoCo and by formulas", note, tuple(panels), 2)
    write_picture(path, picture)


def strips(log: Mapping[str, Any]) -> Iterable[tuple[Sequence[float], Sequence[float]]]:
    """Pieces of the path a hand's breadth long, just over the floor."""
    points = np.column_stack([log["x"], log["y"], np.full(len(log["x"]), 0.004)])[::2]
    return zip(points[:-1].tolist(), points[1:].tolist(), strict=True)


def render(path: Path, mission: Mission, result: MissionResult) -> str:
    """The robot between the obstacles, its path on the floor; why not where OpenGL is missing."""
    import mujoco
    from PIL import Image

    from sysid.cosim.multibody.engine import engine
    from sysid.cosim.multibody.motion import STAND_IN
    from sysid.robot.mission.contracts import Disc

    log, middle = result.log, len(result.log["t"]) // 2
    at = tuple(float(log[c][middle]) for c in ("x", "y", "psi"))
    discs = tuple(Disc(o.x, o.y, o.radius) for o in mission.obstacles)
    body = engine(STAND_IN, at, discs)
    body.advance(body.start, np.zeros((1, 2)), 0.0)
    size = body.model.vis.global_
    size.offwidth, size.offheight = 960, 540
    try:
        drawing = mujoco.Renderer(body.model, size.offheight, size.offwidth)
    except Exception as error:  # whatever OpenGL's loaders raise
        return f"{type(error).__name__}: {error}"
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = (2.8, 1.7, 0.0), 5.4
    camera.azimuth, camera.elevation = 90.0, -45.0
    drawing.update_scene(body.data, camera)
    scene, kinds = drawing.scene, mujoco.mjtGeom
    green, blue = np.array([0.0, 0.62, 0.45, 1.0]), np.array([0.1, 0.3, 0.7, 1.0])
    faint = np.array([0.27, 0.42, 0.62, 0.45])

    def added(kind: Any, size: Any, place: Any, turn: Any, colour: Any) -> Any:
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, kind, np.array(size), np.array(place), turn, colour)
        scene.ngeom += 1
        return geom

    upright, flat = np.eye(3).ravel(), np.zeros(3)
    added(kinds.mjGEOM_CYLINDER, (0.1, 0.002, 0.0), (*mission.goal, 0.002), upright, green)
    for a, b in strips(log):
        geom = added(kinds.mjGEOM_CAPSULE, flat, flat, upright, blue)
        mujoco.mjv_connector(geom, kinds.mjGEOM_CAPSULE, 0.01, np.array(a), np.array(b))
    box = 0.5 * np.array(STAND_IN.size)
    for k in range(0, len(log["t"]), 50):
        c, s = np.cos(log["psi"][k]), np.sin(log["psi"][k])
        turn = np.array([c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0])
        added(kinds.mjGEOM_BOX, box, (log["x"][k], log["y"][k], 0.03), turn, faint)
    Image.fromarray(drawing.render()).quantize(128).save(path, optimize=True)
    return ""


def main() -> int:
    """Drive everything, write tables and pictures."""
    asked = STUDY.asked(__doc__)
    target = asked.out
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        print("this study needs a C compiler: install gcc or clang", file=sys.stderr)
        return 2
    models = {plant: model_of(plant) for plant in PLANTS}
    found: dict[tuple[str, Case], MissionResult] = {}
    for name in MISSIONS:
        for case in CASES:
            found[name, case] = driven(name, case, models[case.plant], compiler)
            print(name, *case.words, found[name, case].outcome, flush=True)
    errors = [
        apart(result, found[name, Case(case.plant, case.motion, case.pose)])
        for (name, case), result in found.items()
        if case.compiled
    ]
    text = head(models["tracks"])
    for name, title in MISSIONS.items():
        heads = ["plant", "motion", "pose", "outcome", "time", "ends at", "off", "line", "clear"]
        text += f"## {title}\n\n" + table(heads, rows_of(name, found), "llllrrrrr") + "\n"
    text = text.rstrip("\n") + "\n" + tells(found, max(errors))
    STUDY.write(asked, text, "none")
    draw(target.with_suffix(".svg"), found)
    last = Case("tracks", "multibody", "given")
    why = render(
        target.with_name(f"{target.stem}_scene.png"),
        mission_of("obstacles_6_3", last),
        found["obstacles_6_3", last],
    )
    if why:
        print(f"not rendered: {why}", file=sys.stderr)
    arrived = all(r.outcome in ("arrived", "missed") for r in found.values())
    return int(not arrived or max(errors) > SAME)


def head(tracks: Model) -> str:
    """What is driven."""
    from sysid_datasets.twin import DEVASTATOR

    from sysid.cosim.multibody.motion import STAND_IN

    length, width, height = STAND_IN.size
    return HEAD.format(
        length=length,
        width=width,
        height=height,
        mass=STAND_IN.mass,
        wheels=STAND_IN.wheels,
        friction=STAND_IN.friction,
        tracks=called(tracks),
        supply=DEVASTATOR.supply,
    )


def tells(found: Found, error: float) -> str:
    """What is to be seen."""
    from sysid_datasets.multibody import scrub

    from sysid.cosim.multibody.motion import STAND_IN

    lost = found["obstacles_6_3", Case("tracks", "multibody", "odometry")]
    return TELLS.format(
        off=missed(lost),
        farther=missed(found["obstacles_6_3", Case("motors", "dynamic", "odometry")]),
        wide=STAND_IN.B,
        scrub=scrub(STAND_IN)[1],
        error=error,
    )


def missed(result: MissionResult) -> float:
    """How far from the second goal it ends [m]."""
    return float(np.hypot(result.final[0] - 6.0, result.final[1] - 3.0))


if __name__ == "__main__":
    sys.exit(main())
