"""Pictures of a fit and of a replay: measured and simulated, whole and where it is worst."""

from collections.abc import Sequence
from pathlib import Path

from sysid.data.record import Record
from sysid.plant.replay import Replay
from sysid.report.data_panels import fit, run_panels
from sysid.report.panels import PanelPicture, Shown
from sysid.report.plots import write_picture


def draw_fit(path: Path, shown: Shown, records: Sequence[Record]) -> None:
    """Draw a model on records."""
    data = ", ".join(r.name for r in records)
    write_picture(path, PanelPicture(shown.label, f"free run on {data}", fit([shown], records)))


def draw_replay(path: Path, result: Replay) -> None:
    """Draw the measured outputs of a log beside the plant's."""
    record = result.record
    panels = run_panels(record, {"plant": result.simulated})
    title = f"The exported plant on {record.name}"
    write_picture(path, PanelPicture(title, "free run from rest", panels))
