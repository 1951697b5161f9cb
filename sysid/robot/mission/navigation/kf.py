"""The linear Kalman filter."""

from typing import ClassVar

from sysid.robot.mission.navigation.ekf import ExtendedKalman


class Kalman(ExtendedKalman):
    """Speed, heading, yaw rate and biases, and the position along a heading that counts as known.

    ψ and ψ̇ make one linear system: encoders read the difference of the tracks, a gyroscope ψ̇ plus
    its bias, a magnetometer ψ itself once its two components are an angle (4.3). Position and
    speed make another one that is linear once ψ is known: X⁺ = X + v cos ψ dt. So the estimate of
    the first enters the second as a known number, and P has no entries that couple position with
    heading: (4.4)–(4.11) as they stand, without slopes. What that leaves out is the heading's own
    uncertainty in the position, which the filter therefore believes to be smaller than it is.
    Motions from frame to frame are likewise laid along the heading that is believed at the frame.

    Slip, which multiplies, and acceleration to the left, a product of two states, are not used.
    """

    linear: ClassVar[bool] = True
