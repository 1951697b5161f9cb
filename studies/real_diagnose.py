"""What ``diagnose`` names on measured records whose physics is known from their notes.

Every record is read as a person would, a part of it is searched and another part judges. What has
to be named, and what may be named besides, is what the records' own notes and publications say;
what is "in the record" was found there by other means after a first run had named it. Needs the
measured records (``records.data_folder``).
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from math import hypot
from pathlib import Path
from typing import Any

import sysid
from studies.records import data_folder
from studies.runner import Study, finished, restored
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.report.markdown import table
from sysid.vehicle.kinematics import Geometry

STUDY = Study("real_diagnose", "real_diagnose.md", jobs=1)

FRICTION = frozenset({"coulomb-friction", "stiction"})
"""Dry friction."""
STANDSTILL = FRICTION | {"dead-zone"}
"""What keeps a motor from starting: where notes speak of a dead zone of the motor or of its loop,
friction and a dead zone of the command act alike."""
DRIVETRAIN = frozenset(
    {"input-delay", "rate-limit", "actuator-lag", "sensor-lag"}
    | {"cross-coupling", "inertial-coupling"}
)
"""What the notes of the driven robots tell of their wheels: delay, lag, rate limit, and that the
sides are coupled through the ground."""
SCRUBBING = frozenset({"track-width", "track-slip", "scrub-lag", "lateral-slip"})
"""How a vehicle on wheels that do not steer turns less than its wheels say."""
OF_SAMPLES = frozenset({"quantisation", "held-telemetry", "dropouts"})
"""What is a matter of sensor and log: never counted as a name too many."""

Part = tuple[str, float, float]
"""A file below the folder of records and the shares of its rows, from and to."""


@dataclass(frozen=True)
class Case:
    """A record and what is known of it.

    Attributes:
        name: as the table calls it.
        search, judge: what effects are searched on, and what judges.
        must: sets of names of which one each has to be given; none for a record without effects.
        may: names that the notes tell of besides.
        source: why these.
        read: how a person reads it.
        geometry: wheel radius and distance of the sides [m].
    """

    name: str
    search: tuple[Part, ...]
    judge: tuple[Part, ...]
    must: tuple[frozenset[str], ...]
    may: frozenset[str]
    source: str
    read: sysid.ReadOptions = field(default_factory=sysid.ReadOptions)
    geometry: tuple[float, float] | None = None


def _cut(
    name: str,
    file: str,
    share: float,
    must: Sequence[frozenset[str]],
    may: Sequence[str],
    source: str,
    read: sysid.ReadOptions | None = None,
    geometry: tuple[float, float] | None = None,
) -> Case:
    """A record of one file: the first ``share`` is searched, the rest judges."""
    parts = ((file, 0.0, share),), ((file, share, 1.0),)
    read = read or sysid.ReadOptions()
    return Case(name, *parts, tuple(must), frozenset(may), source, read, geometry)


def _names(*ids: str) -> frozenset[str]:
    return frozenset(ids)


def _robot(name: str, file: str, must: Sequence[str], source: str, lengths: object) -> Case:
    r, width = lengths  # type: ignore[misc]
    wanted = [SCRUBBING, *(_names(m) for m in must)]
    may = [*DRIVETRAIN, *SCRUBBING, "longitudinal-slip"]
    return _cut(name, f"drive/{file}.csv", 0.7, wanted, may, source, geometry=(r, width))


def _whole(names: Sequence[str]) -> tuple[Part, ...]:
    return tuple((f"bam/{name}.csv", 0.0, 1.0) for name in names)


SPEED_ONLY = sysid.ReadOptions(inputs=("u_V",), outputs=("y_speed_rad_s",))
HOOP = "hoop_motor/random_steps.csv"
FIRST_DRIVES = ("sin_sin_kp100", "sin_sin_kp400", "sin_time_square_kp200")
SECOND_DRIVES = ("sin_sin_kp200", "up_and_down_kp100", "lift_and_drop_kp400")
"""Of the last the motor is on in a third of the rows: the reader leaves the others out."""
WEIGHT = (_names("gravity-load"), FRICTION)
_OF_SERVO = _names("input-delay", "sensor-lag")
"""The speed lags the position by four samples."""
BAM = "servo with a pendulum: gravity over the angle, Coulomb friction that grows with load"

CASES: tuple[Case, ...] = (
    _cut(
        "EMPS",
        "emps/train.csv",
        0.75,
        [FRICTION],
        ["load-bias", "viscous-asymmetry"],
        "published: viscous and Coulomb friction, an offset of force; in the record, inverse "
        "dynamics by least squares puts the offset into viscous friction that is 1.45 times as "
        "large backwards",
        sysid.ReadOptions(inputs=("u_vir_V",), outputs=("y_qm_m",)),
    ),
    *(
        _cut(
            f"CED {w}",
            f"ced/unif_{w}.csv",
            0.8,
            [_names("unsigned-speed")],
            [],
            "published: a pulse counter, speed without sign",
        )
        for w in ("low", "high")
    ),
    _cut(
        "tacho_motor",
        "tacho_motor/random_steps_10hz_2000.csv",
        0.75,
        [STANDSTILL],
        ["concave-gain", "sensor-saturation", "input-saturation", "freewheel"],
        "notes: dead zone of .5 V, concave gain, sensor clips at 5 V; in the record the "
        "speed falls along a line, 7.5 V/s from any speed, and rises within .1 s: nothing brakes "
        "the motor",
    ),
    Case(
        "hoop_motor",
        ((HOOP, 0.0, 0.45), (HOOP, 0.5, 0.95)),
        ((HOOP, 0.45, 0.5), (HOOP, 0.95, 1.0)),
        (_names("concave-gain"),),
        STANDSTILL | {"coast-asymmetry", "quadratic-drag", "input-saturation"},
        "notes: strongly concave gain, small dead zone, time constant that depends on the level",
    ),
    *(
        Case(name, _whole(search), _whole(judge), WEIGHT, _OF_SERVO, BAM, SPEED_ONLY)
        for name, search, judge in (
            ("bam, forth", FIRST_DRIVES, SECOND_DRIVES),
            ("bam, back", SECOND_DRIVES, FIRST_DRIVES),
        )
    ),
    _cut(
        "robotino, steps",
        "robotino/motor_steps_P_30ms.csv",
        0.7,
        [STANDSTILL],
        ["input-delay"],
        "notes: speed loop with P only settles short by friction, seen as a dead zone of 5.5 rad/s",
    ),
    _robot(
        "Husky",
        "husky_2023_longest",
        ["twist-limit"],
        "notes: command clipped as a body twist; 2.6 times as wide in turns",
        (0.165, 0.55),
    ),
    _robot(
        "Warthog, gravel",
        "warthog_gravel_2024_8_6_longest",
        [],
        "notes: 1.71 times as wide in turns; delay, partly a rate limit, coupling",
        (0.30, 1.08),
    ),
    _robot(
        "Warthog, slow asphalt",
        "warthog_asphalt_slow_2024_8_8_longest",
        [],
        "notes: 1.80 times as wide in turns; wheels that start only after seconds",
        (0.30, 1.08),
    ),
    _cut("dryer", "dryer/dryer.csv", 0.5, [], [], "practically linear: a negative control"),
    _cut(
        "motor_generator",
        "motor_generator/decim500.csv",
        0.5,
        [],
        ["coast-asymmetry"],
        "two-level command: a dead zone cannot be seen",
        sysid.ReadOptions(ts=1.0),
    ),
    _cut(
        "winding",
        "winding/winding.csv",
        0.5,
        [],
        [],
        "mostly linear; two of five inputs are given, the others disturb",
        sysid.ReadOptions(inputs=("u1", "u5"), outputs=("y1_tension", "y2_tension")),
    ),
    _cut(
        "cdplayer_arm",
        "cdplayer_arm/cdplayer.csv",
        0.5,
        [],
        [],
        "lightly damped, linear",
        sysid.ReadOptions(ts=1.0),
    ),
    _cut("ballbeam", "ballbeam/ballbeam.csv", 0.5, [], [], "a double integrator"),
    Case(
        "cascaded_tanks",
        (("cascaded_tanks/est.csv", 0.0, 1.0),),
        (("cascaded_tanks/val.csv", 0.0, 1.0),),
        (),
        _names("sensor-saturation"),
        "outside the catalogue: outflow with the root of the level; it overflows at 10 V",
    ),
    Case(
        "silverbox",
        (("silverbox/snls80mv.csv", 0.35, 0.41),),
        (("silverbox/snls80mv.csv", 0.41, 0.43),),
        (),
        frozenset(),
        "outside the catalogue: a cubic spring",
        sysid.ReadOptions(ts=1 / 610.35),
    ),
    _cut(
        "mr_damper",
        "mr_damper/damper.csv",
        0.57,
        [],
        ["sensor-saturation", "input-saturation"],
        "outside the catalogue: hysteresis; the force saturates",
    ),
)


@dataclass(frozen=True)
class Found:
    """What one diagnosis said.

    Attributes:
        name: of the case.
        verdict: of the diagnosis.
        named: names in order, ties joined by ``=``.
        closed: share of the gap that is closed [%], None without one.
        heading, position: by how much the errors over two seconds shrank [%], None without a pose.
        seconds: it took.
        error: why there is no answer.
    """

    name: str
    verdict: str = ""
    named: tuple[str, ...] = ()
    closed: float | None = None
    heading: float | None = None
    position: float | None = None
    seconds: float = 0.0
    error: str = ""

    def judged(self, case: Case) -> str:
        """``right``, ``extra``, ``missing`` or ``false`` (a name where there is none)."""
        named = [frozenset(n.split("=")) - OF_SAMPLES for n in self.named]
        named = [n for n in named if n]
        known = case.may.union(*case.must)
        missed = [m for m in case.must if not any(n & m for n in named)]
        extra = [n for n in named if not n & known]
        if self.error or missed:
            return "missing" + (" and extra" if extra else "")
        if extra:
            return "extra" if case.must else "false"
        return "right"


def diagnosed(case: Case, folder: Path) -> Found:
    """One diagnosis."""
    started = time.perf_counter()
    try:
        search, judge = (
            [_part(folder, p, case.read) for p in parts] for parts in (case.search, case.judge)
        )
        lengths = None if case.geometry is None else Geometry(*case.geometry)
        answer = sysid.diagnose(search, judge, geometry=lengths).to_json()
    except SysidError as error:
        return Found(case.name, seconds=time.perf_counter() - started, error=str(error))
    channels = answer["gap"]["channels"]
    return Found(
        case.name,
        answer["verdict"],
        tuple("=".join((e["id"], *e["indistinguishable"])) for e in answer["effects"]),
        answer["gap"]["closed_percent"],
        _shrunk(channels, "psi") if "psi" in channels else None,
        _shrunk(channels, "x", "y") if "x" in channels else None,
        time.perf_counter() - started,
    )


def _part(folder: Path, part: Part, read: sysid.ReadOptions) -> Record:
    file, low, high = part
    whole = sysid.read_log(folder / file, read)
    return whole.rows(round(low * len(whole)), round(high * len(whole)))


def _shrunk(channels: dict[str, dict[str, float]], *names: str) -> float:
    """By how much the error of these channels together shrank [%]."""
    before, after = (
        hypot(*(channels[n][f"rmse_{when}"] for n in names)) for when in ("before", "after")
    )
    return 100.0 * (1.0 - after / before)


def report(found: Sequence[tuple[Case, Found]]) -> str:
    """The page."""
    verdicts = [f.judged(c) for c, f in found]
    rows = [
        [
            c.name,
            ", ".join(" or ".join(f"`{n}`" for n in sorted(m)) for m in c.must) or "none",
            f.error or ", ".join(f"`{n}`" for n in f.named) or f.verdict,
            verdict,
            *("–" if v is None else f"{v:.0f}" for v in (f.closed, f.heading, f.position)),
            f"{f.seconds:.0f}",
            c.source,
        ]
        for (c, f), verdict in zip(found, verdicts, strict=True)
    ]
    headers = ["record", "has to be named", "named", "judged", "gap closed [%]"]
    headers += ["heading error less [%]", "position error less [%]", "seconds", "why"]
    counts = ", ".join(f"{v} {verdicts.count(v)}" for v in sorted(set(verdicts)))
    return HEAD.format(n=len(found), counts=counts) + table(headers, rows, "llllrrrrl") + "\n"


HEAD = """# What `diagnose` names on measured records

{n} records whose physics is known from their notes or
publications. A part of each is searched, another judges. **{counts}.**

*Right*: of every set in the second column one is named, and nothing that the notes do not tell of;
*extra*: a further name besides; *missing*: one of the sets is not; *false*: a name where there is
none to give. Coarse, held and lost readings are matters of the log and count as neither. Heading
and position: error over two seconds on the part that judges, by the wheel speeds measured. The
drive of the Robotino with three wheels has no entry: its body twist goes through kinematics that no
effect of the catalogue is about. What is said "in the record" was looked up there by other means
after a first run had named it; the rest was written before.

"""


def one(name: str) -> dict[str, Any]:
    """The diagnosis of a record as JSON."""
    folder = data_folder()
    assert folder is not None
    return asdict(diagnosed(next(c for c in CASES if c.name == name), folder))


def main() -> int:
    """Diagnose the records and write the page; 1 if there are none."""
    asked = STUDY.asked(__doc__)
    if data_folder() is None:
        print("no folder of measured records; set SYSID_DATA", file=sys.stderr)
        return 1
    found = finished(one, {c.name: (c.name,) for c in CASES}, asked)
    judged = [(c, Found(**restored(found[c.name]))) for c in CASES if c.name in found]
    STUDY.write(asked, report(judged), "none")
    return 0


if __name__ == "__main__":
    sys.exit(main())
