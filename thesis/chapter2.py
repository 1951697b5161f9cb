"""Chapter 2: shear laws, kinematic constraints, and what is misprinted in the equations."""

import numpy as np
import sysid_datasets

from sysid.data.record import Array
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.vehicle.ground.presets import soil_preset
from sysid.vehicle.ground.resistance import turning_moment
from sysid.vehicle.kinematics import Geometry, body_velocity
from sysid.vehicle.shear import mobilised_share, shear_stress, thrust, uniform_thrust
from sysid.vehicle.soil import Shear, Soil
from sysid.vehicle.tracked import TrackedVehicle
from sysid.vehicle.wheels.description import load_vehicle
from thesis.entries import MISPRINT, Row, Sheet, compared, line, number, verdict

RESIDUAL = 0.5
"""K_r of the curves of (2.30): the thesis prints none."""

SOILS = ("dry-sand", "loam", "clay", "snow")

LAWS = (
    ("(2.28) loose", Shear.JANOSI),
    ("(2.29) muskeg", Shear.HUMP),
    ("(2.30) compact", Shear.RESIDUAL),
)


def _soil(law: Shear, residual: float = RESIDUAL) -> Soil:
    """A soil of which only the law matters: displacement is in units of its modulus."""
    return Soil(0.0, 0.5, 1.0, law, residual if law is Shear.RESIDUAL else 1.0)


def _as_printed(t: Array, residual: float) -> Array:
    """(2.30) with its brackets read as they are printed; t = j/K_max."""
    excess = (1.0 / residual) * (1.0 - np.exp(-1.0)) - 1.0
    return residual * (1.0 + excess * np.exp(1.0 - t)) * (1.0 - np.exp(-t))


def shear() -> Sheet:
    """2.7 and the equations behind it."""
    t = np.linspace(0.0, 5.0, 121)
    at_one = np.array([1.0])
    vehicle = TrackedVehicle()
    load = 0.5 * vehicle.weight
    pressure = load / (vehicle.contact_length * vehicle.track_width)
    peaks = [mobilised_share(_soil(law), t) for _, law in LAWS]
    rows = (
        Row("2.7", "loose sand, clay, dry snow (2.28)", "rises to a constant value",
            f"{number(100 * peaks[0][-1], '.1f')} % of τ_max at 5 K",
            verdict((np.diff(peaks[0]) > 0).all()), "scales not printed"),
        Row("2.7", "muskeg (2.29)", "rises to a hump, then falls",
            f"hump of {number(peaks[1].max(), '.2f')} τ_max at j = "
            f"{number(float(t[np.argmax(peaks[1])]), '.1f')} K_max",
            verdict(peaks[1][-1] < 0.5 * peaks[1].max()), "scales not printed"),
        Row("2.7", "compact sand, loam (2.30)", "a hump, then a constant residual value",
            f"{number(peaks[2][-1], '.2f')} τ_max at 5 K_max towards K_r = {RESIDUAL:g}",
            verdict(RESIDUAL < peaks[2][-1] < peaks[2].max()), "scales not printed"),
        Row("(2.30)", "τ/τ_max at j = K_max with K_r 0.5, brackets as printed",
            number(_as_printed(at_one, RESIDUAL)[0], ".2f"),
            number(mobilised_share(_soil(Shear.RESIDUAL), at_one)[0], ".2f"), MISPRINT,
            "unbalanced brackets; with K_max where τ is largest it must be 1"),
        _closed_form(vehicle, load),
        Row("(2.36)", "moment against turning at x_ICR = 0 over μ_l W L/4 (Wong)", "2.0",
            number(_turning(vehicle), ".1f"), MISPRINT, "twice the moment of the lateral friction"),
        Row("(2.34), (2.36)", "sign of the resistances in (2.37)", "minus a negative quantity",
            "minus a magnitude", MISPRINT, "as printed resistance would propel"),
    )  # fmt: skip
    j = np.linspace(0.0, 0.1, 121)
    laws = tuple(line(name, t, share) for (name, _), share in zip(LAWS, peaks, strict=True))
    printed = Curve("as printed", t, _as_printed(t, RESIDUAL), colour=-1)
    soils = tuple(
        line(name.replace("-", " "), 1e3 * j, shear_stress(soil_preset(name), pressure, j) / 1e3)
        for name in SOILS
    )
    panels = (
        panel("2.7: the three laws", "j/K", "τ/τ_max", laws),
        panel("(2.30) as printed", "j/K_max", "τ/τ_max", (laws[2], printed)),
        panel("2.7 with soils of ours", "j [mm]", "τ [kPa]", soils),
    )
    words = f"right: under this robot's pressure, {pressure / 1e3:.1f} kPa"
    return Sheet(rows, "chapter2/shear.svg", PanelPicture("Shear stress", words, panels))


def _closed_form(vehicle: TrackedVehicle, load: float) -> Row:
    """(2.33) against the integral (2.31) it comes from."""
    soil, lengths = soil_preset("dry-sand"), (vehicle.contact_length, vehicle.track_width)
    slips = np.linspace(0.02, 1.0, 50)
    exact = uniform_thrust(soil, load, slips, *lengths)
    summed = thrust(soil, load, slips, *lengths)
    worst = float(np.abs(summed / exact - 1.0).max())
    return Row("(2.33)", "closed form against the integral (2.31), slip 0.02 to 1", "equal",
               f"apart by {'less than 1e−12' if worst < 1e-12 else number(worst, '.0e')}",
               "none", "")  # fmt: skip


def _turning(vehicle: TrackedVehicle) -> float:
    """Ours over Wong's."""
    soil, weight = soil_preset("concrete"), vehicle.weight
    ours = float(turning_moment(soil, weight, 0.0, 1.0, vehicle.contact_length))
    return ours / (soil.lateral * weight * vehicle.contact_length / 4.0)


def constraints() -> Sheet:
    """2.4: what the printed constraint rows give, and ours of the robot as two wheels."""
    robot = load_vehicle(sysid_datasets.folder() / "vehicles" / "devastator.yaml")
    geometry = Geometry()
    alpha = (np.pi / 2, -np.pi / 2)
    rolling = np.array([_rolling(a, 0.0, 0.5 * geometry.B) for a in alpha])
    sliding = np.array([_sliding(a, 0.0, 0.5 * geometry.B) for a in alpha])
    speeds = np.array([10.0, 12.0])
    rows_of_all = np.vstack([rolling, sliding])
    body = np.linalg.lstsq(rows_of_all, np.append(geometry.r * speeds, [0.0, 0.0]), None)[0]
    v, yaw_rate = body_velocity(10.0, 12.0, geometry)
    ours = robot.constraints()
    rows = (
        compared("(2.22)", "rank of C₁", 1, ours.rank, ".0f"),
        compared("(2.21)", "degree of mobility", 2, robot.mobility, ".0f"),
        Row("(2.23)", "degrees of steerability and of manoeuvrability", "–",
            f"{robot.steerability} and {robot.manoeuvrability}", "–", "printed as a definition"),
        Row("(2.15), (2.16)", "rows with β = 0, α = ±π/2 give (2.13)", "yes",
            f"V_x, ψ̇ = {number(body[0], '.4f')}, {number(body[2], '.4f')} at 10 and 12 rad/s",
            verdict(np.allclose(body, [v, 0.0, yaw_rate])), "r/2(ω_L + ω_R), r/B(ω_R − ω_L)"),
        Row("(2.15), (2.16)", "factor of ψ̇ of a wheel turned by β",
            "−l sin(α + β), l cos(α + β)", "−l sin(α − β), −l cos(α − β)", MISPRINT,
            "of a rigid body with β from the x axis; the same for the tracks"),
        Row("(2.10)", "last component of the local velocity", "ψ", "ψ̇", MISPRINT,
            "the dot is missing"),
    )  # fmt: skip
    return Sheet(rows)


def _rolling(alpha: float, beta: float, arm: float) -> list[float]:
    """Row of (2.15) as printed."""
    return [np.cos(beta), np.sin(beta), -arm * np.sin(alpha + beta)]


def _sliding(alpha: float, beta: float, arm: float) -> list[float]:
    """Row of (2.16) as printed."""
    return [np.sin(beta), -np.cos(beta), arm * np.cos(alpha + beta)]


SHEETS = (constraints, shear)
