"""Terminal report of ``sysid diagnose``: an answer that fits a screen."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .answer import Answer
from .fit_report import residual_marks
from .read_as import decisions_in_words

if TYPE_CHECKING:
    from sysid.diagnosis.diagnosis import Diagnosis


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
