"""``sysid tune``: gains of a mission's controller by simulation, and by tuning rules."""

from dataclasses import dataclass
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..mission_options import accept_changes as changes_accepted
from ..options import argument, command, group, option
from .law_options import LawChoice
from .localize import sensor_option, sensor_reading
from .simulate import load_plant

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.robot.mission.tuning.filter_noise import FilterTuning
    from sysid.robot.mission.tuning.tuned import GainSet, Tuning


@dataclass(frozen=True)
class Effort:
    """How much is driven: sets of gains, plants for each, and the seed of all of it."""

    trials: int = option("N", "Sets of gains to drive.", default=256)
    plants: int = option(
        "N",
        "Plants for each set of gains, drawn from the parameter covariance; 1: the estimated one.",
        default=8,
    )
    seed: int = option("N", "Of sets, plants and sensor noise.", default=0)


@dataclass(frozen=True)
class Outputs:
    """Files to write; None for those not asked for: the mission with the gains, a picture."""

    output: Path | None = targets.target(
        "FILE",
        "Write the mission with the proposed gains: .yaml.",
        new_folder=False,
        suffixes=targets.YAML,
    )
    plot: Path | None = targets.picture("Draw the choice: .svg or .png.")


@dataclass(frozen=True)
class Loop:
    """What is driven; None for what the workspace and the mission say."""

    plant: Path | None = option("PATH", "Plant package, folder or zip [WORKSPACE/plant].")
    control: str | None = option(
        "KIND", "Tune another controller than the mission's: pid, or speed=KIND,yaw=KIND."
    )
    accept_changes: bool = changes_accepted()


@command
def tune(
    mission: Path = argument("MISSION", "A mission (YAML)."),
    loop: Loop = group(Loop),
    how: Effort = group(Effort),
    files: Outputs = group(Outputs),
    noise_from: Path | None = option(
        "LOG", "Estimate the filter's noise from this sensor log instead."
    ),
    sensor: dict[str, str] | None = sensor_option(
        "With --noise-from: column that holds a measurement."
    ),
    read: "ReadOptions" = sensor_reading(),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Tune the gains of a mission's controller.

    There are sets to choose from, one of them proposed. Every set drives steps of speed and yaw,
    and the mission, with several plants; the worst counts. Beside them stand the present gains, and
    those that rules read off the plant. With --noise-from it is the noise of the mission's filter
    that is tuned, to a log of its sensors.
    """
    from sysid.data.reading.read_options import ReadOptions
    from sysid.robot.mission.spec import load_mission
    from sysid.robot.mission.tuning.search import SearchOptions
    from sysid.robot.mission.tuning.search import tune as search
    from sysid.robot.mission.tuning.written import write_mission

    if files.output is not None and files.output.exists() and files.output.samefile(mission):
        raise UsageError(f"-o {files.output} would overwrite the mission; name another file")
    if noise_from is not None:
        unused = (("plant", loop.plant), ("control", loop.control), ("plot", files.plot))
        for name, value in unused:
            if value is not None:
                raise UsageError(f"--noise-from tunes a filter; omit --{name}")
        _tune_filter(mission, noise_from, sensor or {}, read, files.output, json)
        return
    if sensor or read != ReadOptions():
        raise UsageError("options that read a log belong to --noise-from LOG")
    options = SearchOptions(how.trials, how.plants, how.seed)
    given = LawChoice(control=loop.control).applied(load_mission(mission))
    package = load_plant(Workspace(workspace), loop.plant, loop.accept_changes)
    with render.progress(f"Driving {mission.name}", how.trials) as advance:
        tuning = search(given, package.model(), options, advance)
    facts: dict[str, Any] = tuning.summary()
    facts["warnings"] = [*package.notes, *tuning.notes]
    if files.output is not None:
        facts["output"] = write_mission(mission, files.output, tuning.mission)
    if files.plot is not None:
        from sysid.report.missions.tuning import draw_tuning

        draw_tuning(files.plot, mission.stem, given, tuning, package.model())
        facts["plot"] = files.plot
    render.document(facts) if json else _show(mission.name, tuning, facts)


def _show(name: str, tuning: "Tuning", facts: dict[str, Any]) -> None:
    sets = _shown(tuning)
    rows = [
        (
            words,
            *(
                "–" if s.criteria[key] is None else f"{s.criteria[key]:.{digits}f}"
                for _, key, digits in _COLUMNS
            ),
        )
        for words, s in sets.items()
    ]
    plants = f", worst of {tuning.plants} plants" if tuning.plants > 1 else ""
    headings = ("set", *(words for words, *_ in _COLUMNS))
    caption = (
        f"V to {tuning.test.speed:.3g} m/s, ψ by 60° and back to -60°; off: steady-state error; "
        "effort: ∫(V_cmd² + ψ_cmd²) dt; –: never; "
        f"--json has all {len(tuning.front)} sets to choose from"
    )
    render.table(headings, rows, title=f"{name}: gains{plants}", caption=caption)
    axes = [f"margins, {axis}" for axis in tuning.best.margins]
    rows = [
        (words, ", ".join(f"{n} {value:g}" for n, value in s.gains.items()), *_margins(s))
        for words, s in sets.items()
    ]
    render.table(("set", "gains", *axes), rows)
    render.say(tuning.sentence)
    render.cautions(facts["warnings"])
    render.files(facts, output="Mission", plot="Picture")


_COLUMNS = (
    ("rise V [s]", "rise_speed_s", 2),
    ("over V [%]", "overshoot_speed", 1),
    ("rise ψ [s]", "rise_yaw_s", 2),
    ("over ψ [%]", "overshoot_yaw", 1),
    ("off V [%]", "error_speed", 1),
    ("off ψ [%]", "error_yaw", 1),
    ("time [s]", "time_s", 1),
    ("clear [m]", "min_clearance_m", 2),
    ("effort [s]", "effort", 2),
)
"""Criteria as the table names them, with decimals."""


def _shown(tuning: "Tuning") -> "dict[str, GainSet]":
    """Rows of the table: the proposed set, the ends of the front, the present one, the rules."""
    sets = {"proposed": tuning.best}
    for words, k in tuning.extremes.items():
        sets[words] = tuning.front[k]
    sets["present"] = tuning.present
    for rule in tuning.rules:
        sets[rule.name if len(rule.axes) > 1 else f"{rule.name} ({rule.axes[0]})"] = rule
    return sets


def _margins(chosen: "GainSet") -> list[str]:
    return [
        f"{_or_any('× {:.2g}', m.gain)}, {_or_any('{:.0f}°', m.phase_deg)}"
        if m.stable
        else "unstable"
        for m in chosen.margins.values()
    ]


def _or_any(form: str, margin: float) -> str:
    return "any" if isinf(margin) else form.format(margin)


def _tune_filter(
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
    render.document(facts) if json else _show_noise(log.name, tuning, facts)


def _show_noise(name: str, tuning: "FilterTuning", facts: dict[str, Any]) -> None:
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
