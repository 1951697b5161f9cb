"""Terminal report of ``sysid diagnose`` in four sections: where, what, added, shrunk."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render

if TYPE_CHECKING:
    from sysid.diagnosis.diagnosis import Diagnosis

_MOST = 5
"""Regimes and candidates shown; the page has them all."""


def show(
    result: "Diagnosis", before: str, after: str, folder: Path, holdout: Sequence[Path] = ()
) -> None:
    """Print the story and what to do next; ``holdout`` are the logs that judged."""
    from sysid.report.diagnosis_words import headline, size_sentence, story

    render.reading(result.reading)
    if result.geometry is not None:
        render.say(result.geometry.sentence, "bold")
    render.cautions(result.changes)
    render.say(headline(result), "bold")
    if story(result):
        render.say(story(result))
    if size_sentence(result):
        render.say(size_sentence(result))
    _where(result)
    _what(result)
    _logs(result)
    _added(result, before, after)
    _shrunk(result)
    render.cautions(result.warnings)
    _next(result, before, after, folder, holdout)


def _section(name: str) -> None:
    render.say("")
    render.say(name, "bold cyan")


def _where(result: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import leading_regions, region_sentence

    _section("Where")
    regions = leading_regions(result, _MOST)
    if not regions:
        render.say("No regime stands out above the noise floor.")
        return
    render.say(region_sentence(regions[0]))
    rows = [
        [
            r.region,
            f"{100 * r.share_of_excess:.0f} %",
            f"{100 * r.interval[0]:.0f}–{100 * r.interval[1]:.0f} %",
            f"{100 * r.share_of_samples:.0f} %",
        ]
        for r in regions
    ]
    render.table(["where", "of excess", "90 %", "of samples"], rows)


def _what(result: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import (
        evidence_sentence,
        nothing_named,
        score_words,
        tie_sentence,
    )

    _section("What")
    for k, e in enumerate(result.effects, start=1):
        where = f" on {', '.join(e.channels)}" if e.channels else ""
        render.say(f"{k}. {e.id} ({e.stage}){where}", "bold")
        for sentence in (
            e.sentence,
            e.fit_words,
            f"Evidence: {evidence_sentence(e)}.",
            tie_sentence(e),
        ):
            if sentence:
                render.say(f"   {sentence}")
    if not result.effects:
        render.say(nothing_named(result))
    if result.description:
        render.say(f"What remains: {result.description}")
    for d in result.rejected:
        render.say(f"Rejected: {d.id}, because {d.reason}.")
    if result.minor:
        render.say(f"Minor or not significant, not added: {', '.join(result.minor)}.")
    if result.candidates:
        best = (f"{id} {score_words(s)}" for id, s in result.candidates[:_MOST])
        render.say(f"Tried first, by score: {', '.join(best)}.", "dim")


def _logs(result: "Diagnosis") -> None:
    """What each of several logs shows, what is the same in all, and what differs."""
    from sysid.diagnosis.several.results import sentences, table_of_logs

    if not result.several.logs:
        return
    _section("Logs")
    heads, rows = table_of_logs(result.several)
    render.table(heads, rows)
    for sentence in sentences(result.several):
        render.say(sentence)


def _added(result: "Diagnosis", before: str, after: str) -> None:
    _section("Added")
    if not result.grown:
        render.say(f"Nothing; the model remains {before}: {result.base_words}.")
        return
    stem = f"the baseline ({result.baseline_words})" if result.baseline_words else ""
    render.say(f"{after} is {stem or f'{before} ({result.base_words})'} with:")
    rows: list[list[Any]] = [
        [
            e.id if k == 0 else "",
            p.name,
            p.in_log_units.value,
            p.in_log_units.words or render.number(None),
            p.in_log_units.unit,
        ]
        for e in result.effects
        for k, p in enumerate(e.parameters)
    ]
    render.table(["effect", "parameter", "value", "± std. error, or 95 %", "unit"], rows)


def _shrunk(result: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import (
        channel_lines,
        gap_sentence,
        residual_sentence,
    )
    from sysid.report.style import percent as fit_words

    _section("Shrunk")
    render.say(gap_sentence(result) if result.grown else "No effect was added.")
    rows = [
        [
            c.name,
            f"{_change(result, *(render.number(e, 4) for e in (c.rmse_before, c.rmse_after)))} "
            f"{c.unit}".rstrip(),
            render.number(c.noise_floor, 4),
            _change(result, fit_words(c.fit_before), fit_words(c.fit_after)),
        ]
        for c in channel_lines(result)
    ]
    render.table(["output", "RMSE, held out", "noise floor", "fit, held out"], rows)
    for test in result.residuals if result.grown else result.residuals[:1]:
        sentence = residual_sentence(test)
        render.say(f"{sentence[:1].upper()}{sentence[1:]}.", "dim")
    _path(result)


def _path(result: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import path_table

    rows = [[cell if cell is None else _short(cell) for cell in r] for r in path_table(result.path)]
    if rows:
        render.table(
            [str(result.path.get("mission", "mission")), "measured", "before", "after"], rows
        )
    if result.path.get("sentence"):
        render.say(result.path["sentence"])


def _short(cell: Any) -> str:
    return render.number(cell, 4) if isinstance(cell, float) else str(cell)


def _change(result: "Diagnosis", before: str, after: str) -> str:
    return f"{before} → {after}" if result.grown and before != after else before


def _next(
    result: "Diagnosis", before: str, after: str, folder: Path, holdout: Sequence[Path]
) -> None:
    render.say("")
    for e in result.next_experiments:
        written = f" Schedule: {folder / e.file}." if e.file else ""
        render.say(f"{e.purpose}{written}")
    render.say(f"Page: {folder / 'index.html'}, all figures: {folder / 'diagnosis.json'}.")
    if result.grown:
        logs = "".join(f" --val {path}" for path in holdout)
        judged = f"{logs} --criterion fit" if holdout else ""
        render.say(
            f"Next: sysid compare {before} {after}{judged}, sysid export --model {after}.", "bold"
        )
    else:
        render.say(f"Next: sysid export --model {after}.", "bold")
