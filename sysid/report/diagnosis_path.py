"""The path of a mission with the model before and after, for the terminal and the page."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.data.record import Array


def path_table(path: Mapping[str, Any]) -> tuple[tuple[str, Any, Any, Any], ...]:
    """(what, measured, before, after) of a mission: driven again, and replayed."""
    rows: list[tuple[str, Any, Any, Any]] = []
    runs = path.get("closed_loop") or {}
    for key, label in _DRIVEN.items():
        measured, old, new = (
            (runs.get(name) or {}).get(key) for name in ("measured", "before", "after")
        )
        if (measured, old, new) != (None, None, None):
            rows.append((f"closed loop: {label}", measured, old, new))
    for log in path.get("open_loop") or ():
        for key, label in _REPLAYED.items():
            if f"{key}_before_m" in log:
                old, new = log[f"{key}_before_m"], log[f"{key}_after_m"]
                rows.append((f"{log['record']} replayed: {label}", None, old, new))
    return tuple(rows)


_DRIVEN = {
    "outcome": "outcome",
    "time_s": "time [s]",
    "path_length_m": "path length [m]",
    "min_clearance_m": "clearance [m]",
    "path_error_rms_m": "path error, RMS [m]",
}
_REPLAYED = {"rms": "path error, RMS [m]", "end": "path error at the end [m]"}


def path_lines(path: Mapping[str, Any]) -> tuple[tuple[str, tuple[tuple[str, Array], ...]], ...]:
    """(record, ((run, points (N, 2)), …)) of the replayed paths under ``traces``."""
    lines_of = []
    for trace in path.get("traces") or ():
        lines = tuple(
            (name, np.array(trace[name], dtype=np.float64)[:, :2])
            for name in ("measured", "before", "after")
            if len(trace.get(name) or ()) > 1
        )
        if lines:
            lines_of.append((str(trace.get("record", "")), lines))
    return tuple(lines_of)
