"""Marks for the answers of ``diagnose.py``: right names, false names, how much gap is closed.

A name is right when the true effect is the entry's own id or one it lists as indistinguishable: a
tie that is reported counts, a tie that is kept quiet does not.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from studies.diagnose_cases import Case
from sysid.report.markdown import table

SAMPLES_ONLY = frozenset({"quantisation", "held-telemetry", "dropouts"})
"""Found by looking at the samples: named in any place, and no gap to close."""

A_PART_IS = {
    "other-1": frozenset({"input-delay"}),
    "other-4": frozenset({"gravity-load", "speed-ripple"}),
}
"""Names that are true of a part of what is outside the catalogue: the mean of a delay that swings,
and a torque over the angle, which the catalogue did not hold when these logs were made up."""

NO_GAP = 0.1
"""Excess of squared errors over those of the noise that is none: errors within 5 % of it."""


@dataclass(frozen=True)
class Outcome:
    """What one blind run gave, against the truth.

    Attributes:
        key, group, noise: of the case.
        truth: the hidden ids.
        verdict: the command's, empty where it failed.
        entries: per named effect its id and those it cannot tell from it, in order of acceptance.
        closed: share of the gap closed by the command's own account [%], None without a gap.
        closed_true: the same from its RMSE before and after, with the floor of the truth [%].
        seconds: wall time of the run.
        error: why there is no answer, else empty.
    """

    key: str
    group: str
    noise: str
    truth: tuple[str, ...]
    verdict: str = ""
    entries: tuple[tuple[str, ...], ...] = ()
    closed: float | None = None
    closed_true: float | None = None
    seconds: float = 0.0
    error: str = ""

    @property
    def first(self) -> str:
        """The id named first; what it said instead where it named none."""
        return self.entries[0][0] if self.entries else self.verdict or "no answer"

    @property
    def right(self) -> bool:
        """Whether the hidden effect stands first, alone or in a reported tie."""
        entries = self.entries if set(self.truth) <= SAMPLES_ONLY else self.entries[:1]
        return any(t in entry for entry in entries for t in self.truth)

    @property
    def all_right(self) -> bool:
        """Whether every hidden effect is named, each by an entry of its own."""
        return matched(self.truth, self.entries) == len(self.truth)

    @property
    def false_names(self) -> int:
        """Entries that no hidden effect accounts for."""
        return len(self.entries) - matched(self.truth, self.entries)


def outcome(case: Case, answer: Mapping[str, Any], truth: Mapping[str, Any]) -> Outcome:
    """The answer of the command, checked for its keys, beside the truth.

    Raises:
        KeyError, TypeError, ValueError: the answer is not what ``sysid diagnose --json`` promises.
    """
    verdict = str(answer["verdict"])
    if verdict not in ("effects-found", "no-missing-effect", "unexplained"):
        raise ValueError(f"unknown verdict {verdict!r}")
    entries = tuple((str(e["id"]), *map(str, e["indistinguishable"])) for e in answer["effects"])
    missing = any(e["id"] not in SAMPLES_ONLY for e in answer["effects"])
    if missing != (verdict == "effects-found"):
        raise ValueError(f"verdict {verdict!r} with {len(entries)} effects")
    gap = answer.get("gap") or {}
    closed = gap.get("closed_percent")
    return Outcome(
        key=case.key,
        group=case.group,
        noise=case.request.noise,
        truth=case.request.effects,
        verdict=verdict,
        entries=entries,
        closed=None if closed is None else float(closed),
        closed_true=_closed(gap.get("channels") or {}, truth["floor"]["val"]),
    )


def summary(outcomes: Sequence[Outcome]) -> str:
    """The marks against their targets, a line each."""
    rows = []

    def line(name: str, groups: str, mark: Callable[[Outcome], bool], sense: str, aim: int) -> None:
        some = [o for o in outcomes if o.group in groups.split(",")]
        if some:
            share = 100.0 * sum(map(mark, some)) / len(some)
            met = share >= aim if sense == "≥" else share <= aim
            rows.append(
                [name, str(len(some)), f"{share:.1f} %", f"{sense} {aim} %", "yes" if met else "no"]
            )

    ones = ("single", "driving", "on hw", "on narx", "mission")
    line("one effect: right name first", ",".join(ones), lambda o: o.right, "≥", 95)
    for group in ones:
        line(f"{group}: right name first", group, lambda o: o.right, "≥", 95)
    line("pair: both named", "pair", lambda o: o.all_right, "≥", 80)
    for group, aim in _nothing_groups(outcomes):
        line(f"{group}: a false name", group, lambda o: bool(o.entries) or bool(o.error), "≤", aim)
    line("outside: no name", "outside", lambda o: not o.entries and not o.error, "≥", 80)
    line("outside: no name, or that of a part", "outside", _no_wrong_name, "≥", 80)
    for name, values in (
        ("gap closed, by its own account", [o.closed for o in _gaps(outcomes)]),
        ("gap closed, by the true floor", [o.closed_true for o in _gaps(outcomes)]),
    ):
        known = [v for v in values if v is not None]
        if known:
            for what, value, aim in (("median", median(known), 95), ("worst", min(known), 80)):
                met = "yes" if value >= aim else "no"
                rows.append(
                    [f"{name}: {what}", str(len(known)), f"{value:.1f} %", f"≥ {aim} %", met]
                )
    failed = sum(bool(o.error) for o in outcomes)
    rows.append(["runs without an answer", str(len(outcomes)), str(failed), "0", _yes(failed == 0)])
    return table(["what", "runs", "measured", "aim", "met"], rows, "lrrrc")


def by_effect(outcomes: Sequence[Outcome]) -> str:
    """Per hidden effect: right first at each noise, size of ties, false names, gap closed."""
    rows = []
    single = [o for o in outcomes if len(o.truth) == 1 and o.group != "outside"]
    for effect in dict.fromkeys(o.truth[0] for o in single):
        some = [o for o in single if o.truth[0] == effect]
        right = [o for o in some if o.right]
        gaps = [g for o in _gaps(some) for g in [o.closed] if g is not None]
        rows.append(
            [
                f"`{effect}`",
                *(_count([o for o in some if o.noise == noise]) for noise in ("low", "high")),
                _count([o for o in some if o.group == "driving"]),
                f"{sum(len(o.entries[0]) for o in right) / len(right):.1f}" if right else "–",
                str(sum(o.false_names for o in some)),
                f"{median(gaps):.0f} / {min(gaps):.0f}" if gaps else "–",
            ]
        )
    headers = [
        "effect",
        "low noise",
        "high noise",
        "of them driving",
        "tied",
        "false",
        "gap closed",
    ]
    return table(headers, rows, "lrrrrrr")


def confusion(outcomes: Sequence[Outcome]) -> str:
    """Hidden effect against what was named first; a dot is none.

    A reported tie that holds the truth counts as the truth. Columns have the numbers of the rows.
    """
    single = [o for o in outcomes if len(o.truth) <= 1]
    counts = Counter((_hidden(o), o.truth[0] if o.truth and o.right else o.first) for o in single)
    hidden = list(dict.fromkeys(_hidden(o) for o in single))
    named = [h for h in hidden if any(n == h for _, n in counts)]
    named += sorted({n for _, n in counts} - set(named))
    number = {name: str(i) for i, name in enumerate([*hidden, *_others(named, hidden)], start=1)}
    rows = [
        [number[h], f"`{h}`", *(str(counts[h, n]) if counts[h, n] else "·" for n in named)]
        for h in hidden
    ]
    others = _others(named, hidden)
    legend = "; ".join(f"{number[n]} = {n}" for n in others)
    text = table(["no.", "hidden", *(number[n] for n in named)], rows, "rl" + "r" * len(named))
    return text + (f"\nFurther columns: {legend}.\n" if others else "")


def failures(outcomes: Sequence[Outcome]) -> str:
    """Every run that is not right: what was hidden, what was said."""
    rows = []
    for o in outcomes:
        if o.error:
            said = "no answer: " + o.error
        elif _wrong(o):
            said = ", ".join("=".join(entry) for entry in o.entries) or o.verdict
        else:
            continue
        rows.append([o.key.replace("|", " "), said])
    return table(["run", "answer"], rows) if rows else "None.\n"


def _no_wrong_name(o: Outcome) -> bool:
    partly = A_PART_IS.get(o.truth[0], frozenset())
    return not o.error and all(partly & set(entry) for entry in o.entries)


def _wrong(o: Outcome) -> bool:
    if not o.truth or o.group == "outside":
        return bool(o.entries)
    return not (o.all_right if len(o.truth) > 1 else o.right) or o.false_names > 0


def matched(truth: Sequence[str], entries: Sequence[Sequence[str]]) -> int:
    """The most hidden effects that can be given an entry each (few of either: try them all)."""
    if not truth:
        return 0
    rest = matched(truth[1:], entries)
    for i, entry in enumerate(entries):
        if truth[0] in entry:
            rest = max(rest, 1 + matched(truth[1:], [*entries[:i], *entries[i + 1 :]]))
    return rest


def _closed(channels: Mapping[str, Any], floor: Mapping[str, float]) -> float | None:
    """Σ(before² − after²)/Σ(before² − floor²) over the channels whose true floor is known [%].

    None where they have no gap: what acts between tracks and ground leaves none in the wheels.
    """
    known = [(channels[c], floor[c]) for c in floor if c in channels]
    return share_closed(
        [(float(c["rmse_before"]), float(c["rmse_after"]), f) for c, f in known], NO_GAP
    )


def share_closed(errors: Sequence[tuple[float, float, float]], least: float = 0.0) -> float | None:
    """Σ(before² − after²)/Σ(before² − floor²) [%]: what the true model closes is 100 %.

    Args:
        errors: RMSE before, after, and of the true model, of each channel.
        least: gap over the squares of the floor beyond which there is one; None without.
    """
    noise = sum(floor**2 for *_, floor in errors)
    gap = sum(before**2 for before, *_ in errors) - noise
    gone = sum(before**2 - after**2 for before, after, _ in errors)
    return 100.0 * gone / gap if gap > least * noise else None


def _gaps(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Runs in which the hidden effect was named and leaves a gap in the motion."""
    return [
        o
        for o in outcomes
        if o.truth
        and o.group != "outside"
        and (o.all_right if len(o.truth) > 1 else o.right)
        and not set(o.truth) <= SAMPLES_ONLY
    ]


def _nothing_groups(outcomes: Sequence[Outcome]) -> list[tuple[str, int]]:
    groups = dict.fromkeys(o.group for o in outcomes if o.group.startswith("nothing"))
    return [(g, 15 if g == "nothing closed" else 5) for g in groups]


def _others(named: Sequence[str], hidden: Sequence[str]) -> list[str]:
    return [n for n in named if n not in hidden]


def _hidden(o: Outcome) -> str:
    return o.truth[0] if o.truth else o.group


def _count(some: Sequence[Outcome]) -> str:
    return f"{sum(o.right for o in some)}/{len(some)}" if some else "–"


def _yes(met: bool) -> str:
    return "yes" if met else "no"
