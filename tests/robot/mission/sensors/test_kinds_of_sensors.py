"""What each kind of sensor measures, and that its figures are those of its errors."""

import math
import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sensor_cases import SCENE, measurements, way

from sysid.data.record import Array
from sysid.robot.mission.contracts import Body, Pose, SensorInputs
from sysid.robot.mission.noise import generator
from sysid.robot.mission.registry import kinds, law_class
from sysid.robot.mission.sensors.imperfect import ImperfectSensor
from sysid.robot.mission.sensors.magnetometer import Magnetometer
from sysid.robot.mission.sensors.visual_odometry import motion_between
from sysid.runners import floats

NO_ERRORS: dict[str, Any] = {
    "noise": 0.0, "bias_std": 0.0, "bias_walk": 0.0, "saturation": None, "resolution": 0.0,
    "latency": 0.0,
}  # fmt: skip


def sensor(kind: str, **keys: Any) -> ImperfectSensor:
    """A sensor without errors but for those of ``keys``."""
    result = law_class("sensors", kind).model_validate(NO_ERRORS | keys)
    assert isinstance(result, ImperfectSensor)
    return result


def poses(collected: dict[str, Array], *names: str) -> list[Pose]:
    return [Pose(*values) for values in zip(*(collected[n].tolist() for n in names), strict=True)]


# Without errors -----------------------------------------------------------------------------------


def test_the_acceleration_adds_up_to_the_speed_at_any_rate() -> None:
    for rate in (3.0, 10.0):
        result = measurements(sensor("accelerometer", rate=rate), 200)
        read = ~np.isnan(result["acc_x"])
        steps = np.diff(result["t"][read], prepend=0.0)
        added = np.cumsum(result["acc_x"][read] * steps)
        np.testing.assert_allclose(added, result["v"][read], rtol=0, atol=1e-12)
        lateral = (result["v"] * result["yaw_rate"])[read]
        np.testing.assert_array_equal(result["acc_y"][read], lateral)


def test_the_heading_comes_from_the_field_where_no_iron_is() -> None:
    result = measurements(sensor("magnetometer", field=18.0, north=0.4), 200)
    psi = 0.4 + np.arctan2(-result["mag_y"], result["mag_x"])
    np.testing.assert_allclose(np.exp(1j * psi), np.exp(1j * result["psi"]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(result["mag_x"], result["mag_y"]), 18.0, rtol=1e-12)


def test_iron_in_the_world_bends_the_field_as_a_dipole() -> None:
    iron = Magnetometer(iron=((2.0, 1.0, 3.0),), north=0.0, field=20.0)

    def added(dx: float, dy: float) -> tuple[float, float]:
        bx, by = iron.world_field(Pose(2.0 + dx, 1.0 + dy, 0.0), floats)
        return bx - 20.0, by

    # s beside it and against the earth's field, twice that before it; the size of iron, 0.1 m in a
    # metre, takes 3/2 · 1 % and 5/2 · 1 %.
    assert added(0.0, 1.0) == pytest.approx((-3.0, 0.0), rel=0.02, abs=1e-12)
    assert added(1.0, 0.0) == pytest.approx((6.0, 0.0), rel=0.05, abs=1e-12)
    near, far = (math.hypot(*added(0.6 * r, 0.8 * r)) for r in (2.0, 4.0))
    assert near / far == pytest.approx(8.0, rel=0.01)
    assert math.hypot(*added(0.0, 0.0)) == pytest.approx(3.0 / 0.1**3)


def test_iron_on_the_robot_turns_with_it() -> None:
    result = measurements(sensor("magnetometer", bias=[4.0, -2.0]), 100)
    plain = measurements(sensor("magnetometer"), 100)
    np.testing.assert_allclose(result["mag_x"] - plain["mag_x"], 4.0, rtol=1e-12)
    np.testing.assert_allclose(result["mag_y"] - plain["mag_y"], -2.0, rtol=1e-12)


@pytest.mark.parametrize("keys", [{}, {"rate": 3.0}, {"dropout": 0.5}])
def test_visual_odometry_and_fixes_without_errors_are_the_pose(keys: dict[str, float]) -> None:
    for kind, names in (
        ("visual_odometry", ("vo_x", "vo_y", "vo_psi")),
        ("position_fixes", ("fix_x", "fix_y")),
    ):
        result = measurements(sensor(kind, **keys), 300)
        read = ~np.isnan(result[names[0]])
        assert 0 < read.sum() <= 300
        for name in names:
            error = result[name][read] - result[name.split("_")[1]][read]
            # A pose of visual odometry is the sum of up to 300 motions, each rounded.
            np.testing.assert_allclose(error, 0.0, rtol=0, atol=1e-12)


# With errors --------------------------------------------------------------------------------------


def errors_of(collected: dict[str, Array], kind: str) -> dict[str, Array]:
    """What each measurement errs by, by name."""
    t, v, yaw = collected["t"], collected["v"], collected["yaw_rate"]
    if kind == "visual_odometry":
        truth, seen = poses(collected, "x", "y", "psi"), poses(collected, "vo_x", "vo_y", "vo_psi")
        pairs = [(truth[k - 1 : k + 1], seen[k - 1 : k + 1]) for k in range(1, t.size)]
        moves = [
            np.subtract(motion_between(*s, floats), motion_between(*p, floats)) for p, s in pairs
        ]
        return dict(zip(("vo_x", "vo_y", "vo_psi"), np.transpose(moves), strict=True))
    exact = measurements(sensor(kind), t.size)
    if kind == "encoders":
        mean = np.array([[left, right] for *_, left, right in way(t.size)])
        mean = 0.5 * (mean[1:] + mean[:-1])
        exact = {"omega_l": np.r_[0.0, mean[:, 0]], "omega_r": np.r_[0.0, mean[:, 1]]}
    assert yaw.shape == v.shape
    return {
        name: (collected[name] - column)[1:] for name, column in exact.items() if name in collected
    }


@pytest.mark.parametrize("kind", kinds("sensors"))
def test_the_variance_that_filters_are_told_is_that_of_the_readings(kind: str) -> None:
    cls = law_class("sensors", kind)
    plain = cls.model_validate({"bias_std": 0.0, "bias_walk": 0.0, "latency": 0.0})
    assert isinstance(plain, ImperfectSensor)
    result = measurements(plain, 3000)
    errors = errors_of(result, kind)
    for name, figures in plain.figures(0.1).items():
        got = np.mean(errors[name] ** 2)
        # Five standard deviations of a variance of 3000 numbers; rounding of counts is correlated
        # between neighbours, which makes half of them count.
        assert got / figures.variance == pytest.approx(1.0, abs=5 * math.sqrt(2 / 1500)), name


@pytest.mark.parametrize("kind", kinds("sensors"))
def test_a_batch_reads_what_single_runs_read(kind: str) -> None:
    """All errors at once, compiled and mapped over runs, against plain numbers."""
    jax.config.update("jax_enable_x64", True)
    keys = {"rate": 7.0, "bias_std": 0.1, "bias_walk": 0.1, "dropout": 0.2, "latency": 0.25}
    several: Any = law_class("sensors", kind).model_validate(keys | {"noise": 0.02})
    samples, truth = 60, way(60)
    draws = np.stack(
        [generator(k, kind).standard_normal((samples, several.draws)) for k in range(3)]
    )
    times = np.array([(t, 0.1 if t else 0.0) for t, *_ in truth])
    numbers = np.array([(*b.pose, b.speed, b.yaw_rate, left, right) for _, b, left, right in truth])

    def step(state: Any, given: Any) -> Any:
        (t, dt), n, z = given
        body = Body(Pose(n[0], n[1], n[2]), n[3], n[4])
        return several.step(state, SensorInputs(t, body, n[5], n[6], z, SCENE), dt, jnp)

    def one(z: Any) -> Any:
        first = jax.tree.map(jnp.float64, several.start(SCENE, jnp))
        return jax.lax.scan(step, first, (times, numbers, z))[1]

    batch = np.stack(jax.jit(jax.vmap(one))(draws), axis=-1)
    single = [measurements(several, samples, seed=seed, name=kind) for seed in range(3)]
    wanted = np.stack([[run[name] for name in several.names] for run in single]).transpose(0, 2, 1)
    assert np.isnan(wanted).any()
    np.testing.assert_allclose(batch, wanted, rtol=0, atol=1e-12 * np.nanmax(np.abs(wanted)))


# Defaults -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", kinds("sensors"))
def test_the_page_has_the_defaults(kind: str) -> None:
    page = (Path(__file__).parents[4] / "docs" / "sensors.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| `{kind}` \|[^|]*\|(.*)\|$", page, re.MULTILINE)
    default = law_class("sensors", kind)()
    names = ("rate", "noise", "bias_std", "bias_walk", "saturation", "resolution")
    for name, cell in zip(names, row.split("|"), strict=True):
        value = getattr(default, name)
        if cell.strip() == "none":
            assert value is None
            continue
        written = [float(number) for number in cell.split(",")]
        # The page rounds to three digits.
        assert written == pytest.approx(list(np.atleast_1d(value)), rel=5e-3), name
