"""Command lines, what they work on, and how one is run in process."""

import contextlib
import io
import shlex
from functools import cache
from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parent.parent.parent / "datasets"


COMMANDS = (
    "inspect {log} --ts 0.1 --pwm-max 255 --unit y=rpm --json",
    "inspect {log} --input u --output y --time t --resample fill --unwrap y=4096 --trim 0.1:0.1",
    "inspect {robot} --unit omega_l=counts=2048/rev --join {log} --join-offset 0.1 --decimate 2",
    "fit {log} --structure arx --orders 'na=1 nb=1 nk=1' --split 0.7 --skip 3 --fix a1=0 {ws}",
    "fit {log} --structure oe --orders 'nb=1:2 nf=1' --bound b1=-1:1 --json {ws}",
    "fit {robot} --structure arx --orders 'na=1 nb=1,0;0,1' --robust --horizon 2 --stable {ws}",
    "fit {log} --orders 'na=1 nb=1 nf=1 nc=1 nd=1' --detrend linear --initial zero {ws}",
    "fit {log} --structure hammerstein-wiener --orders 'nb=1 nf=1' --option input=dead-zone {ws}",
    "excite prbs --duration 5 --ts 0.1 --amplitude 9000 --clock 3 --seed 1 -o {new}",
    "excite multisine --band 0.1:2 --duration 5 --ts 0.05 --tracks equal -o {new}",
    "compare --criterion aic --folds 3 {ws}",
    "models list --json {ws}",
    "structures arx",
    "export --format c,fmu {ws}",
    "simulate {mission} --guidance field --control pid --seed 1 {ws}",
    "simulate {mission} --runs 2 --vary start,noise --seed 1 --json {ws}",
    "localize {robot} --mission {mission} --sensor gyro_z=omega_l --navigation odometry {ws}",
    "vehicle {vehicle} --twist 0.1,0,0.2 --json",
    "vehicle {vehicle} --urdf {new}.urdf",
    "soil clay --slope 5 --slip 0.1,0.2 --set cohesion=5000 --road-wheels 4",
    "plan {mission} --guidance field {ws}",
    "bench motor {bench} --gear 120 --known R=3.1 --unit voltage_V=V",
    "bench pendulum --period 1.2 --m 3 --l 0.2 --m1 0.1 --l1 0.1 --std-error l=0.002",
)


@cache
def good_logs() -> tuple[str, str]:
    """A motor's log and a robot's."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.integers(-4, 5, (20, 2)), 4, axis=0) * 3000.0
    y, rows = np.zeros(2), []
    for k, row in enumerate(u):
        rows.append([0.1 * k, *row, *(y + 0.05 * rng.standard_normal(2))])
        y = 0.7 * y + 3e-4 * row
    robot = "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in rows)
    motor = "".join(f"{r[0]:.1f},{r[1]:g},{r[3]:.6g}\n" for r in rows)
    return "t,u,y\n" + motor, "t,pwm_l,pwm_r,omega_l,omega_r\n" + robot


def _bench_of_commands(folder: Path) -> dict[str, str]:
    """Places by name, made once in a folder."""
    from sysid_cli.app import main

    log, robot, ws = folder / "log.csv", folder / "robot.csv", folder / "ws"
    if not ws.exists():
        for path, text in zip((log, robot), good_logs(), strict=True):
            path.write_text(text)
        fit = ["fit", str(robot), "--structure", "arx", "--orders", "na=1 nb=1"]
        main([*fit, "--workspace", str(ws)])
        main(["export", "--workspace", str(ws)])
    return {
        "log": str(log),
        "robot": str(robot),
        "ws": f"--workspace {ws}",
        "new": str(folder / "new"),
        "mission": str(DATA / "missions/goal_1m.yaml"),
        "vehicle": str(DATA / "vehicles/omni.yaml"),
        "bench": " ".join(map(str, sorted((DATA / "bench").glob("*.csv")))),
    }


LONG_OPTIONS = ("--follow", "--ros", "--scheduler", "--wait", "--bag")


def run_command(path: Path) -> None:
    """Run the command line that a file holds.

    Raises:
        BrokenError: it ends in what is no sentence.
    """
    text = path.read_bytes().decode("utf-8", "replace")
    nowhere = io.StringIO()
    with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        places = _bench_of_commands(path.parent)
    for name, place in places.items():
        text = text.replace("{" + name + "}", place)
    try:
        words = shlex.split(text)
    except ValueError:
        return
    known = (str(path.parent), str(DATA))
    if any(w.startswith(("/", "..")) and not w.startswith(known) for w in words):
        return  # files of the machine itself are no business of this
    if words[:1] == ["node"] or any(w.startswith(LONG_OPTIONS) for w in words):
        return  # what waits for others
    _run(words, path.parent)


def inspect_and_fit(path: Path) -> None:
    """Run the two commands that a log meets first.

    Raises:
        BrokenError: one ends in what is no sentence.
    """
    _run(["inspect", str(path)], path.parent)
    orders = ["--structure", "arx", "--orders", "na=1 nb=1"]
    _run(["fit", str(path), *orders, "--workspace", str(path.parent / "fits")], path.parent)


def _run(words: list[str], folder: Path) -> None:
    from sysid_cli.app import main

    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(["--debug", *words])
        except SystemExit as exit:
            code = exit.code
    said = err.getvalue()
    if code not in (0, 1, 2) or "unexpected error (" in said:
        raise BrokenError(said)
    if len(last := (said.splitlines() or [""])[-1]) > 3000:
        raise BrokenError(f"a sentence of {len(last)} letters")


class BrokenError(Exception):
    """A command ended in what is no sentence; its text is the traceback."""
