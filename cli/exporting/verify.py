"""``sysid verify``: the self-test of a plant package on every installed runtime."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from .. import reading, render
from ..field_options import with_options
from ..options import argument, command, flag

if TYPE_CHECKING:
    from sysid.export.verification.runtimes import Result


@command
def verify(
    package: Path = argument("PACKAGE", "A plant package: folder or zip."),
    trust: bool = flag(
        "Also run code that is not what sysid makes of plant.json, without network."
    ),
    json: bool = reading.JSON,
) -> None:
    """Replay a package's self-test on every installed runtime."""
    from sysid.export.verification.verify import verify as replayed

    with render.progress(f"Verifying {package}"):
        replay = replayed(package, trust)
    if json:
        render.document(replay.summary())
    else:
        rows = [
            (
                r.name,
                r.version or "–",
                "–" if r.max_error is None else render.number(r.max_error, 2),
                _outcome(r),
            )
            for r in replay.results
        ]
        render.table(("runtime", "version", "largest error / range", ""), rows)
        for r in replay.results:
            if r.instructions:
                counts = [
                    (name, f"{c['mean']:.0f}", f"{c['most']:.0f}")
                    for name, c in r.instructions.items()
                ]
                render.table((f"instructions on {r.name}", "mean", "most"), counts)
            if r.failed:
                render.warn(f"{r.name}: {with_options(r.failed)}.")
    if not replay.passed:
        raise typer.Exit(1)


def _outcome(result: "Result") -> str:
    if result.passed:
        return "passed"
    return f"skipped: {with_options(result.skipped)}" if result.skipped else "FAILED"
