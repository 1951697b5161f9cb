"""Any identified plant as a robot: two PWM inputs in µs, two wheel speeds in rad/s.

A plant identified from a robot's log passes through unchanged. For anything else (a bench motor, a
heater, a winding machine) the closed loop can still be run as a test of the model, once
assumptions fill what the data do not say; each of them is returned as a sentence.
"""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array, Channel
from sysid.errors import ModelError
from sysid.robot.mission.contracts import SteppablePlant, TurnsTracks
from sysid.robot.mission.equipment import assumed
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.supply import supply_notes
from sysid.robot.mission.tracks.robot_plant import RobotPlant, identified_effects
from sysid.robot.mission.tracks.settling import Ending, Settling, settle
from sysid.robot.mission.tracks.torque import check_lifted
from sysid.robot.mission.tracks.wiring import Wiring, wirings
from sysid.robot.mission.vehicle_spec import VehicleSpec
from sysid.robot.mission.vehicle_spec import assumed as assumed_physics

TOP_SPEED = 0.43
"""Forward speed of the thesis's robot at full drive [m/s]."""


@dataclass(frozen=True)
class WiringRule:
    """When two channels of a plant count as the tracks of a vehicle, and what is worth a warning.

    Attributes:
        turns: turning at opposite full drives, in parts of that of two independent tracks, that
            counts as steering: below it the outputs hardly differ, above it the yaw loop would be
            far too strong.
        drifts: speed along the way at opposite full drives, in parts of full speed; independent
            tracks have none. Channels without names beyond this are no pair of tracks: their
            answers nearly cancel in straight driving and are magnified by its scale in everything
            else.
        hardly: share of the top speed below which a robot's track does not answer to driving
            straight: what a track that only ever turned on the spot is left with.
        swings: an output that swings beyond this many times its final value is worth a warning:
            a second-order step overshoots to less than twice its final value.
        answers: an output whose final value moves by less than this part of itself under full
            drive does not answer: rounding does as much.
    """

    turns: tuple[float, float] = (0.2, 5.0)
    drifts: float = 1.0
    hardly: float = 0.1
    swings: float = 3.0
    answers: float = 1e-9


RULE = WiringRule()


@dataclass(frozen=True, eq=False)
class _Drive:
    """How drive becomes input: u = centre + span·drive on the driven inputs."""

    centre: Array
    span: Array
    notes: tuple[str, ...]


def as_robot(
    plant: SteppablePlant, mission: Mission, top_speed: float = TOP_SPEED
) -> tuple[RobotPlant, tuple[str, ...]]:
    """Wire and scale a plant as a robot.

    Tracks: channels named left and right (``_l``, ``left``, …) go to their track by name; without
    such names the first two inputs and outputs are left and right in order; where there is one
    input or one output, or two that do not steer, each track gets its own copy of the plant.
    Other inputs stay at the operating point.

    Scale: PWM [µs] in and rad/s out are taken as they are. Otherwise full drive is the largest
    input seen in the data (``input_range``, or ±1), counted from 0 where the data contain it and
    from the operating point where they do not, and the output is scaled so that full drive ends
    at ``top_speed``. The mission's ``vehicle.command_scale`` and ``speed_scale`` replace either:
    u = command_scale·drive, ω = speed_scale·y; so does the voltage of ``vehicle.supply`` for inputs
    in V, whose wheel speeds in rad/s are then taken as they are. An output that falls where the
    drive rises is turned over.

    Args:
        top_speed: forward speed at full drive [m/s].

    Returns:
        The robot, and a sentence for each assumption, those about navigation's sensors included.
    """
    robot, notes = _driving(plant, mission, top_speed)
    volts = all(_is_voltage(plant.inputs[i]) for i in robot.driven)
    notes = (*notes, *supply_notes(mission.vehicle.supply, identified_effects(robot), volts))
    said = assumed(mission.navigation, mission.sensors, robot.dt)
    if isinstance(mission.motion, TurnsTracks):
        said += check_lifted(robot, mission.vehicle.lifted)
    wanted = getattr(mission.motion, "wanted", ())
    missing = assumed_physics(mission.physics, wanted, mission.car)
    return robot, (*notes, *said, *([missing] if missing else []))


def _scaled(mission: Mission) -> VehicleSpec:
    """The vehicle; where the motion turns the tracks, with their speeds as motors have them."""
    vehicle = mission.vehicle
    if not isinstance(mission.motion, TurnsTracks):
        return vehicle
    if vehicle.speed_scale not in (None, 1.0):
        raise ModelError(
            f"vehicle.speed_scale is {vehicle.speed_scale:g}, but this motion computes the speeds "
            "from the motors' torque; omit it"
        )
    return vehicle.model_copy(update={"speed_scale": 1.0})


def _driving(
    plant: SteppablePlant, mission: Mission, top_speed: float
) -> tuple[RobotPlant, tuple[str, ...]]:
    """The robot of the first wiring that drives, and a sentence for each assumption of it."""
    complaint, vehicle = "", _scaled(mission)
    for wiring in wirings(plant):
        wired = _wired(plant, wiring, vehicle, top_speed)
        if isinstance(wired, str):
            complaint = complaint or wired
            continue
        robot, notes = wired
        if wiring.twins:
            return robot, (_twins_note(plant, wiring, complaint), *notes)
        turning, drift = _opposite(robot, top_speed / mission.vehicle.r)
        if wiring.named:
            weak = () if turning >= RULE.turns[0] else (_WEAK_STEERING,)
            return robot, (*_fixed_note(plant, wiring), *notes, *weak)
        if RULE.turns[0] <= abs(turning) <= RULE.turns[1] and abs(drift) <= RULE.drifts:
            if turning < 0:  # the first output answers more to the second input
                wiring = Wiring(False, wiring.driven, wiring.read[::-1])
                wired = _wired(plant, wiring, vehicle, top_speed)
            if not isinstance(wired, str):
                taken = (_order_note(plant, wiring), *_fixed_note(plant, wiring))
                return wired[0], (*taken, *wired[1])
        complaint = "its first two inputs and outputs do not steer as two tracks do"
    raise ModelError(f"the plant cannot drive a robot: {complaint}")


def _unsettled(
    plant: SteppablePlant, wiring: Wiring, drive: "_Drive", vehicle: VehicleSpec
) -> tuple[RobotPlant, tuple[str, ...]]:
    """A robot's own plant with a mode too slow to settle: driven as it is, with a warning.

    Its channels are PWM and wheel speed already, so nothing has to be scaled by a final value.
    """
    state = plant.initial_state()
    robot = _robot(plant, wiring, drive, np.zeros(2), np.full(2, vehicle.speed_scale or 1.0), state)
    return robot, (
        *drive.notes,
        "The plant has a mode too slow to settle: its speed drifts under a constant command; "
        "prefer a model of lower order, or one fitted to a longer log.",
    )


def _robot(
    plant: SteppablePlant, wiring: Wiring, drive: "_Drive", zero: Array, scale: Array, rest: Array
) -> RobotPlant:
    """The plant in this wiring; ``rest`` is the state of one of its copies."""
    state = np.array((rest, rest)) if wiring.twins else rest
    tracks = wiring.twins, wiring.driven, wiring.read
    return RobotPlant(plant, *tracks, drive.centre, drive.span, zero, scale, state)


def _wired(
    plant: SteppablePlant, wiring: Wiring, vehicle: VehicleSpec, top_speed: float
) -> tuple[RobotPlant, tuple[str, ...]] | str:
    """Scale one wiring; the sentences name what was assumed."""
    u, y = plant.inputs, plant.outputs
    at = list(wiring.read)
    driven = [u[i] for i in wiring.driven]
    powered = [_is(c, "µs", "pwm") or _supplied(c, vehicle) is not None for c in driven]
    direct = all(powered) and all(_is(y[j], "rad/s", "omega") for j in at)
    drive = _drive(plant, wiring, vehicle, direct)
    rest, answer = _static_answer(plant, drive, wiring)
    if answer.ending is Ending.KEEPS_MOVING and direct:
        return _unsettled(plant, wiring, drive, vehicle)
    refused = _refusal(plant, wiring, rest, answer)
    if refused:
        return refused
    rise = answer.y[at] - rest.y[at]
    notes = list(drive.notes)

    zero, scale = np.zeros(2), np.ones(2)
    if vehicle.speed_scale is not None:
        scale *= vehicle.speed_scale
    elif not direct:
        zero, scale = rest.y[at], top_speed / vehicle.r / np.abs(rise)
        notes.extend(
            f"{_quantity(y[at[k]])} changes by {_number(rise[k])} at full drive, which is taken "
            f"as {top_speed:g} m/s."
            for k in wiring.tracks
        )
    falls = scale * rise < 0
    for k in wiring.tracks:
        swing = answer.swing[at[k]] / abs(rise[k])
        if swing > RULE.swings:
            notes.append(f"{_quantity(y[at[k]])} swings to {swing:.1f} times its final value.")
        if direct and abs(rise[k]) * vehicle.r < RULE.hardly * top_speed:
            falls[k] = False
            notes.append(
                f"{_quantity(y[at[k]])} hardly moves when both tracks are driven forward. The "
                "plant's data lack straight driving, so this run means little; identify it from a "
                "log with straight drives."
            )
        elif falls[k]:
            notes.append(
                f"{_quantity(y[at[k]])} falls where the drive rises, so its sign was reversed; "
                "check the wiring or the sign of the data."
            )
    robot = _robot(plant, wiring, drive, zero, np.where(falls, -scale, scale), rest.state)
    return robot, tuple(notes)


def _drive(plant: SteppablePlant, wiring: Wiring, vehicle: VehicleSpec, direct: bool) -> _Drive:
    """Choose what zero and full drive are in the plant's units."""
    centre = np.array(plant.u_offset, dtype=float)
    span = np.empty(2)
    notes = []
    for track, i in enumerate(wiring.driven):
        volts = _supplied(plant.inputs[i], vehicle)
        if vehicle.command_scale is not None or direct or volts is not None:
            centre[i] = 0.0
            span[track] = vehicle.command_scale or volts or PWM_FULL_SCALE
            continue
        low, high = _input_range(plant, i)
        if low <= 0.0 <= high:
            centre[i] = 0.0
        elif not low < centre[i] < high:
            centre[i] = 0.5 * (low + high)
        span[track] = max(high - centre[i], centre[i] - low)
        if track in wiring.tracks:
            notes.append(
                f"{_quantity(plant.inputs[i])} from {_number(centre[i])} to "
                f"{_number(centre[i] + span[track])} is taken as zero to full drive."
            )
    return _Drive(centre, span, tuple(notes))


def _static_answer(
    plant: SteppablePlant, drive: _Drive, wiring: Wiring
) -> tuple[Settling, Settling]:
    """The plant after zero and after full drive; where it does not rest at zero, that twice."""
    rest = settle(plant, plant.initial_state(), drive.centre)
    if rest.ending is not Ending.RESTS:
        return rest, rest
    raised = drive.centre.copy()
    raised[list(wiring.driven)] += drive.span
    return rest, settle(plant, rest.state, raised)


def _refusal(plant: SteppablePlant, wiring: Wiring, rest: Settling, answer: Settling) -> str:
    """Why nothing can be scaled by a static answer: there is none, or an output does not answer."""
    if answer.ending is not Ending.RESTS:
        return answer.ending.value
    for i, j in zip(wiring.driven, wiring.read, strict=True):
        if abs(answer.y[j] - rest.y[j]) <= RULE.answers * max(abs(answer.y[j]), abs(rest.y[j])):
            return (
                f"output {plant.outputs[j].name} does not respond to a constant input "
                f"{plant.inputs[i].name}; fit it with other inputs or outputs"
            )
    return ""


def _opposite(robot: RobotPlant, full: float) -> tuple[float, float]:
    """(ω_R − ω_L)/2 and (ω_R + ω_L)/2 at opposite full drives, in parts of ω at full drive."""
    settled = settle(robot, robot.initial_state(), np.array((-PWM_FULL_SCALE, PWM_FULL_SCALE)))
    if settled.ending is not Ending.RESTS:  # a nonlinear plant may rest forwards only
        return 0.0, 0.0
    y = settled.y
    return float(y[1] - y[0]) / (2.0 * full), float(y[1] + y[0]) / (2.0 * full)


def _input_range(plant: SteppablePlant, i: int) -> tuple[float, float]:
    """Lowest and highest value of an input in the data; ±1 when unknown or constant."""
    ranges = plant.input_range
    low, high = ranges[i] if i < len(ranges) else (-1.0, 1.0)
    return (float(low), float(high)) if high > low else (-1.0, 1.0)


def _is(channel: Channel, unit: str, name: str) -> bool:
    """Whether a channel has a unit, or none and a name that begins like this."""
    return channel.unit == unit or (not channel.unit and channel.name.startswith(name))


def _is_voltage(channel: Channel) -> bool:
    return channel.unit == "V"


def _supplied(channel: Channel, vehicle: VehicleSpec) -> float | None:
    """Full drive [V] of an input that is a voltage, where the vehicle's supply says it."""
    known = vehicle.supply is not None and _is_voltage(channel)
    return vehicle.supply.voltage if known and vehicle.supply is not None else None


# Sentences ----------------------------------------------------------------------------------------

_WEAK_STEERING = (
    "The plant hardly turns, or turns the wrong way, when its tracks are driven in opposite "
    "directions: identify it from data where they were commanded differently."
)


def _quantity(channel: Channel) -> str:
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}"  # adding zero turns -0 into 0


def _twins_note(plant: SteppablePlant, wiring: Wiring, complaint: str) -> str:
    names = [c.name for c in plant.inputs]
    driven = names.pop(wiring.driven[0])
    note = (
        f"Each track is driven by its own copy of the plant from {driven} to "
        f"{plant.outputs[wiring.read[0]].name}"
    )
    if names:
        note += f", with {', '.join(names)} fixed at the operating point"
    return f"{note}, because {complaint}." if complaint else f"{note}."


def _order_note(plant: SteppablePlant, wiring: Wiring) -> str:
    (ul, ur), (yl, yr) = wiring.driven, wiring.read
    u, y = plant.inputs, plant.outputs
    return (
        f"Input {u[ul].name} and output {y[yl].name} are taken as the left track, "
        f"{u[ur].name} and {y[yr].name} as the right one."
    )


def _fixed_note(plant: SteppablePlant, wiring: Wiring) -> tuple[str, ...]:
    fixed = [c.name for i, c in enumerate(plant.inputs) if i not in wiring.driven]
    return (f"Fixed at the operating point: {', '.join(fixed)}.",) if fixed else ()
