"""A motor whose position is read: seen by itself, and judged from a start that it never forgets."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.data.checks.integral import is_position
from sysid.data.record import Array, Channel, Record
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.motion import LONGEST_HEAD, initial_state_window

GAIN, TAU, DRY, LOAD = 0.17, 0.45, 0.5, -0.09
DT, N = 0.02, 1500


def axis(seed: int = 1, noise: float = 2e-4) -> tuple[Array, Array, Array]:
    """Command [V], position [m] and speed of an axis that goes to and fro, in fine steps."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-4.0, 4.0, N // 25), 25)
    u += 2.0 * np.sin(2 * np.pi * np.arange(N) * DT / 3.0)
    x, v, y, speed = 0.0, 0.0, np.zeros(N), np.zeros(N)
    fine = 20
    for k in range(N):
        y[k], speed[k] = x, v
        for _ in range(fine):
            net = GAIN * (u[k] - LOAD) - v
            dry = GAIN * DRY
            if v == 0.0 and abs(net) <= dry:
                continue
            after = v + DT / fine / TAU * (net - dry * np.sign(v if v != 0.0 else net))
            v = 0.0 if after * v < 0.0 else after
            x += DT / fine * v
    return u, y + rng.normal(0.0, noise, N), speed + rng.normal(0.0, 10 * noise, N)


@pytest.mark.parametrize(
    ("unit", "which", "position"),
    [
        ("", "y", True),
        ("", "speed", False),
        ("m", "y", True),
        ("rad", "y", True),
        ("m/s", "speed", False),
        ("V", "speed", False),
    ],
)
def test_a_position_is_told_by_its_unit_or_by_its_readings(
    unit: str, which: str, position: bool
) -> None:
    u, y, speed = axis()
    read = y if which == "y" else speed
    record = Record(u=u[:, None], y=read[:, None], dt=DT, outputs=(Channel("y", unit),))
    assert is_position([record], 0) is position
    motor = MotorPhysics(1, 1, output="auto").for_record(record)
    assert motor.output == ("position" if position else "speed")


def test_a_position_never_forgets_what_its_first_speed_was_wrong_by() -> None:
    """A head of a few samples leaves a slope that stays in the run for good."""
    for output, least in (("position", LONGEST_HEAD), ("speed", 2.0 * TAU / 1e-3)):
        motor = DCMotor(MotorPhysics.from_options({"output": output}, 1, 1), Sampling(1e-3))
        theta = motor.physics.pack({"gain": GAIN, "time_constant": TAU})
        assert initial_state_window(motor, theta) == pytest.approx(least, abs=1)


@pytest.mark.slow
def test_a_fit_of_a_position_is_as_good_in_its_figures_as_in_its_search(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    u, y, _ = axis()
    log = write_log(tmp_path / "axis.csv", ("u", "y"), (u, y), DT)
    document = run(
        capsys, "fit", log, "--structure", "dc-motor", "--option", "friction=coulomb", "--json"
    ).document
    assert document["properties"]["position"]
    units = {p["name"]: p["unit"] for p in document["parameters"]}
    assert units["gain"] == "(y/s)/u"
    theta = {p["name"]: p["value"] for p in document["parameters"]}
    # 30 s of a position read to 0.2 mm tell these to about a per cent
    assert theta["gain"] == pytest.approx(GAIN, rel=0.03)
    assert theta["time_constant"] == pytest.approx(TAU, rel=0.03)
    assert theta["coulomb"] == pytest.approx(DRY, rel=0.05)
    # twice the noise: the held command inside a sample and the stop instants are approximated
    assert document["estimation"]["rmse"]["y"] < 4e-4
