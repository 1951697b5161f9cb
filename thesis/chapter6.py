"""Chapter 6: the plant, the gains and the references."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from studies import tuning_report
from studies.mission_report import SECTORS
from sysid.data.record import Array
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.robot.mission.contracts import Disc
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.guidance.field import (
    PotentialField,
)
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.spec import Mission
from sysid.vehicle.kinematics import Geometry, body_velocity
from thesis.entries import DRAWN, Row, Sheet, compared, falls, line, number, verdict
from thesis.plants import published_model, simulink

TRACKS = "the twin's tracks are ours, and the values drawn are not printed"
TOP_SPEED = 0.43
"""Top speed of the robot, printed in 6.2.5 [m/s]."""


def plant() -> Sheet:
    """6.8 and 6.9: an example of the plant; and 6.10, a mission."""
    model, dt = published_model(), 0.1
    t = dt * np.arange(120)
    left, right = np.zeros(len(t)), np.zeros(len(t))
    left[t >= 1.0] = right[t >= 1.0] = 10000.0
    left[t >= 5.0] = 4000.0
    left[t >= 9.0] = right[t >= 9.0] = 0.0
    u = np.column_stack([left, right])
    omega = model.simulate(u)
    v, yaw_rate = _body(omega)
    steady, turning = (t > 4.0) & (t < 5.0), (t > 8.0) & (t < 9.0)
    rows = (
        Row("6.8", "steps [µs]", DRAWN, "10000 on both at 1 s, 4000 on the left at 5 s, 0 at 9 s",
            "–", "height and time of the thesis's steps are not printed"),
        Row("6.9", "V_x under equal commands [m/s]", DRAWN, number(v[steady].mean(), ".2f"), "–",
            TRACKS),
        Row("6.9", "yaw rate under equal commands [rad/s]", "slightly to the left",
            number(float(yaw_rate[steady].mean()), ".2f"),
            verdict(yaw_rate[steady].mean() > 0), TRACKS),
        Row("6.9", "yaw rate with 4000 on the left [rad/s]", DRAWN,
            number(float(yaw_rate[turning].mean()), ".2f"), "–", TRACKS),
        Row("6.10", "path of an example mission", DRAWN, "mission 2, at 8.6", "–",
            "the scene is not printed"),
    )  # fmt: skip
    panels = (
        panel("6.8: commands", "time [s]", "PWM [10³ µs]",
              (line("left", t, left / 1e3), line("right", t, right / 1e3))),
        panel("6.9: forward speed", "time [s]", "V_x [m/s]", (line("V_x", t, v),)),
        panel("6.9: yaw rate", "time [s]", "ψ̇ [rad/s]", (line("ψ̇", t, yaw_rate),)),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter6/plant.svg",
        PanelPicture("An example of the plant", "the identified model", panels),
    )


def _body(omega: Array) -> tuple[Array, Array]:
    """Forward speed and yaw rate of track speeds (2.13)."""
    return body_velocity(omega[:, 0], omega[:, 1], Geometry())


def speed() -> Sheet:
    """6.12–6.14."""
    study = tuning_report.speed(published_model())
    left = {(r[0], float(r[1]), float(r[2])): r[5] for r in study.rows}
    rise = {(r[0], float(r[1]), float(r[2])): r[3] for r in study.rows}
    alone = [left["6.12", k, 0.0] for k in (1.0, 2.0, 4.0, 8.0)]
    both = [left["6.13", k, 0.5] for k in (0.5, 1.0, 2.0, 4.0)]
    slow, *faster = (rise["6.14", 2.0, k] for k in (0.5, 1.0, 1.85, 4.0))
    rows = (
        Row("6.12", "error at the end for K_p 1, 2, 4, 8",
            "K_p must be raised considerably to come close",
            ", ".join(alone), verdict(falls(alone)), TRACKS),
        Row("6.13", "error after 8 s for K_p 0.5, 1, 2, 4 with K_i 0.5",
            "the aim is reached with a smaller K_p",
            ", ".join(both), verdict(max(float(v.split()[0]) for v in both) < 5.0),
            "closer than K_p alone, and slow with K_i 0.5; " + TRACKS),
        Row("6.14", "rise [s] for K_i 0.5, 1, 1.85, 4 with K_p 2", "faster with K_i",
            ", ".join((slow, *faster)), verdict(slow == "never" and falls(faster)), TRACKS),
        Row("6.14", "error after 8 s with K_p 2 and K_i 1.85", "cancelled",
            left["6.14", 2.0, 1.85], left["6.14", 2.0, 1.85], "still falling"),
    )  # fmt: skip
    return Sheet(rows, "chapter6/speed.svg", study.picture)


def yaw() -> Sheet:
    """6.15."""
    study = tuning_report.yaw(published_model())
    rise, over = ({r[0]: r[k] for r in study.rows} for k in (1, 3))
    gains = ("0.2", "0.3", "0.4", "0.6", "1")
    rows = (
        Row(
            "6.15",
            f"rise [s] for K_pψ {', '.join(gains)}",
            "faster with K_pψ",
            ", ".join(rise[g] for g in gains),
            verdict(falls([rise[g] for g in gains])),
            TRACKS,
        ),
        Row(
            "6.15",
            "overshoot at the reversal",
            "unwanted for high K_pψ",
            ", ".join(over[g] for g in gains),
            verdict(float(over["1"].split()[0]) > float(over["0.4"].split()[0])),
            TRACKS,
        ),
    )
    return Sheet(rows, "chapter6/yaw.svg", study.picture)


def paths() -> Sheet:
    """6.16–6.19."""
    study = tuning_report.paths(published_model())
    cells = {(r[0], r[1]): r for r in study.rows}
    free, around = "without an obstacle", "with an obstacle"
    open_way = {g: _with_gain(Mission(goal=(1.0, 1.0)), g) for g in (0.3, 0.6)}
    blocked = {g: _with_gain(tuning_report.AROUND, g) for g in (0.3, 0.6)}
    settled = [_settles(open_way[g]) for g in (0.3, 0.6)]
    times = [cells[around, g][2].removeprefix("arrived, ") for g in ("0.6", "0.3")]
    rows = (
        Row(
            "6.16",
            "length of the path [m], K_pψ 0.3 and 0.6",
            "longer with 0.3",
            f"{cells[free, '0.3'][3]} and {cells[free, '0.6'][3]}",
            verdict(falls([cells[free, g][3] for g in ("0.3", "0.6")])),
            "the goal is not printed, ours is (1, 1)",
        ),
        Row(
            "6.17",
            "enters ±10° of the reference after [s], K_pψ 0.3 and 0.6",
            "later than 2 s, and within 2 s",
            " and ".join(number(s, ".1f") for s in settled),
            verdict(settled[0] > 2.0 >= settled[1]),
            "a smaller first error: the goal is not printed",
        ),
        Row(
            "6.18",
            "time of the mission, K_pψ 0.3 and 0.6",
            "longer with 0.6",
            f"{times[1]} and {times[0]}",
            verdict(falls(times)),
            "goal and obstacle are not printed",
        ),
        Row(
            "6.19",
            "largest turn [°] with K_pψ 0.6",
            "more than one turn",
            number(_turned(blocked[0.6]), ".0f"),
            verdict(_turned(blocked[0.6]) > 360.0),
            "needs a robot that is caught by the obstacle; the scene is not printed",
        ),
    )
    return Sheet(rows, "chapter6/paths.svg", study.picture)


def _with_gain(mission: Mission, gain: float) -> MissionResult:
    return simulink(mission.model_copy(update={"control": SpeedPIYawP(kp_yaw=gain)}))


def _settles(result: MissionResult) -> float:
    """When the heading first is within 10° of its reference [s]."""
    error = result.log["psi_ref"] - result.log["psi"]
    inside = np.abs(np.arctan2(np.sin(error), np.cos(error))) <= np.radians(10.0)
    return float(result.log["t"][np.argmax(inside)])


def _turned(result: MissionResult) -> float:
    """Between the least and the largest heading [°]."""
    return float(np.degrees(np.ptp(np.unwrap(result.log["psi"]))))


def sectors() -> Sheet:
    """6.21–6.24."""
    study, rows = tuning_report.sectors(published_model()), []
    for k, (x, y) in enumerate(SECTORS):
        result = simulink(Mission(goal=(float(x), float(y))))
        heading = np.degrees(np.unwrap(result.log["psi"]))
        waits = float(result.log["t"][np.argmax(result.log["v_ref"] > 0)])
        turned = heading[np.argmax(np.abs(heading))]
        wanted = "goal in front: driven to at once" if x > 0 else "turned towards ±π first"
        rows.append(
            Row(
                f"6.{21 + k}",
                f"goal ({x}, {y})".replace("-", "−"),
                wanted,
                f"{result.outcome} after {result.time_s:.1f} s, on the spot for {waits:.1f} s, "
                f"turned {number(float(turned), '+.0f')}°",
                verdict(result.outcome == "arrived" and (waits > 0) == (x < 0)),
                "the goals are not printed; the middle of the sector is the reference, since ±π "
                "wrapped turns the long way round"
                if x < 0
                else "the goals are not printed",
            )
        )
    return Sheet(tuple(rows), "chapter6/sectors.svg", study.picture)


@cache
def forces() -> Sheet:
    """6.25 and 6.26."""
    law = PotentialField()
    x = np.linspace(0.0, 4.0, 161)
    pull = [
        line(f"K {k:g}", x, _varied(law, K=k).attraction(x, 0.0 * x, (4.0, 0.0))[0])
        for k in (0.05, 0.1, 0.15, 0.2, 0.3)
    ]
    near = np.linspace(0.0, 0.75, 151)
    obstacle = Disc(1.0, 0.0, 0.0)
    push = [
        line(f"η {e:g}", near, -_varied(law, eta=e).repulsion(near, 0.0 * near, obstacle)[0])
        for e in (0.01, 0.025, 0.05, 0.1, 0.2)
    ]
    rows = (
        compared(
            "6.25",
            "largest attraction with K = 0.15",
            0.3,
            law.K * law.d,
            ".2f",
            "K·d; equals V_xmax = 0.3 m/s",
        ),
        compared(
            "6.25",
            "K beyond which the force exceeds the top speed of 0.43 m/s",
            0.2,
            TOP_SPEED / law.d,
            ".2f",
            "printed as a round number",
        ),
        compared("6.26", "distance at which the repulsion begins [m]", 0.7, law.rho0, ".1f"),
        Row(
            "6.26",
            "distance at which it equals the largest attraction [m]",
            DRAWN,
            number(_balance(law), ".2f"),
            "–",
            "η = 0.05 keeps the robot's centre farther away",
        ),
    )
    panels = (
        panel("6.25: attraction of a goal at 4 m", "X [m]", "force", tuple(pull)),
        panel("6.26: repulsion of an obstacle at 1 m", "X [m]", "force", tuple(push)),
    )
    picture = PanelPicture("Forces of the potential field", "", panels, columns=2)
    return Sheet(rows, "chapter6/forces.svg", picture)


def _varied(law: PotentialField, **gains: float) -> PotentialField:
    return law.model_copy(update=gains)


def _balance(law: PotentialField) -> float:
    """Distance from an obstacle at which repulsion equals the largest attraction [m]."""
    rho = np.linspace(0.05, law.rho0, 100001)
    push = law.eta * (1.0 / rho - 1.0 / law.rho0) / rho**2
    return float(rho[np.argmax(push <= law.K * law.d)])


def references() -> Sheet:
    """6.27, 6.29 and 6.30."""
    law = PotentialField()
    rho = np.linspace(0.0, 5.0, 161)

    def curves(name: str, gain: str, values: Sequence[float], **fixed: float) -> tuple[Curve, ...]:
        return tuple(
            line(f"{name} {v:g}", rho, _reference(_varied(law, **fixed, **{gain: v}), rho))
            for v in values
        )

    half = float(_reference(law, np.array([0.2]))[0]) / law.v_max
    thetas = [_reference(_varied(law, theta=v, Kg=1.0), np.array([1.0]))[0] for v in (1.0, 2.0)]
    powers = [_reference(_varied(law, h=v), np.array([0.1]))[0] for v in (1.0, 2.0)]
    rows = (
        Row(
            "6.27",
            "V_d 1 m before the goal for θ 1 and 2, K_g = h = 1 [m/s]",
            "θ brakes later, more steeply",
            " and ".join(number(v, ".2f") for v in thetas),
            verdict(thetas[1] > thetas[0]),
            "exact: (4.31)",
        ),
        Row(
            "6.29",
            "V_d 0.1 m before the goal for h 1 and 2 [m/s]",
            "h makes the braking near the goal more pronounced",
            " and ".join(number(v, ".2f") for v in powers),
            verdict(powers[1] < powers[0]),
            "exact: (4.31)",
        ),
        compared(
            "6.30",
            "V_d over its maximum at 0.2 m with K_g = 0.4 [%]",
            50.0,
            100 * half,
            ".1f",
            "“around”; exact: θ/(θ + K_g/ρ)",
        ),
    )
    panels = (
        panel("6.27: θ, with K_g = h = 1", "distance to the goal [m]", "V_d [m/s]",
              curves("θ", "theta", (0.5, 1.0, 2.0, 3.0, 5.0), Kg=1.0)),
        panel("6.29: h", "distance to the goal [m]", "V_d [m/s]",
              curves("h", "h", (0.5, 1.0, 2.0, 3.0, 5.0))),
        panel("6.30: K_g", "distance to the goal [m]", "V_d [m/s]",
              curves("K_g", "Kg", (0.1, 0.2, 0.4, 0.7, 1.0))),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter6/references.svg",
        PanelPicture(
            "Reference of speed without obstacles", "V_max 0.3 m/s, else θ 2, h 1, K_g 0.4", panels
        ),
    )


def _reference(law: PotentialField, rho: Array) -> Array:
    found: Array = law.speed(rho, 0.0 * rho, (0.0, 0.0), ())
    return found


def theta() -> Sheet:
    """6.28."""
    study = tuning_report.references(published_model())
    times = {r[0]: r[1] for r in study.rows}
    seconds = {k: float(v.removeprefix("arrived, ").removesuffix(" s")) for k, v in times.items()}
    rows = (
        compared("6.28", "time to 5 m with θ = 1 [s]", 21.5, seconds["1"], ".1f", TRACKS),
        compared("6.28", "time to 5 m with θ = 2 [s]", 19.6, seconds["2"], ".1f", TRACKS),
        Row("6.28", "θ = 3", "passes the goal and turns back", times["3"],
            verdict(not times["3"].startswith("arrived") or seconds["3"] > seconds["2"]),
            "our plant slows down smoothly and stops in time; the thesis's is "
            "unreliable below 5000 µs"),
    )  # fmt: skip
    return Sheet(rows, "chapter6/theta.svg", study.picture)


def settings() -> Sheet:
    """Every number of guidance and control that is printed, against the defaults of a mission."""
    mission = Mission(goal=(1.0, 0.0))
    law, control = mission.guidance, mission.control
    printed = (
        ("§6.2.1", "K_p of the speed", 2.0, control.kp_speed),
        ("§6.2.1", "K_i of the speed", 1.85, control.ki_speed),
        ("§6.2.1", "K_pψ", 0.4, control.kp_yaw),
        ("§6.2.5", "K", 0.15, law.K),
        ("§6.2.5", "d [m]", 2.0, law.d),
        ("§6.2.5", "η", 0.05, law.eta),
        ("§6.2", "ρ₀ [m]", 0.7, law.rho0),
        ("§6.2.5", "V_xmax [m/s]", 0.3, law.v_max),
        ("§6.2.5", "θ", 2.0, law.theta),
        ("§6.2.5", "h", 1.0, law.h),
        ("§6.2.5", "K_g [m]", 0.4, law.Kg),
        ("§6.2.5", "K_i of an obstacle [m]", 1.0, law.Ki),
        ("§6.2.5", "tolerance [m]", 0.1, mission.tolerance),
        ("§8.1.1", "sampling period [s]", 0.1, control.period),
    )
    rows = tuple(compared(*each, ".3g", "the default of a mission") for each in printed)
    ours = f"[{control.v_cmd_min:g}, {control.v_cmd_max:g}] and ±{control.psi_cmd_max:g}"
    why = "“a saturation has been imposed”: ours keep a turn from stopping a track"
    limits = Row("§6.2.1", "limits of both commands", "not printed", ours, "–", why)
    return Sheet((*rows, limits))


SHEETS = (plant, settings, speed, yaw, paths, sectors, forces, references, theta)
