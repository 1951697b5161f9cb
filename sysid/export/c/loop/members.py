"""Units and descriptions of the struct members, by name."""

_WORDS = {
    "t": ("s", "time since the start of the mission"),
    "dt": ("s", "time since the step before, 0 at the first one"),
    "x": ("m", "X in the inertial frame"),
    "y": ("m", "Y in the inertial frame"),
    "psi": ("rad", "yaw in (-pi, pi], counter-clockwise"),
    "speed": ("m/s", "forward speed"),
    "yaw_rate": ("rad/s", "yaw rate"),
    "omega_l": ("rad/s", "left wheel speed"),
    "omega_r": ("rad/s", "right wheel speed"),
    "drive_l": ("", "left command held since the step before, 1 is full drive"),
    "drive_r": ("", "right command held since the step before, 1 is full drive"),
    "reference_speed": ("m/s", "wanted forward speed"),
    "reference_psi": ("rad", "wanted yaw"),
    "arrived": ("", "1 where the goal is reached"),
    "gives_up": ("", "1 where guidance sees no way"),
    "hold": ("", "what keeps the robot from coming closer, a number"),
    "detour": ("", "1 while it is led away from the goal on purpose"),
    "v_cmd": ("", "speed command, 1 is full drive"),
    "psi_cmd": ("", "yaw command, 1 is full drive"),
    "applied_v_cmd": ("", "part of the last speed command that reached the tracks"),
    "applied_psi_cmd": ("", "part of the last yaw command that reached the tracks"),
    "pwm_l": ("us", "left pulse width, -20000 to 20000"),
    "pwm_r": ("us", "right pulse width, -20000 to 20000"),
    "goal_x": ("m", "X of the goal"),
    "goal_y": ("m", "Y of the goal"),
    "start_x": ("m", "X of the start"),
    "start_y": ("m", "Y of the start"),
    "start_psi": ("rad", "yaw at the start"),
    "tolerance": ("m", "the goal counts as reached within this distance"),
    "vehicle_r": ("m", "sprocket radius"),
    "vehicle_B": ("m", "distance of the track centre lines"),
}
_ENDINGS = (
    ("_x", "m", "X"),
    ("_y", "m", "Y"),
    ("_vx", "m/s", "velocity in X"),
    ("_vy", "m/s", "velocity in Y"),
    ("_psi", "rad", "yaw"),
    ("_speed", "m/s", "forward speed"),
    ("_yaw_rate", "rad/s", "yaw rate"),
    ("_radius", "m", "radius"),
)


def described(name: str) -> tuple[str, str]:
    """(unit, words) of a member; empty where its name says all that is known."""
    if name in _WORDS:
        return _WORDS[name]
    for ending, unit, words in _ENDINGS:
        if name.endswith(ending):
            return unit, f"{words} of {name.removesuffix(ending).replace('_', ' ')}"
    return "", ""
