"""The filters' algebra beside that of filterpy and Stone Soup, on the same measurements."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.robot.mission.axis import FirstOrder
from sysid.robot.mission.navigation.delays import BufferedSample
from sysid.robot.mission.navigation.design import Design
from sysid.robot.mission.navigation.ekf import ExtendedKalman
from sysid.robot.mission.navigation.fusion import Belief
from sysid.robot.mission.navigation.gaussian import Gaussian
from sysid.robot.mission.navigation.measurements import Group, Setting
from sysid.robot.mission.navigation.process import POSE_AND_SPEEDS, Process
from sysid.robot.mission.navigation.ukf import UnscentedKalman
from sysid.vehicle.kinematics import Geometry

EXACT = 1e-9
"""Fifty steps of the same formulas on numbers of order 1, rounded in another order."""

STATES = (*POSE_AND_SPEEDS, "slip_l", "slip_r", "gyro_z_bias")
WALKS = (0.0,) * 5 + (0.01, 0.01, 1e-6)
WHEELS = Group("encoders", ("omega_l", "omega_r"), (0.01, 0.02))
GYRO = Group("gyroscope", ("gyro_z",), (1e-4,), biased=frozenset({"gyro_z"}))
FIELD = Group("magnetometer", ("mag_x", "mag_y"), (1e-3, 1e-3))
CAMERA = Group("visual_odometry", ("vo_x", "vo_y", "vo_psi"), (1e-3, 1e-3, 1e-4))
NARROW = UnscentedKalman(gate=1.0, alpha=0.5, beta=2.0, kappa=1.0)

GROUPS = (WHEELS, GYRO, FIELD, CAMERA)


def start(n: int) -> Gaussian:
    x = np.array([0.1, -0.2, 0.3, 0.2, 0.4, 0.05, -0.05, 0.01])[:n]
    return Gaussian(x, np.diag([0.01, 0.02, 0.03, 0.01, 0.05, 0.01, 0.01, 1e-4][:n]))


def measurements(groups: tuple[Group, ...], steps: int = 50) -> Iterator[tuple[Array, ...]]:
    """Numbers that measurements might be; what they are worth does not matter here."""
    rng = np.random.default_rng(3)
    for k in range(steps):
        turn = 0.3 + 0.04 * k * 0.1
        true = {
            "omega_l": 8.0, "omega_r": 12.0, "gyro_z": 0.45, "vo_x": 0.1 + 0.02 * k,
            "vo_y": -0.2, "vo_psi": turn, "mag_x": np.cos(turn), "mag_y": -np.sin(turn),
            "heading": turn, "fix_x": 0.1 + 0.02 * k, "fix_y": -0.2,
        }  # fmt: skip
        yield tuple(
            np.array([true[n] for n in g.names])
            + rng.normal(size=len(g.names)) * np.sqrt(g.variance)
            for g in groups
        )


def ours(
    process: Process, groups: tuple[Group, ...], unscented: UnscentedKalman | None = None
) -> list[Gaussian]:
    """The beliefs after every step of our filter, its gate open."""
    law = unscented or ExtendedKalman(gate=1.0)
    plan = Design(process, groups, (), (None,) * len(groups))
    belief = Belief(start(len(process.names)), tuple(np.zeros(1 + len(g.names)) for g in groups))
    beliefs = []
    for z in measurements(groups):
        sample = BufferedSample(0.1, 0.0, z, np.ones(len(z)))
        belief, _ = law.fused(belief, plan, Geometry(), sample, np)
        beliefs.append(belief.of)
    return beliefs


def close(collected: list[Gaussian], wanted: list[Gaussian]) -> None:
    for one, other in zip(collected, wanted, strict=True):
        np.testing.assert_allclose(one.x, other.x, rtol=0, atol=EXACT)
        np.testing.assert_allclose(one.P, other.P, rtol=0, atol=EXACT)


def named(process: Process, x: Array) -> dict[str, Any]:
    return {name: x[i] for i, name in enumerate(process.names)}


def moved(process: Process, x: Array, drive: float = 0.0) -> Array:
    after = process.advanced(named(process, x), 0.1, drive, Geometry(), np)
    return np.array([after[name] for name in process.names])


def seen(process: Process, group: Group, x: Array) -> Array:
    expected = group.expected(named(process, x), Setting(Geometry(), elapsed=0.2), np)
    return np.array([one.value for one in expected])


def slopes(f: Callable[[Array], Array], x: Array, h: float = 1e-5) -> Array:
    return np.array([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))]).T


def H(process: Process, group: Group, x: Array) -> Array:
    expected = group.expected(named(process, x), Setting(Geometry(), elapsed=0.2), np)
    return np.array([[one.slopes.get(name, 0.0) for name in process.names] for one in expected])


def with_states(*names: str) -> Process:
    return Process((*POSE_AND_SPEEDS, *names), 0.05, 2.0, (0.0,) * (5 + len(names)))


LINEAR = Process(POSE_AND_SPEEDS, 0.05, 2.0, (0.0,) * 5, known_heading=True)
EXTENDED = Process(STATES, 0.05, 2.0, WALKS)
COMPASS = Group("magnetometer", ("heading",), (1e-3,))
FIXES = Group("position_fixes", ("fix_x", "fix_y"), (0.01, 0.01))


@pytest.mark.parametrize(
    ("process", "drive"),
    [
        (EXTENDED, 0.0),
        (
            Process((*POSE_AND_SPEEDS, "way", "turn", "slip_l", "slip_r"), 0.05, 2.0, (0.0,) * 9),
            0.0,
        ),
        (
            Process((*POSE_AND_SPEEDS, "x_vo", "y_vo", "psi_vo", "v_acc"), 0.05, 2.0, (0.0,) * 9),
            0.0,
        ),
        (Process(POSE_AND_SPEEDS, 0.05, 2.0, (0.0,) * 5, response=FirstOrder(0.43, 0.3)), 0.5),
    ],
    ids=["slip", "added-up", "frames", "response"],
)
@pytest.mark.parametrize("yaw_rate", [0.0, 1e-3, 0.4, 30.0])
def test_slopes_are_those_of_the_functions(process: Process, drive: float, yaw_rate: float) -> None:
    n = len(process.names)
    x = np.array([0.1, -0.2, 0.3, 0.2, yaw_rate, 0.2, -0.1, 0.01, 0.05])[:n]
    F = process.slopes(named(process, x), 0.1, drive, Geometry(), np)[0]
    # Central differences over 1e-5 leave out the third derivative times 2e-11 and round at 1e-11.
    np.testing.assert_allclose(F, slopes(lambda x: moved(process, x, drive), x), atol=1e-9)
    for group in TOLD_BY.get(process.names[5:], ()):
        wanted = slopes(lambda x, g=group: seen(process, g, x), x)
        # Wheel speeds are 1/r ≈ 50 times speeds, and round and bend so much more.
        np.testing.assert_allclose(H(process, group, x), wanted, atol=2e-7)


TOLD_BY = {
    STATES[5:]: (WHEELS, GYRO, FIELD, CAMERA),
    ("way", "turn", "slip_l", "slip_r"): (replace(WHEELS, adds_up=True),),
    ("x_vo", "y_vo", "psi_vo", "v_acc"): (
        replace(CAMERA, adds_up=True),
        Group("accelerometer", ("acc_x", "acc_y"), (0.1, 0.1)),
    ),
}
"""Groups of measurements by the states that they need besides pose and speeds."""


def test_noise_reaches_the_pose_as_it_does_in_the_vehicle() -> None:
    """Q is what random speeds at the end of a step make of the trapezoidal way."""
    dt, half, v = 0.1, 0.5 * 0.1, 0.2
    Q = LINEAR.slopes(
        {"x": 0.0, "y": 0.0, "psi": 0.0, "v": v, "yaw_rate": 0.0}, dt, 0.0, Geometry(), np
    )[1]
    variance = 0.05 * dt
    np.testing.assert_allclose(Q[np.ix_([0, 3], [0, 3])], variance * np.array(
        [[half**2, half], [half, 1.0]]
    ), rtol=1e-12)  # fmt: skip
    np.testing.assert_allclose(Q[2, [2, 4]], 2.0 * dt * np.array([half**2, half]), rtol=1e-12)


# filterpy -----------------------------------------------------------------------------------------


def test_the_linear_filter_is_filterpys() -> None:
    from filterpy.kalman import KalmanFilter

    groups = (WHEELS, Group("gyroscope", ("gyro_z",), (1e-4,)), COMPASS, FIXES)
    reference = KalmanFilter(dim_x=5, dim_z=2)
    reference.x, reference.P = start(5)
    wanted = []
    for z in measurements(groups):
        F, Q = LINEAR.slopes(named(LINEAR, reference.x), 0.1, 0.0, Geometry(), np)
        reference.predict(F=F, Q=Q)
        for group, numbers in zip(groups, z, strict=True):
            reference.update(numbers, R=np.diag(group.variance), H=H(LINEAR, group, reference.x))
        wanted.append(Gaussian(reference.x.copy(), reference.P.copy()))
    close(ours(LINEAR, groups), wanted)


def test_the_extended_filter_is_filterpys() -> None:
    from filterpy.kalman import ExtendedKalmanFilter

    class Reference(ExtendedKalmanFilter):
        def predict_x(self, u: float = 0.0) -> None:
            self.F, self.Q = EXTENDED.slopes(named(EXTENDED, self.x), 0.1, 0.0, Geometry(), np)
            self.x = moved(EXTENDED, self.x)

    reference = Reference(dim_x=8, dim_z=2)
    reference.x, reference.P = start(8)
    wanted = []
    for z in measurements(GROUPS):
        reference.predict()
        for group, numbers in zip(GROUPS, z, strict=True):
            reference.update(
                numbers,
                lambda x, g=group: H(EXTENDED, g, x),
                lambda x, g=group: seen(EXTENDED, g, x),
                R=np.diag(group.variance),
            )
        wanted.append(Gaussian(reference.x.copy(), reference.P.copy()))
    close(ours(EXTENDED, GROUPS), wanted)


@pytest.mark.parametrize("law", [UnscentedKalman(gate=1.0), NARROW], ids=["cubature", "narrow"])
def test_the_unscented_filter_is_filterpys(law: UnscentedKalman) -> None:
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    points = MerweScaledSigmaPoints(8, law.alpha, law.beta, law.kappa)
    reference = UnscentedKalmanFilter(
        8, 2, 0.1, hx=None, fx=lambda x, dt: moved(EXTENDED, x), points=points
    )
    reference.x, reference.P = start(8)
    wanted = []
    for z in measurements(GROUPS):
        reference.Q = EXTENDED.slopes(named(EXTENDED, reference.x), 0.1, 0.0, Geometry(), np)[1]
        reference.predict()
        for group, numbers in zip(GROUPS, z, strict=True):
            reference.sigmas_f = points.sigma_points(reference.x, reference.P)
            reference.update(
                numbers, R=np.diag(group.variance), hx=lambda x, g=group: seen(EXTENDED, g, x)
            )
        wanted.append(Gaussian(reference.x.copy(), reference.P.copy()))
    close(ours(EXTENDED, GROUPS, law), wanted)


# Stone Soup ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def soup() -> Any:
    """Predictors, updaters and models of Stone Soup over our motion and measurements."""
    pytest.importorskip(
        "stonesoup", reason="Stone Soup is not installed: pip install '.[stonesoup]'"
    )
    import stone_soup_models

    return stone_soup_models


@pytest.mark.parametrize(
    ("kind", "process", "groups"),
    [
        ("linear", LINEAR, (WHEELS, COMPASS, FIXES)),
        ("extended", EXTENDED, GROUPS),
        ("unscented", LINEAR, (WHEELS, COMPASS, FIXES)),
    ],
)
def test_the_filters_are_stone_soups(
    kind: str, process: Process, groups: tuple[Group, ...], soup: Any
) -> None:
    """The unscented filter on a linear model, since sigma points are drawn anew differently."""
    law = NARROW if kind == "unscented" else None
    zs = list(measurements(groups))
    close(
        ours(process, groups, law), soup.run(kind, process, groups, zs, start(len(process.names)))
    )
