"""The mission simulator: the closed loop of a robot plant, sample after sample."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.clearance import has_surfaces, off_line
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Body,
    Command,
    Pose,
    Scene,
    SteppablePlant,
    TurnsTracks,
)
from sysid.robot.mission.ending import ending
from sysid.robot.mission.loop import (
    COLUMNS,
    CommandShaper,
    Loop,
    LoopState,
    Tick,
    Verdict,
    plain_shaper,
    ticks,
)
from sysid.robot.mission.noise import sensor_draws
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.supply import feed_of
from sysid.robot.mission.tracks.compensation import compensation_of
from sysid.robot.mission.tracks.robot_plant import identified_effects
from sysid.robot.mission.tracks.settling import limits_of, nominal_of
from sysid.robot.mission.tracks.torque import motors_of, on_ground
from sysid.runners import floats


@dataclass(frozen=True)
class RunLimits:
    """What no run goes beyond.

    Attributes:
        samples: a mission with more samples or commands than this would not end while somebody
            waits: minutes at tens of microseconds each.
        wheel_speed: no wheel turns this fast [rad/s]; above it the plant's output is running away.
    """

    samples: int = 5_000_000
    wheel_speed: float = 1e6


LIMITS = RunLimits()


def simulate(
    mission: Mission, plant: SteppablePlant, seed: int = 0, known: SteppablePlant | None = None
) -> MissionResult:
    """Drive a robot plant through a mission.

    Two clocks run on one time line: the plant's, t = k·dt, and the controller's, t = j·period; no
    ratio between them is asked for. At a control instant guidance and control use the latest
    wheel-speed measurement, the one of the same instant included; their command is held and reaches
    the plant at its first sample at or after the instant. Between samples of the plant nothing
    new is read, so a controller faster than the plant repeats itself on held measurements (its
    integral still counts time), and one slower than the plant holds its command over several.

    A measurement at t = k·dt is y(k) under the command held so far. For plants whose y(k) does not
    depend on u(k) that is y(k) itself; with feed-through the logged y(k) belongs to the new u(k).
    The vehicle moves by the mission's motion, after what the plant's ``ground`` takes off the track
    speeds; navigation sees the wheels alone.

    A mission ends at the first sample where the robot has touched an obstacle (clearance ≤ 0
    anywhere on the way there), guidance reports arrival, the distance to go has shrunk too little
    for too long (:class:`sysid.robot.mission.loop.StuckRule`), or the timeout is reached. It has
    arrived where its true pose is at the goal (:data:`sysid.robot.mission.loop.THERE`), and has
    missed it where only the estimated one is.

    Args:
        plant: inputs ``pwm_l, pwm_r`` [µs], outputs ``omega_l, omega_r`` [rad/s] in this order;
            :func:`sysid.robot.mission.tracks.mapping.as_robot` makes one of any plant.
        seed: of the sensors' noise; without sensors nothing is random.
        known: the robot plant that control takes this one for, where it is another.

    Returns:
        The outcome, its figures and the log.

    Raises:
        UsageError: the seed is negative.
        ModelError: the plant is no robot plant, samples too fast for the timeout, or diverges; or
            a law gives no numbers.
    """
    check_robot(mission, plant)
    if seed < 0:
        raise UsageError(f"the seed is {seed}: give a whole number of at least 0")
    informed = plant if known is None else known
    scene, shaper = scene_of(mission, informed), shaper_of(mission, informed)
    loop = closed_loop(mission, plant, scene, floats, shaper)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        state, table = run(loop, seed)
    return result_of(mission, loop, state, table)


def result_of(
    mission: Mission, loop: Loop, state: LoopState, table: Array, ended: str | None = None
) -> MissionResult:
    """What a run came to.

    Args:
        state, table: its last state and the rows of its log.
        ended: the outcome of a run that another one ended; its own verdict goes first.
    """
    table.setflags(write=False)
    log = MappingProxyType({name: table[:, i] for i, name in enumerate(loop.columns)})
    verdict = Verdict(int(state.verdict))
    if verdict is not Verdict.GOES_ON:
        outcome = Outcome[verdict.name]
    elif ended in [o.value for o in Outcome]:
        outcome = Outcome(ended)
    else:
        raise ModelError(
            f"the mission was interrupted at t = {table[-1, 0]:g} s by its other half; read its "
            "message, and start both again"
        )
    final, believed = (Pose(*map(float, b.pose)) for b in (state.body, state.estimate))
    words, stuck = ending(outcome, mission, log, state.references)
    return MissionResult(
        outcome=outcome,
        time_s=float(table[-1, 0]),
        final=final,
        off_goal_m=float(loop.scene.to_goal(final, floats)),
        believed=believed,
        believed_off_goal_m=float(loop.scene.to_goal(believed, floats)),
        path_length_m=float(state.progress.path_length),
        min_clearance_m=float(state.progress.clearance) if has_surfaces(loop.scene) else None,
        max_deviation_m=float(
            np.max(off_line(log["x"], log["y"], mission.start, mission.goal, np))
        ),
        log=log,
        sentence=words,
        stuck=stuck,
    )


def shaper_of(mission: Mission, known: SteppablePlant) -> CommandShaper:
    """What makes PWM of a mission's commands, the effects undone that are to be compensated.

    Args:
        known: the robot plant that holds them, as it was identified.
    """
    compensate = mission.control.compensate
    return compensation_of(known, compensate, mission.vehicle.geometry) or plain_shaper


def scene_of(mission: Mission, known: SteppablePlant) -> Scene:
    """The scene of a mission, with what guidance and control know of the plant if they use it."""
    scene, driven = mission.scene(), known
    wanted = mission.limits_from_plant or mission.control.uses_plant
    if wanted and isinstance(mission.motion, TurnsTracks):
        known = on_ground(known, scene)
    if mission.limits_from_plant:
        limits = limits_of(known, scene.geometry)
        scene = scene._replace(limits=limits._replace(**mission.limits.given))
    if not mission.control.uses_plant:
        return scene
    shaper, at_rest = shaper_of(mission, driven), Body(scene.start, 0.0, 0.0)

    def pwm(command: Command) -> tuple[float, float]:
        return shaper(command, at_rest, 0.0, floats)[0]

    return scene._replace(nominal=nominal_of(known, scene.geometry, pwm))


def closed_loop(
    mission: Mission,
    plant: SteppablePlant,
    scene: Scene,
    xp: Any = floats,
    shaper: CommandShaper = plain_shaper,
) -> Loop:
    """The loop of a mission's laws, a robot plant and a scene, over an array namespace."""
    if isinstance(mission.motion, TurnsTracks):
        scene = scene._replace(motors=motors_of(plant))
    return Loop(
        guidance=mission.complete_guidance,
        control=mission.control,
        navigation=mission.navigation,
        motion=mission.motion,
        plant=plant,
        scene=scene,
        timeout=mission.timeout,
        xp=xp,
        shaper=shaper,
        feed=feed_of(mission.vehicle.supply, identified_effects(plant)),
    )


def run(
    loop: Loop,
    seed: int,
    clock: Iterator[Tick] | None = None,
    seen: Callable[[LoopState, Tick], None] | None = None,
) -> tuple[LoopState, Array]:
    """Sample until the mission ends, or its clock does; the last state and the log's rows.

    Args:
        clock: its ticks; None for those of both clocks, one straight after the other.
        seen: takes the state after every sample, and its tick.

    Raises:
        ModelError: a law gives no numbers, the plant runs away, or the clock never ticked.
    """
    rows = []
    tick = Tick(0.0, 0.0, (), ())
    try:
        state = loop.start()
        clock = clock or ticks(loop.plant.dt, loop.control.period)
        for tick, draws in zip(clock, sensor_draws(loop, seed), strict=False):
            state, row = loop.sample(state, tick, draws)
            if seen is not None:
                seen(state, tick)
            _check_numbers(state, row)
            rows.append(row)
            if state.verdict != Verdict.GOES_ON:
                break
    except (ArithmeticError, ValueError) as error:  # of plain floats, where arrays hold infinities
        raise ModelError(
            f"a law of the mission fails at t = {tick.t:g} s ({error}): change its keys, or avoid "
            "a division by zero"
        ) from error
    if not rows:
        raise ModelError("the mission ended before it began; start both halves again")
    return state, np.array(rows)


def _check_numbers(state: LoopState, row: tuple[float, ...]) -> None:
    """Say who is to blame for what is no number, or runs away."""
    turning = all(abs(omega) < LIMITS.wheel_speed for omega in row[3:5])
    if turning and all(map(math.isfinite, row[: len(COLUMNS)])):
        return
    estimate = (*state.estimate.pose, state.estimate.speed, state.estimate.yaw_rate)
    seen = all(map(math.isfinite, estimate))
    for part, gave, in_turn in (
        ("navigation", estimate, turning),
        ("guidance", (state.references.speed, state.references.psi), seen),
        ("control", state.command, seen),
        ("motion", (*state.body.pose, state.body.speed, state.body.yaw_rate), turning),
    ):
        if in_turn and not all(map(math.isfinite, gave)):
            raise ModelError(
                f"the law of {part} gives {', '.join(f'{n:g}' for n in gave)} at t = {row[0]:g} s, "
                "and the mission cannot continue; change its keys or correct the law"
            )
    raise ModelError(
        f"the plant's wheel speeds run away at t = {row[0]:g} s: the identified model is "
        "unstable; fit it with stability enforced or with lower orders"
    )


def check_robot(mission: Mission, plant: SteppablePlant) -> None:
    """Refuse what cannot be driven through a mission."""
    names = tuple(c.name for c in (*plant.inputs, *plant.outputs))
    wanted = tuple(c.name for c in (*ROBOT_INPUTS, *ROBOT_OUTPUTS))
    if names != wanted:
        raise ModelError(
            f"the plant's channels are {', '.join(names)} but a mission needs {', '.join(wanted)}: "
            "map the plant with as_robot first"
        )
    if not (math.isfinite(plant.dt) and plant.dt > 0):
        raise ModelError(f"the plant's sample time is {plant.dt} s: it must be above 0")
    fastest = min(plant.dt, mission.control.period)
    if mission.timeout / fastest > LIMITS.samples:
        what = "plant's sample time" if fastest == plant.dt else "control period"
        raise ModelError(
            f"the {what} of {fastest:g} s makes {mission.timeout / fastest:.3g} steps of a mission "
            f"of {mission.timeout:g} s: lower the timeout or lengthen the {what}"
        )
