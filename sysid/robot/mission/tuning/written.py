"""A mission file with another law: its text unchanged except for the section of that law."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias, cast

import yaml
from pydantic import BaseModel

from sysid.data.documents import plain
from sysid.data.files import contents, write_atomic
from sysid.data.yaml_files.source import read_yaml
from sysid.errors import DataError, SysidError, UsageError
from sysid.robot.mission.control.axes import AXES, AxisController
from sysid.robot.mission.registry import kind_of
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.spec import Mission, load_mission

Sections: TypeAlias = Mapping[str, Mapping[str, Any]]
"""Sections of a mission file by name, and their keys."""


def write_mission(source: Path, target: Path, mission: Mission, role: str = "control") -> Path:
    """Write a mission file again with the controller, or another law, of a mission.

    Comments and order of the file stay; what stood in the section of the law goes.

    Args:
        role: the section, ``control`` or ``navigation``.
    """
    law = getattr(mission, role)
    if getattr(rewritten(source, target, {role: section(role, law)}), role) != law:
        raise DataError(
            f"{target} cannot contain the law of {role}, because a mission file cannot name it"
        )
    return target


def write_sections(target: Path, sections: Sections) -> Path:
    """Write a file that holds some sections of a mission and nothing else.

    Args:
        sections: such as ``vehicle`` and ``motion``.
    """
    text = "".join(_block(role, _rounded(keys)) for role, keys in sections.items())
    write_atomic(target, text.encode())
    return target


def write_vehicle(source: Path, target: Path, sections: Sections) -> Path:
    """Write a mission file again with other numbers of its vehicle; all else stays.

    Keys of the sections that are not given stay, too. A motion that the mission names itself and
    that is no rolling is left as it is.

    Args:
        sections: ``vehicle``, and ``motion`` where it slips.
    """
    rolls = kind_of("motion", load_mission(source).motion) == "kinematic"
    values, changed = read_yaml(source).values, dict[str, dict[str, Any]]()
    for role, keys in sections.items():
        if role == "motion" and not rolls:
            continue
        old = values.get(role)
        kept = dict(old) if isinstance(old, dict) else {}
        if role == "vehicle" and rolls:
            kept.pop("motion", None)  # the section of that name says it
        changed[role] = {**kept, **_rounded(keys)}
    rewritten(source, target, changed)
    return target


def rewritten(source: Path, target: Path | None, sections: Sections) -> Mission:
    """Write a mission file again with other sections; comments and order of the rest stay.

    Args:
        target: another file; None for the mission itself.

    Returns:
        The mission as it then is.
    """
    if target is not None and target.exists() and target.samefile(source):
        raise UsageError(f"{target} is the mission itself; name another file")
    values = dict(read_yaml(source).values)
    text = contents(source).decode("utf-8-sig")
    for role, keys in sections.items():
        values[role] = dict(keys)
        text = replaced(text, values, role, values[role])
    write_atomic(target or source, text.encode())
    return load_mission(target or source)


def _rounded(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers to six digits: more than any log determines."""

    def short(value: Any) -> Any:
        if isinstance(value, float):
            return float(f"{value:.6g}")
        return [short(v) for v in value] if isinstance(value, list) else value

    return {name: short(value) for name, value in keys.items()}


def mission_values(mission: Mission) -> dict[str, Any] | None:
    """A mission as plain values, of which ``Mission.model_validate`` makes the same mission.

    None where a mission file could not say it, such as a law that no package names.
    """
    values = mission.model_dump(exclude_unset=True)
    for role in ("guidance", "control", "navigation", "motion"):
        values[role] = section(role, getattr(mission, role))
    values["sensors"] = {
        kind: cast(BaseModel, sensor).model_dump() for kind, sensor in mission.sensors.items()
    }
    try:
        values = plain(values)
        return values if Mission.model_validate(values) == mission else None
    except (TypeError, ValueError, SysidError):
        return None


def section(role: str, control: Any) -> dict[str, Any]:
    """The section of a mission file that describes a law: every gain, and what is no default."""
    if not isinstance(control, AxisController):
        return {"kind": kind_of(role, control), **_keys(control)}
    keys: dict[str, Any] = {}
    for axis in AXES:
        law = getattr(control, axis)
        keys[axis] = {"kind": kind_of(f"control.{axis}", law), **_keys(law)}
    return keys | {k: v for k, v in _keys(control).items() if k not in keys}


def _keys(law: Any) -> dict[str, Any]:
    gains = {name.partition(".")[0] for name in law.gains} if isinstance(law, TunedSettings) else {}
    said = law.model_dump()
    return {
        name: list(said[name]) if isinstance(said[name], tuple) else said[name]
        for name, field in type(law).model_fields.items()
        if name not in AXES and (name in gains or said[name] != field.get_default())
    }


def replaced(text: str, values: dict[str, Any], role: str, law: dict[str, Any]) -> str:
    """The text of a mission file with another section."""
    block = _block(role, law)
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        # one mapping in braces: there is no line that could be kept
        whole: str = yaml.safe_dump({**values, role: law}, sort_keys=False)
        return whole
    for key, value in root.value:
        if key.value == role:
            lines = text.splitlines(keepends=True)
            end = _last_line(value, key.start_mark.line)
            kept = "".join(lines[end + 1 :])
            return "".join(lines[: key.start_mark.line]) + block + kept
    return text + ("" if text.endswith("\n") else "\n") + block


def _last_line(node: yaml.Node, line: int) -> int:
    """The last line on which something of a value stands; blank lines and comments are outside."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _last_line(last[1] if isinstance(last, tuple) else last, line)
    return max(line, int(node.end_mark.line) - (node.end_mark.column == 0))


def _block(role: str, law: dict[str, Any]) -> str:
    lines = []
    for key, value in law.items():
        shown = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=1000)
        lines.append(f"  {key}: {shown.removesuffix('...' + chr(10)).strip()}\n")
    return f"{role}:\n" + "".join(lines)
