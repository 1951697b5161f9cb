"""What ``sysid diagnose`` tells a person, in four sections: where, what, added, shrunk."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render

if TYPE_CHECKING:
    from sysid.diagnosis.diagnosis import Diagnosis

_MOST = 5
"""Regimes and candidates shown; the page has them all."""


def show(
    found: "Diagnosis", before: str, after: str, folder: Path, held: Sequence[Path] = ()
) -> None:
    """Print the story and what to do next; ``held`` are the logs that judged."""
    from sysid.report.diagnosis_words import headline, size_sentence, story

    render.reading(found.reading)
    if found.geometry is not None:
        render.say(found.geometry.sentence, "bold")
    render.say(headline(found), "bold")
    if story(found):
        render.say(story(found))
    if size_sentence(found):
        render.say(size_sentence(found))
    _where(found)
    _what(found)
    _logs(found)
    _added(found, before, after)
    _shrunk(found)
    for sentence in found.warnings:
        render.warn(f"! {sentence}")
    _next(found, before, after, folder, held)


def _section(name: str) -> None:
    render.say("")
    render.say(name, "bold cyan")


def _where(found: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import leading_regions, region_sentence

    _section("Where")
    regions = leading_regions(found, _MOST)
    if not regions:
        render.say("No error above the noise floor stands out.")
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


def _what(found: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import (
        evidence_sentence,
        nothing_named,
        score_words,
        tie_sentence,
    )

    _section("What")
    for k, e in enumerate(found.effects, start=1):
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
    if not found.effects:
        render.say(nothing_named(found))
    if found.description:
        render.say(f"What remains: {found.description}")
    for d in found.dropped:
        render.say(f"Dropped again: {d.id}, because {d.reason}.")
    if found.minor:
        render.say(f"Minor or unproven, not added: {', '.join(found.minor)}.")
    if found.candidates:
        best = (f"{id} {score_words(s)}" for id, s in found.candidates[:_MOST])
        render.say(f"Tried first, by score: {', '.join(best)}.", "dim")


def _logs(found: "Diagnosis") -> None:
    """What each of several logs shows, what is the same in all, and what differs."""
    from sysid.diagnosis.several.words import sentences, table_of_logs

    if not found.several.logs:
        return
    _section("Logs")
    heads, rows = table_of_logs(found.several)
    render.table(heads, rows)
    for sentence in sentences(found.several):
        render.say(sentence)


def _added(found: "Diagnosis", before: str, after: str) -> None:
    _section("Added")
    if not found.grown:
        render.say(f"Nothing; the model stays {before}: {found.base_words}.")
        return
    stem = f"the plainest base ({found.plainer})" if found.plainer else ""
    render.say(f"{after} is {stem or f'{before} ({found.base_words})'} with:")
    rows: list[list[Any]] = [
        [
            e.id if k == 0 else "",
            p.name,
            p.in_log_units.value,
            p.in_log_units.words or render.number(None),
            p.in_log_units.unit,
        ]
        for e in found.effects
        for k, p in enumerate(e.parameters)
    ]
    render.table(["effect", "parameter", "value", "± std. error, or 95 %", "unit"], rows)


def _shrunk(found: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import (
        channel_lines,
        gap_sentence,
        residual_sentence,
    )
    from sysid.report.style import percent as fit_words

    _section("Shrunk")
    render.say(gap_sentence(found) if found.grown else "Nothing was added, so nothing shrank.")
    rows = [
        [
            c.name,
            _change(found, render.number(c.rmse_before, 4), render.number(c.rmse_after, 4)),
            render.number(c.noise_floor, 4),
            _change(found, fit_words(c.fit_before), fit_words(c.fit_after)),
        ]
        for c in channel_lines(found)
    ]
    render.table(["output", "RMSE, held out", "noise floor", "fit, held out"], rows)
    for test in found.residuals if found.grown else found.residuals[:1]:
        sentence = residual_sentence(test)
        render.say(f"{sentence[:1].upper()}{sentence[1:]}.", "dim")
    _path(found)


def _path(found: "Diagnosis") -> None:
    from sysid.report.diagnosis_words import path_table

    rows = [[cell if cell is None else _short(cell) for cell in r] for r in path_table(found.path)]
    if rows:
        render.table(
            [str(found.path.get("mission", "mission")), "measured", "before", "after"], rows
        )
    if found.path.get("sentence"):
        render.say(found.path["sentence"])


def _short(cell: Any) -> str:
    return render.number(cell, 4) if isinstance(cell, float) else str(cell)


def _change(found: "Diagnosis", before: str, after: str) -> str:
    return f"{before} → {after}" if found.grown and before != after else before


def _next(found: "Diagnosis", before: str, after: str, folder: Path, held: Sequence[Path]) -> None:
    render.say("")
    for e in found.next_experiments:
        written = f" Schedule: {folder / e.file}." if e.file else ""
        render.say(f"{e.purpose}{written}")
    render.say(f"Page: {folder / 'index.html'}, all figures: {folder / 'diagnosis.json'}.")
    if found.grown:
        logs = "".join(f" --val {path}" for path in held)
        judged = f"{logs} --criteria fit" if held else ""
        render.say(
            f"Next: sysid compare {before} {after}{judged}, sysid export --model {after}.", "bold"
        )
    else:
        render.say(f"Next: sysid export --model {after}.", "bold")
