"""Logs with a hidden effect, and the truth about them in a file of its own.

``est.csv`` and ``val.csv`` are two drives of the same robot with the effect, ``clean.csv`` is one
of the robot without it. The truth goes to another folder, so that a command which is given the logs
cannot come across it.
"""

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING or __package__:
    from sysid_datasets.driving import STYLES, mission_loop, speed_loop
    from sysid_datasets.effect_robot import DISTANCE, PWM_FULL, RADIUS, Robot
    from sysid_datasets.effect_twin import Array, Chance, Driver, Run, simulate, table
    from sysid_datasets.hidden_effects import SIDES, generator, needs_pose, plain_robot, with_effect
else:  # run as a file, from a checkout in which nothing is installed
    from driving import STYLES, mission_loop, speed_loop
    from effect_robot import DISTANCE, PWM_FULL, RADIUS, Robot
    from effect_twin import Array, Chance, Driver, Run, simulate, table
    from hidden_effects import SIDES, generator, needs_pose, plain_robot, with_effect

TYPICAL_SPEED = 10.0
"""What the noise is a share of [rad/s]: the speed at half drive."""

NOISE = {"low": 0.01, "high": 0.03}
"""Standard deviation of a reading over the typical speed."""

POSE_NOISE = (0.001, 0.001, 0.002)
"""The same of x, y [m] and psi [rad] at low noise; three times as much at high noise."""

AR_POLE = 0.9
"""Pole of the coloured disturbance, at any sample time."""

WALK = 5.0
"""Standard deviation of the random walk of the load at the end of a log, over that of a reading."""

VALIDATION = 0.6
"""Length of the validation log over that of the estimation log."""

LONGEST_MISSION = 60.0
"""A mission that has not arrived by then ends there [s]."""

WINDOW = 2.0
"""Length of the pose increments [s]."""


@dataclass(frozen=True)
class Request:
    """What to hide, and in what kind of log."""

    effects: tuple[str, ...] = ()
    seed: int = 1
    noise: str = "low"
    style: str = "steps"
    duration: float = 120.0
    rate: float = 20.0
    strength: float = 1.0
    mission: bool = False
    disturbance: str = "white"
    closed_loop: bool = False
    clean: bool = False
    """Whether a log of the robot without effects is written too; always with changed-parameter."""

    @property
    def sigma(self) -> float:
        """Standard deviation of a reading [rad/s]."""
        return NOISE[self.noise] * TYPICAL_SPEED


@dataclass(frozen=True, eq=False)
class Hidden:
    """The files of a request by name, and the truth about them."""

    files: dict[str, str]
    truth: dict[str, object]


def hide(request: Request) -> Hidden:
    """Make the logs of ``request``; the same request gives the same bytes.

    Raises:
        KeyError: an effect, style or noise is not known.
    """
    dt = 1.0 / request.rate
    plain = plain_robot(request.seed)
    robot, told = plain, []
    for effect in request.effects:
        robot, entry = with_effect(
            robot, effect, request.seed, request.strength, dt, request.duration
        )
        told.append(entry)
    files, floors, excess = {}, {}, {}
    with_clean = request.clean or "changed-parameter" in request.effects
    pose = request.mission or needs_pose(request.effects)
    for number, name in enumerate(("est", "val", "clean") if with_clean else ("est", "val")):
        driven = plain if name == "clean" else robot
        chance, pose_noise = _chance(request, number)
        run = simulate(driven, _driver(request, plain, number), dt, chance)
        quiet = run
        if request.disturbance == "walk":
            still = Chance(chance.noise, 0.0 * chance.load, chance.events, chance.phase)
            quiet = simulate(driven, table(run.pwm.astype(np.int64)), dt, still)
        files[f"{name}.csv"] = _csv(run, pose_noise if pose else None, dt)
        floors[name] = _each(np.sqrt(np.mean((run.reading - quiet.clean) ** 2, axis=0)))
        if name != "clean":
            changed = plain if "changed-parameter" in request.effects else None
            excess[name] = _excess(quiet, changed, dt) | (_pose_excess(run, dt) if pose else {})
        if request.mission and name != "clean":
            goal = _goal(request.seed, number)
            files[f"mission_{name}.yaml"] = f"goal: [{goal[0]}, {goal[1]}]\ntimeout: 60\n"
    scale = NOISE[request.noise] / NOISE["low"]
    truth: dict[str, object] = {
        "effects": told,
        "request": asdict(request),
        "sample_time": dt,
        "base": {
            side: {"K": track.gain, "tau": track.time_constant}
            for side, track in zip(SIDES, plain.tracks, strict=True)
        },
        "geometry": {"r": RADIUS, "B": DISTANCE},
        "noise_sigma": dict.fromkeys(SIDES, request.sigma)
        | {c: round(scale * s, 6) for c, s in zip(("x", "y", "psi"), POSE_NOISE, strict=True)},
        "floor": floors,
        "excess": excess,
    }
    return Hidden(files, truth)


def write_hidden(request: Request, out: Path) -> list[Path]:
    """Write the logs to ``out`` and the truth to ``out``/truth/truth.json; return the files.

    Raises:
        KeyError: an effect, style or noise is not known.
        OSError: a file cannot be written.
    """
    hidden = hide(request)
    # JSON has no infinity: an absent limit (strength 0) is null.
    told = json.dumps(_finite(hidden.truth), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    texts = {out / name: text for name, text in hidden.files.items()}
    texts[out / "truth" / "truth.json"] = told
    for file, text in texts.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        draft = file.with_name(file.name + ".part")
        draft.write_text(text, encoding="utf-8", newline="\n")
        draft.replace(file)
    return list(texts)


def plain_fit(pwm: Array, speed: Array, sample_time: float) -> tuple[float, float, float]:
    """K, τ and RMS error of the first-order track from rest that fits best, over a whole log.

    ŷ(k+1) = a ŷ(k) + (1 − a) K d(k): K by least squares, τ in 0.02 … 2 s by golden section.
    """
    drive = (pwm / PWM_FULL).tolist()

    def fitted(log_tau: float) -> tuple[float, float]:
        a = math.exp(-sample_time / math.exp(log_tau))
        state, unit = 0.0, []
        for d in drive:
            unit.append(state)
            state = a * state + (1.0 - a) * d
        x = np.array(unit)
        power = float(x @ x)
        gain = float(x @ speed) / power if power > 0.0 else 0.0
        return float(np.sqrt(np.mean((speed - gain * x) ** 2))), gain

    low, high, golden = math.log(0.02), math.log(2.0), 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(22):
        inner = (high - golden * (high - low), low + golden * (high - low))
        low, high = (
            (low, inner[1]) if fitted(inner[0])[0] < fitted(inner[1])[0] else (inner[0], high)
        )
    error, gain = fitted(0.5 * (low + high))
    return gain, math.exp(0.5 * (low + high)), error


def _driver(request: Request, plain: Robot, number: int) -> Driver:
    dt = 1.0 / request.rate
    if request.mission:
        return mission_loop(_goal(request.seed, number), dt)
    commands = STYLES[request.style](
        generator(request.seed, 10, number), _samples(request, number), dt
    )
    if request.closed_loop:
        return speed_loop(commands, (plain.tracks[0].gain, plain.tracks[1].gain), dt)
    return table(commands)


def _samples(request: Request, number: int) -> int:
    seconds = request.duration * (VALIDATION if number == 1 else 1.0)
    if request.mission:
        seconds = LONGEST_MISSION
    return max(2, round(seconds * request.rate))


def _goal(seed: int, number: int) -> tuple[float, float]:
    """A goal 3 to 5 m away that asks for a turn of 30° to 85°, to another side in each log."""
    rng = generator(seed, 16, number)
    far, bearing = rng.uniform(3.0, 5.0), math.radians(rng.uniform(30.0, 85.0))
    side = 1.0 if (seed + number) % 2 else -1.0
    return round(far * math.cos(bearing), 2), round(side * far * math.sin(bearing), 2)


def _chance(request: Request, number: int) -> tuple[Chance, Array]:
    """What befalls a log, and the noise of its pose."""
    n, seed = _samples(request, number), request.seed
    noise = generator(seed, 11, number).standard_normal((n, 2))
    load = np.zeros((n, 2))
    if request.disturbance == "ar":
        for k in range(1, n):
            noise[k] = AR_POLE * noise[k - 1] + math.sqrt(1.0 - AR_POLE**2) * noise[k]
    elif request.disturbance == "walk":
        steps = generator(seed, 12, number).standard_normal((n, 2))
        load = WALK * request.sigma / math.sqrt(n) * np.cumsum(steps, axis=0)
    events = generator(seed, 13, number).random((n, 2))
    first, second = generator(seed, 15, number).uniform(0.0, 2.0 * math.pi, 2).tolist()
    spread = NOISE[request.noise] / NOISE["low"] * np.array(POSE_NOISE)
    pose = spread * generator(seed, 14, number).standard_normal((n, 3))
    return Chance(request.sigma * noise, load, events, (first, second)), pose


def _csv(run: Run, pose_noise: Array | None, dt: float) -> str:
    columns = [run.t[:, None], run.pwm, run.reading]
    header, row = "t,pwm_l,pwm_r,omega_l,omega_r", "%.10g,%.0f,%.0f,%.4f,%.4f"
    if pose_noise is not None:
        columns.append(run.pose + pose_noise[: len(run.pose)])
        header, row = header + ",x,y,psi", row + ",%.4f,%.4f,%.4f"
    # Rounding first and adding zero turns every -0.0 into 0.0, which prints without a sign.
    values = np.hstack([columns[0].round(9), np.hstack(columns[1:]).round(4)]) + 0.0
    return "\n".join([header, *(row % tuple(v) for v in values.tolist())]) + "\n"


def _excess(run: Run, changed_from: Robot | None, dt: float) -> dict[str, float]:
    """RMS [rad/s] of what the noise-free readings have beyond the best plain track.

    Of a changed parameter: beyond the unchanged robot under the same commands.
    """
    if changed_from is None:
        return _each(np.array([plain_fit(run.pwm[:, i], run.clean[:, i], dt)[2] for i in (0, 1)]))
    before = simulate(changed_from, table(run.pwm.astype(np.int64)), dt, Chance.none(len(run.t)))
    return _each(np.sqrt(np.mean((run.clean - before.clean) ** 2, axis=0)))


def _pose_excess(run: Run, dt: float) -> dict[str, float]:
    """RMS over windows of what turn [rad] and way [m] differ from nominal tracks without slip."""
    span = max(1, round(WINDOW / dt))
    mean = 0.5 * (run.omega[1:] + run.omega[:-1]) * dt * RADIUS
    turn = (mean[:, 1] - mean[:, 0]) / DISTANCE
    way = 0.5 * (mean[:, 0] + mean[:, 1])
    steps = np.diff(run.pose, axis=0)
    middle = 0.5 * (run.pose[1:, 2] + run.pose[:-1, 2])
    gone = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
    off = np.cumsum(np.column_stack([steps[:, 2] - turn, gone - way]), axis=0)
    windows = off[span:] - off[:-span]
    rms = np.sqrt(np.mean(windows**2, axis=0)) if len(windows) else np.zeros(2)
    return {"turn": round(float(rms[0]), 6), "way": round(float(rms[1]), 6)}


def _each(values: Array) -> dict[str, float]:
    return {side: round(float(v), 6) for side, v in zip(SIDES, values, strict=True)}


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
