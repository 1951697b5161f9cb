"""Numbers of a plant in C: what they are called, that they act, and where they must stay."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler, worst_error
from hand_made import hand_made
from plant_models import bench_model, robot_model

from sysid.data.record import Array
from sysid.export.c.names import RESERVED, distinct, identifier
from sysid.export.c.step import c_sources, tunable_parameters
from sysid.plant.selftest import make_selftest
from sysid.structures.linear.families import ARX


def test_every_number_of_a_plant_is_listed_with_name_unit_value_and_words() -> None:
    model = robot_model("oe")
    result = {t.name: t for t in tunable_parameters(model)}
    by_name = {p.name: v for p, v in zip(model.parameters, model.theta, strict=True)}
    b1 = result["b1_omega_l_pwm_l"]
    assert (b1.value, b1.unit) == (by_name["b1[omega_l,pwm_l]"], "(rad/s)/µs")
    assert b1.words == "b1[omega_l,pwm_l]"
    assert len(result) == len(model.theta)  # no operating point: it is zero


def test_what_a_step_does_not_read_is_no_parameter() -> None:
    names = [t.name for t in tunable_parameters(bench_model("armax"))]
    assert {"a1", "b1", "u0_u", "y0_y"} <= set(names)
    assert not [n for n in names if n.startswith("c")]  # of the noise


@needs_compiler
def test_parameters_and_operating_point_act_from_the_next_step_on(tmp_path: Path) -> None:
    model = bench_model("oe")
    offset = replace(
        model.detrend, u_offset=model.detrend.u_offset + 0.5, y_offset=model.detrend.y_offset - 2.0
    )
    other = replace(model, theta=model.theta * 1.01, detrend=offset)
    u = model.detrend.u_offset + np.random.default_rng(3).normal(size=(60, 1))
    plants, rows = (model.plant(), other.plant()), []
    state = plants[0].initial_state()
    for k, now in enumerate(u):
        state, y = plants[k >= 25].step(state, now)
        rows.append(y)
    program = build(tmp_path, model, "driver")["driver"]
    outputs = driven(program, u, [t.value for t in tunable_parameters(other)], at=25)
    np.testing.assert_allclose(outputs, rows, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("dead-zone.plus[omega_l]", "dead_zone_plus_omega_l"),
        ("b1[ω,Spannung µV]", "b1_Spannung_V"),
        ("Länge", "Lange"),
        ("double", "double_"),
        ("B1", "B1_"),
        ("1st", "v_1st"),
        ("ω", "value"),
    ],
)
def test_any_text_becomes_a_name_of_c(text: str, name: str) -> None:
    assert identifier(text) == name
    assert identifier(text) not in RESERVED


def test_texts_that_would_be_called_alike_are_kept_apart() -> None:
    assert distinct(["a-b", "a_b", "a b", "a_b_2"]) == ["a_b", "a_b_2", "a_b_3", "a_b_2_2"]


class _Deciding(ARX):
    """Somebody's structure that decides by one number in Python and computes with the other."""

    name: ClassVar[str] = "deciding"

    def n_states(self, theta: Array) -> int:
        return 1

    def step(self, theta: Array) -> Callable[[Any, Any], tuple[Any, Any]]:
        pole, gain = theta[0], theta[1]
        memory = pole > 0.0 and float(pole)

        def advance(x: Any, u: Any) -> tuple[Any, Any]:
            return memory * x + gain * u, x

        return advance


def test_a_number_by_which_a_structure_decides_stays_as_it_is() -> None:
    structure = _Deciding.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    model = hand_made(structure, np.array([0.5, 0.25]))
    assert [t.name for t in tunable_parameters(model)] == ["b1"]
    source = c_sources(model, make_selftest(bench_model("arx")))["plant.c"]
    assert "0.5 * " in source


def test_a_long_row_of_numbers_is_an_array() -> None:
    structure = ARX.from_orders({"na": 30, "nb": 2, "nk": 1}, 1, 1)
    theta = np.concatenate([0.01 * np.arange(1.0, 31.0), [1.0, 2.0]])
    result = {t.name: t.value for t in tunable_parameters(hand_made(structure, theta))}
    assert result["a[29]"] == theta[29]
    assert result["b2"] == 2.0


@needs_compiler
def test_coupled_outputs_of_high_order_have_their_coefficients_as_parameters(
    tmp_path: Path,
) -> None:
    structure = ARX.from_orders({"na": [[8, 8], [8, 8]], "nb": 8, "nk": 1}, 2, 2)
    theta = 0.02 * np.random.default_rng(0).normal(size=64)
    model = hand_made(structure, theta)
    lines = c_sources(model, make_selftest(model))["plant.c"].count("\n")
    assert lines < 1000
    names = [t.name for t in tunable_parameters(model)]
    assert {n.partition("[")[0] for n in names} == {"coefficients"}
    program = build(tmp_path, model, "selftest")["selftest"]
    assert worst_error(program) < 1e-12
