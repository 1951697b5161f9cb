"""The interface between the two halves of a mission: references or PWM."""

from enum import StrEnum


class Level(StrEnum):
    """What the guidance half sends to the robot half."""

    REFERENCES = "references"
    """V_d [m/s] and ψ_d [rad]; the speed and yaw loops run in the robot half."""
    PWM = "pwm"
    """PWM of both tracks [µs]; the loops run in the guidance half."""
