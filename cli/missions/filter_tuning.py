"""``sysid tune --noise-from``: the noise of a mission's filter, estimated from a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import render

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.robot.mission.tuning.filter_noise import FilterTuning


def tune_filter(
    mission: Path,
    log: Path,
    sensors: dict[str, str],
    read: "ReadOptions",
    to: Path | None,
    json: bool,
) -> None:
    """Estimate the noise, show it, and write the mission with it where that is asked."""
    from sysid.robot.mission.spec import load_mission
    from sysid.robot.mission.tuning.filter_noise import tuned_filter
    from sysid.robot.mission.tuning.written import write_mission

    given = load_mission(mission)
    with render.progress(f"Following {log.name}"):
        tuning = tuned_filter(log, given, sensors, read)
    facts: dict[str, Any] = tuning.summary()
    if to is not None:
        noise = {"q": dict(tuning.q), "r": dict(tuning.r), "gate": tuning.gate}
        law = type(given.navigation).model_validate(  # type: ignore[attr-defined]
            {**given.navigation.model_dump(exclude_unset=True), **noise}  # type: ignore[attr-defined]
        )
        tuned = given.model_copy(update={"navigation": law})
        facts["output"] = write_mission(mission, to, tuned, "navigation")
    render.document(facts) if json else _show(log.name, tuning, facts)


def _show(name: str, tuning: "FilterTuning", facts: dict[str, Any]) -> None:
    rows = [
        (
            f"{kind}.{key}",
            render.number(value, 3),
            "at its bound" if f"{kind}.{key}" in tuning.at_bound else "",
        )
        for kind, values in (("q", tuning.q), ("r", tuning.r))
        for key, value in values.items()
    ]
    render.table(("noise", "value", ""), [*rows, ("gate", render.number(tuning.gate, 4), "")])
    before, after = facts["consistency"]["before"], facts["consistency"]["after"]
    pairs = [
        (key, render.number(before[key], 3), render.number(after[key], 3))
        for key in ("nis_mean", "nees_mean", "nees_heading_mean")
        if before.get(key) is not None and after.get(key) is not None
    ]
    errors = facts["errors"]
    pairs += [
        (key, render.number(value, 3), render.number(errors["after"][key], 3))
        for key, value in errors["before"].items()
    ]
    render.table((name, "before", "after"), pairs)
    render.say(tuning.sentence)
    render.cautions(facts["warnings"])
    render.files(facts, output="Mission")
