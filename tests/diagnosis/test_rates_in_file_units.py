"""A slide driven in counts and read in mm: rates and levels come in these units, models compare."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run

DT, LEVEL = 0.02, 30.0


def slide(seed: int = 1, rows: int = 2500) -> str:
    """τ v̇ = .8 u − v − c sign v: ±255 counts, mm/s, τ = .1 s, dry friction of 30 counts."""
    rng = np.random.default_rng(seed)
    u = np.repeat(np.round(rng.uniform(-230.0, 230.0, rows // 25)), 25)
    v, x, lines = 0.0, 400.0, ["time_s,pwm,pos_mm"]
    for k, counts in enumerate(u):
        lines.append(f"{k * DT:.2f},{counts:.0f},{x + rng.normal(0.0, 0.02):.3f}")
        for _ in range(20):
            push, h = 0.8 * counts - v, DT / 20 / 0.1
            way = np.sign(v) if v else np.sign(push)
            after = v + h * (push - 0.8 * LEVEL * way)
            held = v == 0.0 and abs(push) <= 0.8 * LEVEL
            v = 0.0 if held or v * after < 0.0 else after
            x += v * DT / 20
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_a_diagnosis_of_rates_speaks_of_the_file_and_can_be_compared(
    tmp_path: Path, capsys: Capture
) -> None:
    log, place = tmp_path / "slide.csv", ("--workspace", tmp_path / "ws")
    log.write_text(slide())
    read = ("--input", "pwm", "--output", "pos_mm", "--pwm-max", 255)
    assert run(capsys, "fit", log, *read, "--structure", "arx", *place).code == 0
    told = run(capsys, "diagnose", log, *read, *place, "-o", tmp_path / "d", "--json").document
    friction = next(e for e in told["effects"] if e["id"] in ("coulomb-friction", "stiction"))
    level = next(p for p in friction["parameters"] if p["name"].startswith("level_command"))
    assert level["in_file"]["unit"] == "count"
    assert level["in_file"]["value"] == pytest.approx(LEVEL, rel=0.1)
    (size,) = told["gap"]["channels"]
    assert size == "pos_mm_rate"
    own = next(p for p in friction["parameters"] if p["name"].startswith("level["))
    assert own["in_file"]["unit"] == "mm/s"
    # the file holds positions, which no model of rates can be judged on
    assert run(capsys, "compare", *place).code == 0
