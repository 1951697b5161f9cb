"""``sysid report``: one self-contained page of a model, several, a mission or a diagnosis."""

import os
import shlex
from pathlib import Path
from typing import Any

from sysid.errors import UsageError
from sysid.workspace.logs import StoredData
from sysid.workspace.store import StoredModel, Workspace

from . import reading, render, targets
from .field_options import with_options
from .missions.page import report_mission
from .missions.simulate import load_plant
from .options import command

DOCUMENTS = ("diagnosis.json", "page.json")
"""Files of a diagnosis."""


@command
def report(
    models: list[str] | None = reading.ids(
        "[MODEL|MISSION|DIAGNOSIS]...",
        "Model ids; several are compared [the best model]. Or a mission (YAML), "
        "or the folder of a diagnosis.",
    ),
    output: Path | None = targets.target(
        "FILE.html", "Page [WORKSPACE/report.html].", "-o", suffixes=(".html",)
    ),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Write a page on a model: can it be trusted, and for what?

    Or on a mission: driven with the exported plant once, and 200 times with what varies. Or on a
    diagnosis, by what its folder holds: page.json.
    """
    from sysid.data.files import write_atomic
    from sysid.data.inspection import inspect_records
    from sysid.estimation.assessment.figures import residual_tests
    from sysid.report.model_page import comparison_page, model_page
    from sysid.report.page import stored_page
    from sysid.report.panels import Shown

    store = Workspace(workspace)
    path = output or store.root / "report.html"
    for name in models or ():
        folder = _diagnosis(Path(name))
        if folder is None and Path(name).suffix.lower() not in targets.YAML:
            continue
        if len(models or ()) > 1:
            words = " ".join(models or ())
            raise UsageError(f"{words}: name one mission or one diagnosis alone, or models")
        if folder is None:
            text = report_mission(Path(name), store, load_plant(store, None, False))
        else:
            path = output or folder / "index.html"
            page = stored_page(folder / DOCUMENTS[1])
            text = page.html(os.path.relpath(folder, path.parent))
        write_atomic(path, text)
        _show(path, {"mission" if folder is None else "diagnosis": name}, json)
        return
    stored = [store.load(i) for i in dict.fromkeys(models or ())] or [store.chosen(None)]
    records = StoredData().judging(stored[0])
    if len(stored) == 1:
        (one,) = stored
        logs = StoredData().estimation(one)
        findings = inspect_records(logs) if logs else ()
        tests = residual_tests(one.model, logs) if logs else None
        line = command_of(one)
        page = model_page(one.id, one.model, one.report, records, findings, tests, command=line)
    else:
        page = comparison_page([Shown(s.id, s.model) for s in stored], records, stored[0].id)
    write_atomic(path, page.html())
    _show(path, {"models": [s.id for s in stored]}, json)


def _diagnosis(path: Path) -> Path | None:
    """The folder of a diagnosis that was named, itself or by its document."""
    if path.name in DOCUMENTS:
        return path.parent
    return path if path.is_dir() and (path / DOCUMENTS[0]).exists() else None


def _show(path: Path, of: dict[str, Any], json: bool) -> None:
    if json:
        render.document({"page": path, **of})
    else:
        render.files({"page": path}, page="Page")


def command_of(stored: StoredModel) -> str:
    """The command that makes the model again."""
    from sysid.structures.orders import orders_text

    model = stored.model
    options = model.provenance.options
    files = [str(f) for f in options.get("files") or [s.name for s in model.provenance.data]]
    judges = (stored.report.get("judged_on") or {}).get("files") or []
    diagnosed = options.get("made_by") == "diagnose"
    words = ["sysid", "diagnose" if diagnosed else "fit", *map(_near, files)]
    if judges and judges != files:
        words += [w for judge in judges for w in ("--val", _near(judge))]
    elif (split := options.get("split")) is not None:
        words += ["--split", f"{split:g}"]
    orders = orders_text(model.structure.order_values())
    if not diagnosed:
        words += ["--structure", str(options.get("equations", model.structure.name))]
        words += ["--orders", orders] if orders else []
    read = {**(options.get("read") or {}), **(options.get("prepare") or {})}
    fields = ", ".join(f"{k}={tuple(v) if isinstance(v, list) else v!r}" for k, v in read.items())
    said = with_options(f"`{fields}`").strip("`").removeprefix("sysid fit ") if fields else ""
    return f"{shlex.join(words)} {said}".rstrip()


def _near(file: str) -> str:
    """A file by its name where it lies in or below the working folder."""
    path = Path(file)
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else file
