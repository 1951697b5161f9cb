"""Soils by name and by number: what stands in the sources, and one sentence for what cannot be."""

import math

import pytest

from sysid.errors import ModelError
from sysid.vehicle.ground.presets import PRESETS, soil_of, soil_preset
from sysid.vehicle.soil import Shear, Soil


def test_presets_are_the_published_rows() -> None:
    sand = soil_preset("Dry Sand")  # Wong, table 2.3: kPa, kN and degrees
    assert (sand.n, sand.k_c, sand.k_phi) == (1.1, 990.0, 1528430.0)
    assert (sand.cohesion, math.degrees(sand.friction_angle)) == pytest.approx((1040.0, 28.0))
    named = {p.name for p in PRESETS}
    assert named >= {"dry-sand", "loam", "sandy-loam", "clay", "snow", "concrete", "carpet"}
    for preset in PRESETS:
        assert preset.soil.source
        assert dict(preset.soil.std)["friction_angle"] > 0.0
        assert ("assumed" in preset.soil.source) == ("measure" in preset.soil.source)


def test_firm_ground_does_not_give_way() -> None:
    concrete = soil_preset("concrete")
    assert math.isinf(concrete.k_phi)
    assert concrete.friction == pytest.approx(0.75)


def test_numbers_replace_those_of_the_preset_and_their_standard_deviation() -> None:
    soil = soil_of({"preset": "dry-sand", "cohesion": 0, "friction_angle_deg": 30.0})
    assert (soil.cohesion, soil.friction) == (0.0, pytest.approx(math.tan(math.pi / 6)))
    assert soil.k_phi == soil_preset("dry-sand").k_phi
    assert set(dict(soil.std)) == {"shear_modulus", "rolling", "lateral"}
    assert soil.source.startswith("cohesion, friction_angle given; the rest: Wong")


def test_a_soil_from_numbers_alone() -> None:
    soil = soil_of(
        {
            "cohesion": 500,
            "friction": 0.75,
            "shear_modulus": 0.02,
            "shear": "residual",
            "residual": 0.6,
            "std": {"cohesion": 50, "friction": 0.1},
        }
    )
    assert soil.shear is Shear.RESIDUAL
    assert soil.friction == pytest.approx(0.75)
    # tan φ = 3/4 has cos²φ = 16/25, and dφ = dμ cos²φ
    assert dict(soil.std) == pytest.approx({"cohesion": 50.0, "friction_angle": 0.064})
    assert soil_of(soil) is soil


@pytest.mark.parametrize(
    ("written", "sentence"),
    [
        ("dry-sant", "did you mean dry-sand?"),
        ("", "there are dry-sand"),
        (7, "preset's name or numbers by name, not 7"),
        ({"preset": 3}, "the soil's preset is 3"),
        ({"preset": "loam", "cohesian": 3}, "did you mean cohesion?"),
        ({"cohesion": 3.0}, "lacks friction_angle and shear_modulus"),
        ({"preset": "loam", "cohesion": "much"}, "cohesion is 'much': give a number"),
        ({"preset": "loam", "cohesion": True}, "cohesion is True: give a number"),
        ({"preset": "loam", "cohesion": math.nan}, "cohesion is nan: give at least 0"),
        ({"preset": "loam", "friction_angle": 28}, "degrees as friction_angle_deg"),
        ({"preset": "loam", "friction_angle_deg": 95}, "below π/2"),
        ({"preset": "loam", "friction": -0.1}, "friction is -0.1"),
        ({"preset": "loam", "friction": 0.5, "friction_angle": 0.3}, "give the angle once"),
        ({"preset": "loam", "shear": "soft"}, "give one of janosi, hump, residual"),
        ({"preset": "loam", "shear_modulus": 0}, "shear_modulus is 0.0: give more than 0"),
        ({"preset": "loam", "residual": 1.5}, "residual is 1.5: give a share"),
        ({"preset": "loam", "std": 3}, "give standard deviations by name"),
        ({"preset": "loam", "std": {"shear": 3}}, "no number 'shear' to give a std"),
        ({"preset": "loam", "std": {"cohesion": -1}}, "std of cohesion is -1"),
    ],
)
def test_what_is_no_soil_is_refused_in_a_sentence(written: object, sentence: str) -> None:
    with pytest.raises(ModelError) as refused:
        soil_of(written)  # type: ignore[arg-type]
    assert sentence in str(refused.value)


def test_numbers_of_many_runs_are_checked_too() -> None:
    import numpy as np

    with pytest.raises(ModelError, match="cohesion"):
        Soil(cohesion=np.array([1.0, -1.0]), friction_angle=0.5, shear_modulus=0.02)
