"""The cases of ``diagnose.py``: what is hidden, in what log, and what the command gets."""

from dataclasses import dataclass, replace

from sysid_datasets.hidden_effects import RANGES, needs_pose
from sysid_datasets.hidden_logs import Request
from sysid_datasets.outside_effects import OUTSIDE

DESIGNED = ("steps", "prbs")
NOISES = ("low", "high")

PAIRS = (
    ("dead-zone", "battery-discharge"),
    ("dead-zone", "sensor-saturation"),
    ("dead-zone", "direction-asymmetry"),
    ("dead-zone", "cross-coupling"),
    ("input-saturation", "input-delay"),
    ("input-saturation", "unsigned-speed"),
    ("input-delay", "coulomb-friction"),
    ("input-delay", "thermal-fade"),
    ("rate-limit", "sensor-bias"),
    ("rate-limit", "quadratic-drag"),
    ("supply-sag", "input-delay"),
    ("battery-discharge", "backlash"),
    ("concave-gain", "cross-coupling"),
    ("direction-asymmetry", "backlash"),
    ("coulomb-friction", "cross-coupling"),
    ("coulomb-friction", "sensor-saturation"),
    ("coulomb-friction", "viscous-asymmetry"),
    ("stiction", "supply-sag"),
    ("stiction", "sensor-lag"),
    ("load-bias", "input-saturation"),
    ("coast-asymmetry", "sensor-bias"),
    ("freewheel", "sensor-saturation"),
    ("speed-ripple", "dead-zone"),
    ("actuator-lag", "load-bias"),
    ("coulomb-friction", "inertial-coupling"),
    ("inertial-coupling", "input-saturation"),
)
"""Effects that change different places of the chain, so that both can be told."""

ON_OTHER_BASES = (
    "dead-zone",
    "input-delay",
    "coulomb-friction",
    "cross-coupling",
    "load-bias",
    "sensor-saturation",
)
"""Effects that come on top of a Hammerstein-Wiener or NARX model of the clean robot."""

FRESH = 5000
"""Seeds from here on were never looked at while rules were set; those below it were."""

NOTHING = ("white", "ar", "walk", "closed")
"""The kinds of log in which nothing is hidden."""


@dataclass(frozen=True)
class Case:
    """One blind run.

    Attributes:
        group: row of the summary.
        request: what the generator is asked for.
        base: structure of the model fitted to the clean log beforehand; empty without one.
    """

    group: str
    request: Request
    base: str = ""

    @property
    def key(self) -> str:
        """Unique and stable: what a finished run is found again by."""
        r = self.request
        loop = "closed" if r.closed_loop else "open"
        what = "+".join(r.effects) or "none"
        return (
            f"{self.group}|{what}|{r.style}|{r.noise}|{r.disturbance}|{loop}|{self.base}|{r.seed}"
        )


def all_cases(seeds: int = 5, quick: bool = False, shift: int = FRESH) -> list[Case]:
    """Every case of the study; ``quick`` keeps one in about ten, every effect among them.

    Args:
        seeds: runs for each effect and noise level.
        quick: one run for each effect at low noise, and a few of each other group.
        shift: added to every seed.
    """
    seeds, noises = (1, NOISES[:1]) if quick else (seeds, NOISES)
    cases = [
        Case("single", _request(effect, seed, noise, DESIGNED[seed % 2]), _base_of(effect))
        for effect in RANGES
        for noise in noises
        for seed in range(1, seeds + 1)
    ]
    driven = [e for e in RANGES if not needs_pose((e,))]
    cases += [
        Case("driving", _request(effect, 101 + i, NOISES[i % 2], "driving"), _base_of(effect))
        for effect in (driven[::5] if quick else driven)
        for i in range(1 if quick else 2)
    ]
    cases += [
        Case("pair", _request(",".join(pair), 201 + i, NOISES[i % 2], DESIGNED[i // 2 % 2]))
        for i, pair in enumerate(PAIRS[::6] if quick else PAIRS)
    ]
    for kind in NOTHING:
        cases += [_nothing(kind, i) for i in range(2 if quick else 20)]
    cases += [
        Case("outside", _request(effect, 501 + i, NOISES[i % 2], (*DESIGNED, "driving")[i % 3]))
        for effect in OUTSIDE
        for i in range(1 if quick else 3)
    ]
    cases += [
        Case(f"on {base}", _request(effect, 601 + i, NOISES[i % 2], DESIGNED[0], clean=True), base)
        for base in ("hw", "narx")
        for i, effect in enumerate(ON_OTHER_BASES[:1] if quick else ON_OTHER_BASES)
    ]
    for effect in ("track-slip", "radius-mismatch", "track-width"):
        cases += [_mission(effect, i) for i in range(1 if quick else 4)]
    cases += [_mission("", i) for i in range(1 if quick else 6)]
    return [replace(c, request=replace(c.request, seed=c.request.seed + shift)) for c in cases]


def _request(effects: str, seed: int, noise: str, style: str, clean: bool = False) -> Request:
    return Request(
        effects=tuple(e for e in effects.split(",") if e),
        seed=seed,
        noise=noise,
        style=style,
        clean=clean,
    )


def _base_of(effect: str) -> str:
    """A changed parameter needs the model whose parameter has changed."""
    return "oe" if effect == "changed-parameter" else ""


def _nothing(kind: str, i: int) -> Case:
    closed = kind == "closed"
    return Case(
        f"nothing {kind}",
        Request(
            seed=301 + i,
            noise=NOISES[i % 2],
            style=("steps", "prbs", "multisine", "driving", "pulses")[i % 5],
            # Of the closed loops a third each has white, coloured and walking disturbances.
            disturbance=NOTHING[i % 3] if closed else kind,
            closed_loop=closed,
        ),
    )


def _mission(effect: str, i: int) -> Case:
    request = Request(
        effects=(effect,) if effect else (),
        seed=701 + i,
        noise=NOISES[i % 2],
        rate=10.0,
        mission=True,
    )
    return Case("mission" if effect else "nothing mission", request)
