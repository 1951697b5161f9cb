"""The page on navigation: its commands run, and it names every key and column."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from plant_models import robot_model
from pydantic import BaseModel

import sysid
from sysid.robot.mission.navigation.finite_model import FiniteModel, Hypothesis
from sysid.robot.mission.navigation.ukf import UnscentedKalman
from sysid.robot.mission.registry import kinds

PAGE = (Path(__file__).parents[3] / "docs" / "navigation.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize(
    ("example", "kind"),
    [(EXAMPLES[0], ()), (EXAMPLES[1], ()), (EXAMPLES[1], ("--navigation", "ekf"))],
    ids=["fused", "hypotheses", "option"],
)
def test_the_missions_of_the_page_are_driven(
    example: str,
    kind: tuple[str, ...],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mission.yaml").write_text(example)
    sysid.write_package(robot_model("arx"), tmp_path / ".sysid" / "plant")
    facts = run(capsys, "simulate", "mission.yaml", *kind, "--plot", "m.svg", "--json").document
    assert facts["outcome"] == "arrived"
    said = any("no sensors are listed" in w for w in facts["warnings"])
    assert said == ("sensors:" not in example)
    assert "95 % of its error" in (tmp_path / "m.svg").read_text(encoding="utf-8")
    log = Path(facts["log"])
    header = log.read_text().splitlines()[0].split(",")
    assert ("p_payload" in header) == ("payload" in example and not kind)
    assert {"x_est", "P_xx", "nis"} <= set(header)
    # The log stays what a fit reads.
    assert np.isfinite(sysid.read_log(log).y).all()


def test_the_page_names_every_kind_key_and_column() -> None:
    settings: tuple[type[BaseModel], ...] = (UnscentedKalman, FiniteModel, Hypothesis)
    words = {*kinds("navigation"), *(key for cls in settings for key in cls.model_fields)}
    words |= {*UnscentedKalman().columns}
    missing = sorted(w for w in words if not re.search(rf"[`,\s]{re.escape(w)}[`,\s]", PAGE))
    assert not missing
