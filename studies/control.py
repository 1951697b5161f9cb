"""How well each kind of control tracks, and what making up for identified effects is worth.

The robots of the second table hold an effect whose
numbers nobody is told: each drives a log with noise, ``diagnose`` names what is missing from a
plain model of it, and the robot itself, not its model, is then driven with and without the effect
made up for as it was identified.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from studies.compensated_robots import FAMILY, PERIOD, driven, family_runs
from studies.runner import Study
from sysid.data.preprocess import Detrend
from sysid.data.record import PWM_FULL_SCALE, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.effects.catalogue import effect
from sysid.effects.programmes import LEVELS, STAIRCASE
from sysid.report.markdown import table
from sysid.robot.mission.contracts import ROBOT_INPUTS, ROBOT_OUTPUTS
from sysid.robot.mission.control.linear import YawP
from sysid.robot.mission.registry import kinds, law_class
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.structures.augmented.structure import Augmented
from sysid.structures.plant import Plant
from sysid.vehicle.kinematics import Geometry

STUDY = Study("control", "control.md", first=101)
SEED = STUDY.first
DT, NOISE = 0.05, 0.1

TOP = 0.43 / Geometry().r
"""Wheel speed at full drive [rad/s]; torques count in the speed they hold."""

TRUTHS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "dead zone of 12 and 16 %": {"dead-zone": {"plus": 0.12, "minus": 0.16, "jump": 0.0}},
    "dead zone of 8 %, then a jump of 4 %": {
        "dead-zone": {"plus": 0.08, "minus": 0.08, "jump": 0.04}
    },
    "dry friction of 15 % of full drive": {"coulomb-friction": {"level": 0.15 * TOP}},
    "friction that holds 20 % and rubs with 10 %": {
        "stiction": {"level": 0.1 * TOP, "excess": 0.1 * TOP, "speed": 2.0}
    },
}


def twin(effects: Mapping[str, Mapping[str, float]]) -> Plant:
    """Two first-order tracks, 10 % apart, behind effects."""
    structure = Augmented(1, 1, (PWM_FULL_SCALE,) * 2, DT, tuple(effects))
    lag = -float(np.exp(-DT / 0.2))
    theta = [0.95 * TOP, lag, 1.05 * TOP, lag]
    for id, values in effects.items():
        theta += [values.get(p.name, p.null) for p in effect(id).parameters] * 2
    none = Detrend(np.zeros(2), np.zeros(2))
    ranges = np.array([[-PWM_FULL_SCALE, PWM_FULL_SCALE]] * 2)
    return Plant.of_structure(
        structure, np.array(theta), DT, ROBOT_INPUTS, ROBOT_OUTPUTS, none, ranges
    )


def logged(plant: Plant, seed: int) -> list[Record]:
    """What the robot logs of a staircase and of many levels."""
    rng, found = np.random.default_rng(seed), []
    for programme in (STAIRCASE, LEVELS):
        rows = np.array(programme.rows)
        t = DT * np.arange(int(rows[-1, 0] / DT))
        u = PWM_FULL_SCALE * rows[np.searchsorted(rows[:, 0], t, side="right") - 1, 1:]
        state, y = plant.initial_state(), np.zeros((len(t), 2))
        for k, now in enumerate(u):
            state, y[k] = plant.step(state, now)
        y += NOISE * rng.standard_normal(y.shape)
        found.append(Record(u, y, DT, ROBOT_INPUTS, ROBOT_OUTPUTS))
    return found


def slowly(seconds: float = 40.0) -> list[tuple[float, float]]:
    """Slow driving, where a dead zone costs most, through the middle and round corners."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    speed = 0.12 + 0.08 * np.sin(0.5 * t)
    psi = 0.8 * np.sin(0.35 * t)
    return list(zip(speed.tolist(), psi.tolist(), strict=True))


def tracked(
    plant: RobotPlant, known: RobotPlant, compensate: Any, speed: Any, yaw: Any
) -> tuple[float, float]:
    """Errors of the speed [m/s] and of the yaw [rad]."""
    along = driven("speed", speed, slowly(), plant, known, compensate=compensate, yaw=yaw)
    around = driven("yaw", yaw, slowly(), plant, known, compensate=compensate, speed=speed)
    return along.rms, around.rms


def kinds_table(axis: str) -> str:
    """Error, its 95 % quantile and the effort of every kind."""
    rows = []
    for kind in kinds(f"control.{axis}"):
        runs = list(family_runs(axis, law_class(f"control.{axis}", kind)(), SEED))
        size = np.abs(np.concatenate([run.error for run in runs]))
        rms = float(np.sqrt(np.mean(size**2)))
        worst = max(run.rms for run in runs)
        effort = float(np.mean([run.effort for run in runs]))
        rows.append((rms, [f"`{kind}`", f"{rms:.4f}", f"{worst:.4f}", f"{effort:.4f}"]))
    unit = "m/s" if axis == "speed" else "rad"
    header = ["kind", f"error [{unit}]", f"of the worst robot [{unit}]", "effort [drive]"]
    return table(header, [row for _, row in sorted(rows, key=lambda r: r[0])])


def compensation_rows(words: str, truth: Mapping[str, Mapping[str, float]], k: int) -> list[Any]:
    """Errors with and without, by the controller of the thesis and by feed-forward and P."""
    plant = twin(truth)
    mission = Mission(goal=(9.0, 0.0))
    found = diagnose(logged(plant, SEED + k), seed=0)
    model = found.after
    known, robot = as_robot(model.plant(), mission)[0], as_robot(plant, mission)[0]
    named = [id for id in known.identified.effects if effect(id).inverse is not None]
    rows = []
    for name, speed in (("`pi` and `p`", "pi"), ("`p` and `p`", "p")):
        law = law_class("control.speed", speed)()
        without = tracked(robot, known, (), law, YawP())
        made_up = tracked(robot, known, "identified", law, YawP())
        ideal = tracked(as_robot(twin({}), mission)[0], known_plain(), (), law, YawP())
        rows.append(
            [
                words,
                ", ".join(f"`{id}`" for id in named) or "nothing",
                name,
                *(
                    f"{a:.4f} → {b:.4f} ({c:.4f})"
                    for a, b, c in zip(without, made_up, ideal, strict=True)
                ),
            ]
        )
        print(*rows[-1], sep=" | ", flush=True)
    return rows


def known_plain() -> RobotPlant:
    """The robot without any effect, as it is."""
    return as_robot(twin({}), Mission(goal=(9.0, 0.0)))[0]


TEXT = """# Control

Laws and keys: [control.md](../docs/control.md).

## Kinds

Each kind with its default gains on {robots} first-order robots: 0.8, 1 and 1.25 times the speed
at full drive of the identified one, 0.75, 1 and 1.75 times its lag of 0.2 s, tracks equal or 20 %
apart. Every law that knows a model knows the identified one, of which most of these robots
differ. References: a step every 4 s and a slow wave, 40 s a robot; a command every 0.1 s. Error:
root mean square over all robots, most of it the steps themselves; effort: mean change of the
command a period.

### Speed

{speed}
### Yaw

{yaw}
`neural` was taught by `{teacher_speed}` (speed) and `{teacher_yaw}` (yaw):
`studies/train_neural_control.py`, on other references.

## Making up for identified effects

A robot holds an effect; two logs of it (a staircase and levels, 20 samples a second, noise of 0.1
rad/s) are diagnosed, and the robot, not the model, follows a speed between 0.04 and 0.2 m/s
through bends of ±0.8 rad, plainly and with `compensate: identified`. In brackets: the same robot
if it had no effect, with the same controller.

{compensation}
The yaw error is nearly the same with an effect, with it undone and without it: what is left is
the lag of a P behind a moving reference. Friction that is larger at rest than in motion is made
up for least.
"""


def main() -> None:
    """Both tables."""
    import json

    from sysid.robot.mission.control import neural

    asked = STUDY.asked(__doc__)

    raw = json.loads((Path(neural.__file__).parent / "neural.json").read_text(encoding="utf-8"))
    rows = [
        row
        for k, (words, truth) in enumerate(TRUTHS.items())
        for row in compensation_rows(words, truth, k)
    ]
    header = ["the robot", "identified and undone", "control", "speed error [m/s]", "yaw [rad]"]
    STUDY.write(
        asked,
        TEXT.format(
            robots=len(FAMILY),
            speed=kinds_table("speed"),
            yaw=kinds_table("yaw"),
            teacher_speed=raw["speed"]["taught_by"],
            teacher_yaw=raw["yaw"]["taught_by"],
            compensation=table(header, rows),
        ),
    )


if __name__ == "__main__":
    main()
