"""What a soil does to a vehicle, with its uncertainty, against hand calculation and sampling."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sysid.errors import ModelError
from sysid.vehicle.ground.assessment import Quantity, assess
from sysid.vehicle.ground.drawbar import Traction
from sysid.vehicle.ground.presets import soil_preset
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

ROBOT = TrackedVehicle()


def named(traction: Traction, slope: float | None = None) -> dict[str, Quantity]:
    return {q.name: q for q in assess(traction, slope, radii=()).quantities}


def test_the_uncertainty_of_coulombs_thrust_by_hand() -> None:
    """F = A c + W tan φ on a stiff soil: s² = (A s_c)² + (W s_φ / cos² φ)²."""
    soil = Soil(1e3, 0.5, 1e-9, std=(("cohesion", 100.0), ("friction_angle", 0.01)))
    numbers = named(Traction(soil, ROBOT))["thrust_max"]
    area = 2.0 * 0.14 * 0.04
    shares = area * 100.0, ROBOT.weight * 0.01 / math.cos(0.5) ** 2
    assert numbers.value == pytest.approx(area * 1e3 + ROBOT.weight * math.tan(0.5), rel=1e-6)
    assert numbers.std_error == pytest.approx(math.hypot(*shares), rel=1e-4)  # tan is not straight
    assert numbers.driven_by == "cohesion"


def test_the_uncertainty_of_a_preset_is_that_of_soils_drawn_from_it() -> None:
    sand = soil_preset("dry-sand")
    numbers = named(Traction(sand, ROBOT), 0.2)
    rng = np.random.default_rng(3)
    drawn = {n: getattr(sand, n) + s * rng.standard_normal(2000) for n, s in sand.std}
    drawn["shear_modulus"] = np.maximum(drawn["shear_modulus"], 1e-3)
    many = Traction(replace(sand, **{n: np.abs(v) for n, v in drawn.items()}), ROBOT, slope=0.2)
    slip = many.slip_for(ROBOT.weight * math.sin(0.2))
    # 2000 draws leave 1.6 %; K enters almost in proportion, so the first order is close
    assert numbers["slope_slip"].std_error == pytest.approx(slip.std(), rel=0.1)
    assert numbers["slope_slip"].driven_by == "shear_modulus"


def test_what_has_no_uncertainty_says_why() -> None:
    sand = named(Traction(soil_preset("dry-sand"), ROBOT))
    assert sand["sinkage"].std_error is None
    assert "n, k_c and k_phi have no standard deviation" in sand["sinkage"].reason
    firm = named(Traction(soil_preset("concrete"), ROBOT))["sinkage"]
    assert (firm.value, firm.std_error, firm.reason) == (0.0, 0.0, "firm ground does not give way")
    bare = named(Traction(Soil(0.0, 0.5, 0.01), ROBOT))["thrust_max"]
    assert bare.std_error is None
    assert bare.reason == "the soil's numbers have no standard deviation"


def test_what_the_soil_cannot_give_has_no_value() -> None:
    ice = named(Traction(soil_preset("ice"), ROBOT), 0.3)["slope_slip"]
    assert (ice.value, ice.reason) == (None, "the soil cannot give that pull")
    nearly = replace(soil_preset("ice"), friction_angle=0.2, std=(("friction_angle", 0.1),))
    edge = named(Traction(nearly, ROBOT), 0.15)["slope_slip"]
    assert edge.value is not None
    assert edge.std_error is None
    assert edge.reason.startswith("one standard deviation of friction_angle away")


def test_notes_warn_of_what_the_numbers_do_not_hold() -> None:
    clay = assess(Traction(soil_preset("clay"), ROBOT), radii=()).notes
    assert clay[0].startswith("Cohesion alone holds 46.4 N, 3 times the weight")
    snow = assess(Traction(soil_preset("snow"), ROBOT), radii=()).notes
    assert snow[0].startswith("It sinks 34.4 mm, more than the sprocket's radius of 21.5 mm")
    assert assess(Traction(soil_preset("concrete"), ROBOT), radii=()).notes == ()


@pytest.mark.parametrize(
    ("slope", "slips", "sentence"),
    [(1.6, (0.1,), "the slope is 91.7°"), (None, (0.0,), "the slip is 0"), (None, (1.2,), "1.2")],
)
def test_impossible_questions_are_refused(
    slope: float | None, slips: tuple[float, ...], sentence: str
) -> None:
    with pytest.raises(ModelError, match=sentence):
        assess(Traction(soil_preset("loam"), ROBOT), slope, slips)
