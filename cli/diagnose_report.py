"""Terminal report of ``sysid diagnose``: an answer, and on request all of it in four sections."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render
from .answer import Answer
from .fit_report import residual_marks
from .read_as import decisions_in_words

if TYPE_CHECKING:
    from sysid.diagnosis.diagnosis import Diagnosis

_MOST = 5
"""Regimes and candidates shown; the page has them all."""


def show(
    result: "Diagnosis",
    before: str,
    after: str,
    folder: Path,
    read_as: Sequence[dict[str, str]],
) -> None:
    """Print what is missing, how sure that is, what is left, and what to do next."""
    from sysid.report import diagnosis_words as words

    answer = Answer()
    answer.note(decisions_in_words(read_as), 2)
    for line in result.reading[:1]:
        answer.say(line, "dim", 1)
    if result.geometry is not None:
        answer.say(result.geometry.sentence, "bold", 2)
    answer.say(words.headline(result), "bold", 2)
    if result.grown:
        for line in (words.closed_sentence(result), words.fits_sentence(result)):
            answer.say(line, "", 2)
        answer.say(words.base_sentence(result, before), "", 2)
    else:
        answer.say(words.story(result), "", 4)
        answer.say(words.fits_sentence(result), "", 2)
    if result.effects:
        heads, rows = words.effect_table(result)
        shown = answer.table(heads, rows, spare=5)
        if shown < len(rows):
            answer.say(f"  {len(rows) - shown} more rows: the page", "dim", 1)
    failed = result.tests is not None and not result.tests.passed
    marks = residual_marks(result.tests.as_dict()) if result.tests and failed else ""
    left = words.left_sentence(result, marks)
    for line in (words.worst_sentence(result), left, result.description):
        if answer.room > 0:
            answer.say(line, "", min(answer.room, 2))
    if result.path.get("sentence") and answer.room > 1:
        answer.say(str(result.path["sentence"]), "", 2)
    answer.cautions([*result.changes, *result.warnings], "the page")
    answer.say(f"Saved {after}. Page: {folder / 'index.html'}", "", 1)
    answer.print(f"Next: {'sysid show | sysid compare | ' * result.grown}sysid export")


def show_all(result: "Diagnosis", before: str, after: str, folder: Path) -> None:
    """Print everything below the answer: where, what, by log, what was added, what it closes."""
    from sysid.report import diagnosis_words as words

    render.reading(result.reading)
    for sentence in (words.story(result), words.size_sentence(result)):
        if sentence:
            render.say(sentence)
    _where(result)
    _what(result)
    _logs(result)
    _added(result, before, after)
    _shrunk(result)
    render.cautions((*result.changes, *result.warnings))
    if result.against is not None:
        render.say(result.against.sentence(result.gap))
    _next(result, folder)


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
    render.table(["where", "of excess", "95 %", "of samples"], rows)


def _what(result: "Diagnosis") -> None:
    from sysid.report import diagnosis_words as words

    _section("What")
    for k, e in enumerate(result.effects, start=1):
        where = f" on {', '.join(e.channels)}" if e.channels else ""
        render.say(f"{k}. {e.id} ({e.stage}){where}", "bold")
        for sentence in (e.sentence, words.evidence_sentence(e), words.tie_sentence(e)):
            if sentence:
                render.say(f"   {sentence}")
    if not result.effects:
        render.say(words.nothing_named(result))
    for s in result.shapes:
        render.say(f"Shape: {words.shape_sentence(s)}")
    if result.description:
        render.say(f"What remains: {result.description}")
    for d in result.rejected:
        render.say(f"Rejected: {d.id}, because {d.reason}.")
    if result.minor:
        render.say(f"Minor or not significant, not added: {', '.join(result.minor)}.")
    if result.candidates:
        best = (f"{id} {words.score_words(s)}" for id, s in result.candidates[:_MOST])
        render.say(f"Tried first, by fall of BIC: {', '.join(best)}.", "dim")


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
    render.say(f"{after} is {before} ({result.base_words}) with:")
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
    render.table(["effect", "parameter", "value", "95 % interval", "unit"], rows)


def _shrunk(result: "Diagnosis") -> None:
    from sysid.report import diagnosis_words as words
    from sysid.report.style import percent as fit_words

    _section("Shrunk")
    render.say(words.gap_sentence(result) if result.grown else "No effect was added.")
    rows = [
        [
            c.name,
            f"{_change(result, *(render.number(e, 4) for e in (c.rmse_before, c.rmse_after)))} "
            f"{c.unit}".rstrip(),
            render.number(c.noise_floor, 4),
            _change(result, fit_words(c.fit_before), fit_words(c.fit_after)),
        ]
        for c in words.channel_lines(result)
    ]
    render.table(["output", "RMSE, held out", "noise floor", "fit, held out"], rows)
    for test in result.residuals if result.grown else result.residuals[:1]:
        sentence = words.residual_sentence(test)
        render.say(f"{sentence[:1].upper()}{sentence[1:]}.", "dim")
    _path(result)


def _path(result: "Diagnosis") -> None:
    from sysid.report.diagnosis_path import path_table

    rows = [
        [render.number(cell, 4) if isinstance(cell, float) else cell for cell in row]
        for row in path_table(result.path)
    ]
    if rows:
        render.table(
            [str(result.path.get("mission", "mission")), "measured", "before", "after"], rows
        )
    if result.path.get("sentence"):
        render.say(result.path["sentence"])


def _change(result: "Diagnosis", before: str, after: str) -> str:
    return f"{before} → {after}" if result.grown and before != after else before


def _next(result: "Diagnosis", folder: Path) -> None:
    render.say("")
    for e in result.next_experiments:
        written = f" Schedule: {folder / e.file}." if e.file else ""
        render.say(f"{e.purpose}{written}")
    render.say(f"Page: {folder / 'index.html'}, all figures: {folder / 'diagnosis.json'}.")
