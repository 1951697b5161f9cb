"""Write the bundled robot logs again, byte for byte: ``python datasets/generate.py [--out DIR]``.

With ``--effect`` it writes logs of a plain robot with something hidden in them instead:
``python datasets/generate.py --effect dead-zone --seed 3 -o DIR`` (``hidden_logs.py``).

Each log is a schedule of commands, the truth twin's answer to it and the sensors' noise. Schedule,
encoder noise and pose noise have generators of their own, so that another twin under the same log
meets the same commands and the same noise.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING or __package__:
    from sysid_datasets.driving import STYLES
    from sysid_datasets.hidden_effects import KNOWN
    from sysid_datasets.hidden_logs import NOISE, Request, write_hidden
    from sysid_datasets.schedules import Pwm, multilevel, multisine, prbs, pulses
    from sysid_datasets.twin import DEVASTATOR, Truth, Twin, simulate_truth
else:  # run as a file, from a checkout in which nothing is installed
    from driving import STYLES
    from hidden_effects import KNOWN
    from hidden_logs import NOISE, Request, write_hidden
    from schedules import Pwm, multilevel, multisine, prbs, pulses
    from twin import DEVASTATOR, Truth, Twin, simulate_truth

OMEGA_SIGMA = 0.1
"""Noise of an encoder reading [rad/s], the same in every log: 1 % of the standard deviation of the
true speeds of ``multilevel`` (10.1 rad/s, mean of both tracks), so a perfect model fits 99 %."""

POSITION_SIGMA = 0.001
"""Noise of x and y, as of a camera over the floor [m]."""

HEADING_SIGMA = 0.002
"""Noise of psi [rad]."""


@dataclass(frozen=True)
class Log:
    """How one bundled log is made."""

    seed: int
    """Seed of its schedule and, with a stream number, of its noise."""
    schedule: Callable[[np.random.Generator], Pwm]
    """The commands."""
    pose: bool = False
    """Whether the log has x, y, psi."""


LOGS: dict[str, Log] = {
    "forward_back": Log(
        11, lambda rng: pulses((5000, 8000, 11000, 14000, 17000, 20000), (1, 1), 2.5, 1.5)
    ),
    "forward_back_val": Log(
        12, lambda rng: pulses((6500, 9500, 12500, 15500, 18500), (1, 1), 2.0, 1.5)
    ),
    "rotation": Log(
        21, lambda rng: pulses((5000, 8000, 11000, 14000, 17000), (-1, 1), 2.5, 1.5), pose=True
    ),
    "rotation_val": Log(
        22, lambda rng: pulses((6500, 9500, 12500, 15500), (-1, 1), 2.5, 1.5), pose=True
    ),
    "multilevel": Log(31, lambda rng: multilevel(rng, 119.0, 64, 8, (0.8, 2.5)), pose=True),
    "multilevel_val": Log(32, lambda rng: multilevel(rng, 79.0, 53, 7, (0.6, 2.0)), pose=True),
    "prbs": Log(41, lambda rng: prbs(rng, 12000, 0.8, tap=6), pose=True),
    "prbs_val": Log(42, lambda rng: prbs(rng, 13000, 0.8, tap=4), pose=True),
    "multisine": Log(51, lambda rng: multisine(rng, 60.0, 11800, 7200, 0.7)),
    "multisine_val": Log(52, lambda rng: multisine(rng, 50.0, 11500, 7000, 0.7)),
}


@dataclass(frozen=True, eq=False)
class Reading:
    """What the robot's sensors gave, and the truth behind it; time along axis 0."""

    truth: Truth
    omega: NDArray[np.float64]
    """Encoder speeds [rad/s], shape (N, 2)."""
    pose: NDArray[np.float64] | None
    """x, y [m], psi [rad], shape (N, 3), where the log has a pose."""


def truth_of(name: str, twin: Twin = DEVASTATOR) -> Truth:
    """What ``twin`` does under the commands of a bundled log, without any noise."""
    log = LOGS[name]
    return simulate_truth(log.schedule(_generator(log.seed, 0)), twin)


def reading_of(name: str, twin: Twin = DEVASTATOR) -> Reading:
    """The truth of a bundled log and what the sensors make of it."""
    log = LOGS[name]
    truth = truth_of(name, twin)
    noise = _generator(log.seed, 1).standard_normal(truth.omega.shape)
    pose = None
    if log.pose:
        spread = np.array([POSITION_SIGMA, POSITION_SIGMA, HEADING_SIGMA])
        pose = truth.pose + spread * _generator(log.seed, 2).standard_normal(truth.pose.shape)
    return Reading(truth=truth, omega=truth.omega + OMEGA_SIGMA * noise, pose=pose)


def csv_of(name: str, twin: Twin = DEVASTATOR) -> str:
    """The text of a bundled log: fixed digits, one row per sample, newline at the end."""
    reading = reading_of(name, twin)
    columns = [reading.truth.t[:, None], reading.truth.pwm, reading.omega]
    header, row = "t,pwm_l,pwm_r,omega_l,omega_r", "%.1f,%.0f,%.0f,%.4f,%.4f"
    if reading.pose is not None:
        columns.append(reading.pose)
        header, row = header + ",x,y,psi", row + ",%.4f,%.4f,%.4f"
    # Rounding first and adding zero turns every -0.0 into 0.0, which prints without a sign.
    table = np.hstack(columns).round(4) + 0.0
    lines = [header, *(row % tuple(values) for values in table.tolist())]
    return "\n".join(lines) + "\n"


def write(out: Path) -> list[Path]:
    """Write every log to ``out``/devastator and return the files.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    folder = out / "devastator"
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in LOGS:
        file = folder / f"{name}.csv"
        draft = file.with_suffix(".part")
        draft.write_text(csv_of(name), encoding="ascii", newline="\n")
        draft.replace(file)
        written.append(file)
    return written


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    out: Path = options.out
    try:
        if options.effect is None:
            files = write(out)
        else:
            files = write_hidden(_request(parser, options), out)
    except OSError as error:
        print(f"cannot write the logs to {out}: {error.strerror or error}", file=sys.stderr)
        return 1
    for file in files:
        print(file)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description="Write the bundled robot logs from the twin, or logs with a hidden effect."
    )
    here = Path(__file__).resolve().parent
    parser.add_argument(
        "-o", "--out", type=Path, default=here, metavar="DIR",
        help="folder to write devastator/, or the logs with a hidden effect, into",
    )  # fmt: skip
    hidden = parser.add_argument_group("a hidden effect")
    hidden.add_argument("--effect", metavar="ID[,ID]", help="what to hide: " + ", ".join(KNOWN))
    hidden.add_argument("--seed", type=int, default=1, metavar="K", help="robot, strength, noise")
    hidden.add_argument("--noise", choices=list(NOISE), default="low", help="1 %% or 3 %%")
    hidden.add_argument("--style", choices=list(STYLES), default="steps", help="the commands")
    hidden.add_argument("--duration", type=float, default=120.0, metavar="S", help="of est.csv [s]")
    hidden.add_argument("--rate", type=float, metavar="HZ", help="default 20, with --mission 10")
    hidden.add_argument("--strength", type=float, default=1.0, metavar="X", help="0 is no effect")
    hidden.add_argument("--mission", action="store_true", help="two missions, with the pose")
    hidden.add_argument("--disturbance", choices=["white", "ar", "walk"], default="white")
    hidden.add_argument("--closed-loop", action="store_true", help="speed under PI control")
    hidden.add_argument("--clean", action="store_true", help="clean.csv: the robot without effects")
    return parser


def _request(parser: argparse.ArgumentParser, options: argparse.Namespace) -> Request:
    """What the options ask for; refuses the impossible with exit code 2."""
    effects = tuple(e for e in options.effect.split(",") if e != "none")
    unknown = [e for e in effects if e not in KNOWN]
    rate = options.rate or (10.0 if options.mission else 20.0)
    if unknown:
        parser.error(f"no effect {', '.join(map(repr, unknown))}; there are {', '.join(KNOWN)}")
    if len(set(effects)) < len(effects):
        parser.error("--effect names an effect twice")
    if options.seed < 0 or options.strength < 0.0:
        parser.error("--seed and --strength must not be negative")
    if not (2.0 <= rate <= 200.0 and 5.0 <= options.duration <= 3600.0):
        parser.error("--rate must be 2 to 200 Hz and --duration 5 to 3600 s")
    return Request(
        effects=effects,
        seed=options.seed,
        noise=options.noise,
        style=options.style,
        duration=options.duration,
        rate=rate,
        strength=options.strength,
        mission=options.mission,
        disturbance=options.disturbance,
        closed_loop=options.closed_loop,
        clean=options.clean,
    )


def _generator(seed: int, stream: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([seed, stream]))


if __name__ == "__main__":
    sys.exit(main())
