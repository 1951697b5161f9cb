"""Sentences about a fitted motor: its equation with numbers, and physical constants."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array, Channel

if TYPE_CHECKING:
    from sysid.structures.grey_box.dc_motor.structure import MotorPhysics


def sentences(
    m: "MotorPhysics", theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> tuple[str, ...]:
    """One line a track, one on friction, one on the coupling, one on physical constants."""
    p = m.unpack(np, theta)
    q = {k: v for k, v in m.motion(np, p).items() if k != "inertia"}
    inertia, coupling = m.motion(np, p)["inertia"]
    cross = float(np.sum(coupling))
    each = {k: np.broadcast_to(np.ravel(v), (m.ny,)) for k, v in q.items()}
    level = each["coulomb"] / each["gain"]
    lines = []
    for i, (u, y) in enumerate(zip(inputs, outputs, strict=True)):
        w = f"v_{y.name}" if m.output == "position" else y.name
        drive = f"sat({u.name})" if _limited(each["limit"][i]) else u.name
        o = each["offset"][i]
        load = f" {'-' if o >= 0 else '+'} {abs(o):.4g}" if o else ""
        net = f"({drive}{load})" if load else drive
        lines.append(
            f"{float(inertia[i, 0]):.4g} s·d{w}/dt = {each['gain'][i]:.5g}·{net} - {w} - f_{w}"
            + (f" {_signed(-cross)} s·d{outputs[1 - i].name}/dt" if m.ny == 2 else "")
        )
        if m.output == "position":
            lines.append(f"d{y.name}/dt = {w}")
        lines += _friction(w, u, i, each, level)
    lines += _physical(m, p, each, inertia, cross, inputs)
    return tuple(lines)


def _signed(value: float) -> str:
    return f"{'-' if value < 0 else '+'} {abs(value):.3g}"


def _limited(limit: float) -> bool:
    return bool(limit < 1e8)


def _friction(w: str, u: Channel, i: int, e: dict[str, Any], level: Array) -> list[str]:
    unit = f" {u.unit}" if u.unit else ""
    sentences = []
    if level[i] > 0:
        words = f"f_{w}: dry friction takes {level[i]:.4g}{unit} of {u.name} while sliding"
        if e["breakaway"][i] > 1.0:
            words += (
                f" and {level[i] * e['breakaway'][i]:.4g}{unit} at standstill, where it holds any "
                f"smaller command (half of the difference is gone at {w} = {e['stribeck'][i]:.3g})"
            )
        if e["coulomb_back"][i] != 1.0:
            words += f"; backward {e['coulomb_back'][i]:.4g} times that"
        sentences.append(words)
    if e["viscous_back"][i] != 1.0:
        sentences.append(
            f"f_{w}: damping backward is {e['viscous_back'][i]:.4g} times that forward"
        )
    if e["drag"][i] > 0.0:
        sentences.append(f"f_{w}: drag {e['drag'][i]:.4g}·{w}·|{w}|")
    if _limited(e["limit"][i]):
        sentences.append(f"sat({u.name}): the drive gives no more beyond {e['limit'][i]:.5g}{unit}")
    return sentences


def _physical(
    m: "MotorPhysics",
    p: Any,
    e: dict[str, Any],
    inertia: Array,
    cross: float,
    inputs: Sequence[Channel],
) -> list[str]:
    if m.parametrisation == "bench":
        names = [
            f"{c.name} = {float(np.ravel(p[c.name])[0]):.5g} {c.unit}".rstrip()
            for c in m.constants
            if not c.free
            and c.name
            in (
                "resistance",
                "back_emf",
                "torque_constant",
                "gear",
                "motor_inertia",
                "motor_viscous",
                "supply",
            )
        ]
        return ["fixed at the bench's values: " + ", ".join(names)]
    u = inputs[0].unit or inputs[0].name
    G = m.torque_per_input
    if not G:
        return [
            f"From these data alone only ratios are known. With G, the stall torque per {u}: "
            "damping D = Kc·Kem·n²/R + f = G/gain, inertia J = time_constant·D, friction torque = "
            "G·coulomb; `structure_options={'torque_constant': G}` writes them out."
        ]
    D = G / e["gain"]
    sentences = []
    for i in range(m.ny):
        text = (
            f"with {G:g} per {u}: inertia (mass) {inertia[i, 0] * D[i]:.5g}, damping {D[i]:.5g}, "
            f"sliding friction {G * e['coulomb'][i] / e['gain'][i]:.5g}, constant load "
            f"{G * e['offset'][i]:.5g}"
        )
        if m.ny == 2:
            text += f", inertia shared with the other track {cross * D[i]:.5g}"
        sentences.append(text)
    return sentences
