"""Control: PI on the forward speed, P on the yaw, and the command module that makes PWM of them."""

from dataclasses import dataclass

from sysid.data.record import PWM_FULL_SCALE
from sysid.mission.spec import ControlSpec
from sysid.vehicle.kinematics import wrap_angle


@dataclass(frozen=True)
class Commands:
    """What the controller decided.

    Attributes:
        v_cmd: speed command [drive], saturated.
        psi_cmd: yaw command [drive], saturated.
        pwm_l, pwm_r: pulse widths [µs], within the full scale.
    """

    v_cmd: float
    psi_cmd: float
    pwm_l: float
    pwm_r: float


STANDSTILL = Commands(0.0, 0.0, 0.0, 0.0)
"""The command at the end of a mission."""


def speed_command(
    error: float, integral: float, period: float, spec: ControlSpec
) -> tuple[float, float]:
    """Return V_cmd [drive] of a PI in parallel form, and its new integral.

    V_cmd = sat(K_p e + I),  I ← I + K_i e T     (thesis 4.32, 6.1)

    Anti-windup by conditional integration: the integral keeps its value whenever the command is
    on a limit and the error would push it further beyond. (Back-calculation would add a gain
    that the thesis does not have.)

    Args:
        error: e = V_ref − V_x [m/s].
        integral: I before this sample [drive].
        period: T [s].
        spec: gains and limits.
    """
    grown = integral + spec.ki_speed * error * period
    command = spec.kp_speed * error + grown
    if command > spec.v_cmd_max:
        return spec.v_cmd_max, min(grown, integral)
    if command < spec.v_cmd_min:
        return spec.v_cmd_min, max(grown, integral)
    return command, grown


def yaw_command(psi_ref: float, psi: float, spec: ControlSpec) -> float:
    """Return ψ_cmd = sat(K_pψ e) [drive] with e = ψ_ref − ψ wrapped to (−π, π] (thesis 6.2)."""
    command: float = spec.kp_yaw * wrap_angle(psi_ref - psi)
    return min(max(command, -spec.psi_cmd_max), spec.psi_cmd_max)


def command_module(v_cmd: float, psi_cmd: float) -> Commands:
    """Return PWM_l = (V_cmd − ψ_cmd)·20000, PWM_r = (V_cmd + ψ_cmd)·20000 (thesis 6.3).

    Each pulse width is clipped to ±20000 µs, the full scale of the drive.
    """

    def pulse(drive: float) -> float:
        return PWM_FULL_SCALE * min(max(drive, -1.0), 1.0)

    return Commands(v_cmd, psi_cmd, pulse(v_cmd - psi_cmd), pulse(v_cmd + psi_cmd))


def control(
    v_ref: float,
    psi_ref: float,
    v: float,
    psi: float,
    integral: float,
    spec: ControlSpec,
) -> tuple[Commands, float]:
    """Run the controller once: references and estimates in, PWM and the PI's new integral out.

    Args:
        v_ref, psi_ref: references of guidance [m/s, rad].
        v, psi: forward speed and yaw estimated by navigation [m/s, rad].
        integral: the PI's integral after the previous period [drive]; 0 at the start.
        spec: gains, limits and period.
    """
    v_cmd, integral = speed_command(v_ref - v, integral, spec.period, spec)
    return command_module(v_cmd, yaw_command(psi_ref, psi, spec)), integral
