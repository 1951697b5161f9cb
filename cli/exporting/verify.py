"""``sysid verify``: whether a plant package gives the same wherever it runs."""

from pathlib import Path
from typing import Annotated

import typer

from .. import reading, render


def verify(
    package: Annotated[
        Path, typer.Argument(metavar="PACKAGE", help="A plant package: folder or zip.")
    ],
    json: reading.Json = False,
) -> None:
    """Replay the self-test of a plant package on every installed runtime."""
    from sysid.export.verification.verify import verify as replayed

    with render.progress(f"Verifying {package}"):
        replay = replayed(package)
    if json:
        render.document(replay.summary())
    else:
        rows = [
            (
                r.name,
                r.version or "–",
                "–" if r.max_error is None else render.number(r.max_error, 2),
                "passed" if r.passed else f"skipped: {r.skipped}" if r.skipped else "FAILED",
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
                render.warn(f"{r.name}: {r.failed}.")
    if not replay.passed:
        raise typer.Exit(1)
