"""The command line as a user meets it, in process: arguments in, exit code and streams out."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sysid_cli.app import main

Capture = pytest.CaptureFixture[str]


@dataclass(frozen=True)
class Run:
    """What one command left behind."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON document on stdout; no other text may stand there."""
        assert self.code == 0, self.err
        found: dict[str, Any] = json.loads(self.out, parse_constant=_not_json)
        return found


def run(capsys: Capture, *arguments: object) -> Run:
    """Run ``sysid`` with these arguments."""
    capsys.readouterr()
    code = main([str(a) for a in arguments])
    streams = capsys.readouterr()
    return Run(code, streams.out, streams.err)


def write_log(
    path: Path, names: Sequence[str], columns: Sequence[Sequence[float]], step: float | None = 0.1
) -> Path:
    """A CSV log with a time column ``t`` (unless ``step`` is None), 9 significant digits."""
    n = len(columns[0])
    if step is not None:
        names, columns = ["t", *names], [np.arange(n) * step, *columns]
    rows = [",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


def robot_signals(
    samples: int = 300, seed: int = 1, *, together: bool = False, noise: float = 0.1
) -> dict[str, np.ndarray]:
    """Two first-order tracks, ω(t) = a ω(t−1) + b PWM(t−1): a 0.6, 0.7; b 4e-4, 3e-4."""
    rng = np.random.default_rng(seed)
    pwm = np.repeat(rng.integers(-4, 5, size=(samples // 4 + 1, 2)), 4, axis=0)[:samples] * 5000.0
    if together:
        pwm[:, 1] = pwm[:, 0]
    omega = np.zeros((samples, 2))
    for k in range(1, samples):
        omega[k] = np.array([0.6, 0.7]) * omega[k - 1] + np.array([4e-4, 3e-4]) * pwm[k - 1]
    omega += noise * rng.standard_normal((samples, 2))
    return {"pwm_l": pwm[:, 0], "pwm_r": pwm[:, 1], "omega_l": omega[:, 0], "omega_r": omega[:, 1]}


def robot_log(path: Path, samples: int = 300, seed: int = 1, **facts: Any) -> Path:
    """A log of those two tracks."""
    signals = robot_signals(samples, seed, **facts)
    return write_log(path, list(signals), list(signals.values()))


def contents(root: Path) -> dict[str, str]:
    """Hash of every file under a folder."""
    return {
        str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(root.rglob("*"))
        if p.is_file()
    }


def _not_json(constant: str) -> float:
    raise AssertionError(f"{constant} is not JSON")
