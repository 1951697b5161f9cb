"""Effects of another package are searched for, named and shown by the diagnosis as our own are."""

import textwrap
from pathlib import Path

import numpy as np
import pytest
from command_line import write_log
from example_package import Installed

from sysid.data.record import PWM_FULL_SCALE
from sysid.effects.ground import Ground
from sysid.robot.calibration.windows import path_of
from sysid.vehicle.kinematics import Geometry

GAIN, DT, NOISE = 20.0, 0.05, 0.1
TAU, FINE = np.array([0.25, 0.3]), 20
DRAG, LOSS = 0.06, 0.012
NAMES = ("pwm_l", "pwm_r", "omega_l", "omega_r")


def driven(samples: int, seed: int, drag: float = 0.0, least: float = -1.0) -> list[np.ndarray]:
    """PWM and speeds of two tracks, τ ω̇ = K d − ω − k Δ|Δ|, Δ = ω − ω_other, by small steps."""
    rng = np.random.default_rng(seed)
    levels, holds = rng.uniform(least, 1.0, (2, samples)), rng.integers(6, 30, (2, samples))
    d = np.array([np.repeat(v, h)[:samples] for v, h in zip(levels, holds, strict=True)]).T
    omega = np.zeros((samples, 2))
    for k in range(samples - 1):
        w = omega[k]
        for _ in range(FINE):
            apart = w - w[::-1]
            w = w + DT / FINE / TAU * (GAIN * d[k] - w - drag * apart * np.abs(apart))
        omega[k + 1] = w
    return [PWM_FULL_SCALE * d, omega]


@pytest.mark.slow
def test_an_effect_that_couples_tracks_is_named(installed: Installed, tmp_path: Path) -> None:
    for name, seed in (("est.csv", 1), ("val.csv", 2)):
        pwm, omega = driven(900, seed, DRAG)
        omega = omega + NOISE * np.random.default_rng(90 + seed).normal(size=omega.shape)
        write_log(tmp_path / name, NAMES, [*pwm.T, *omega.T], DT)
    found = installed.document("diagnose", "est.csv", "--val", "val.csv", folder=tmp_path)
    (named,) = found["effects"]
    assert named["id"] == "belt-drag"
    assert found["gap"]["closed_percent"] > 90.0
    for number in named["parameters"]:
        # four standard errors, and 5 %: the effect acts at the speed that a sample begins with
        assert abs(number["value"] - DRAG) < 4.0 * number["std_error"] + 0.05 * DRAG


@pytest.mark.slow
def test_an_effect_between_tracks_and_ground_is_named(installed: Installed, tmp_path: Path) -> None:
    pwm, omega = driven(900, 3, least=-0.2)
    rng = np.random.default_rng(4)
    pose = path_of(omega * (1.0 - LOSS * np.abs(omega)), DT, Ground(), Geometry())
    pose = pose + np.array([0.001, 0.001, 0.002]) * rng.normal(size=pose.shape)
    omega = omega + NOISE * rng.normal(size=omega.shape)
    columns = [*pwm.T, *omega.T, *pose.T]
    write_log(tmp_path / "log.csv", (*NAMES, "x", "y", "psi"), columns, DT)
    found = installed.document("diagnose", "log.csv", folder=tmp_path)
    (named,) = found["effects"]
    assert named["id"] == "speed-slip"
    assert "slip more the faster they run: at 10 rad/s they lose 12" in named["sentence"]
    (number,) = named["parameters"]
    assert number["unit"] == "1/rad/s"
    assert abs(number["value"] - LOSS) < 4.0 * number["std_error"] + 0.01 * LOSS


WRONG = """
    from dataclasses import replace
    from sysid_example.belt_drag import BELT_DRAG
    SILENT = replace(BELT_DRAG, id="silent-drag", couples=False)
"""


def test_a_coupling_that_does_not_say_so_is_refused(installed: Installed, tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(textwrap.dedent(WRONG))
    info = tmp_path / "wrong-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: wrong\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[sysid.effects]\nsilent-drag = wrong:SILENT\n")
    code = "from sysid.effects.catalogue import catalogue; catalogue()"
    done = installed.python("-c", code, folder=tmp_path)
    assert (
        "the effect 'silent-drag' of the package wrong ties the tracks to each other but does not "
        "say so: give it couples=True; mend or uninstall that package" in done.stderr
    )
