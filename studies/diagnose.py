"""Does ``sysid diagnose`` name what is hidden, and nothing where nothing is? A blind study.

Each case makes logs with ``sysid_datasets.hidden_logs`` in a folder of their own, where the truth
never is, has them diagnosed, and marks the answer (``diagnose_scores.py``). Run by hand; every draw
is seeded and the report carries no times:

    python benchmarks/study_diagnose.py [--quick] [--only dead-zone,pair] [--jobs 2]

``--results FILE`` keeps finished runs, a line of JSON each, and does not run them again.
``--adapter MODULE:FUNCTION`` has something else than the command answer.
"""

import argparse
import importlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Protocol

from diagnose_cases import Case, all_cases, chosen
from diagnose_scores import Outcome, by_effect, confusion, failures, outcome, summary
from joblib import Parallel, delayed
from sysid_datasets.effect_robot import DISTANCE, RADIUS
from sysid_datasets.hidden_logs import hide

TIMEOUT = 300.0
"""A command that has not answered by then has failed [s]."""

COMMAND = "study_diagnose:diagnose_files"

BASES = {
    "oe": ("--structure", "oe", "--orders", "nb=1 nf=1 nk=1"),
    "hw": ("--structure", "hammerstein-wiener"),
    "narx": ("--structure", "narx-wavelet"),
}
"""How the model of the clean robot is fitted."""


class Adapter(Protocol):
    """What answers: the JSON of ``sysid diagnose`` for two logs."""

    def __call__(
        self, est: Path, val: Path, *, clean: Path | None, base: str, mission: Path | None
    ) -> Mapping[str, Any]:
        """Diagnose ``est``, judged on ``val``.

        Args:
            est, val: the logs.
            clean: a log of the same robot without the effect, where a base is fitted first.
            base: structure of that base, empty for the command's own.
            mission: the mission that ``est`` drove.
        """
        ...


def diagnose_files(
    est: Path, val: Path, *, clean: Path | None = None, base: str = "", mission: Path | None = None
) -> dict[str, Any]:
    """Run the installed command; the one place that knows how it is called.

    Raises:
        RuntimeError: it failed; the message is the last line it wrote.
        ValueError: what it printed is not JSON.
    """
    workspace = ("--workspace", str(est.parent / "workspace"))
    if base and clean is not None:
        _sysid("fit", str(clean), *BASES[base], *workspace)
    options = ["--mission", str(mission)] if mission is not None else []
    if "psi" in est.read_text(encoding="utf-8").splitlines()[0]:
        options += ["--geometry", f"r={RADIUS},B={DISTANCE}"]
    answer = json.loads(
        _sysid("diagnose", str(est), "--val", str(val), *options, *workspace, "--json")
    )
    if not isinstance(answer, dict):
        raise ValueError(f"the command printed {type(answer).__name__}, not an object")
    return answer


def run(case: Case, adapter: str = COMMAND) -> Outcome:
    """One blind run: only the logs are on disk while the adapter works."""
    hidden = hide(case.request)
    with tempfile.TemporaryDirectory() as folder:
        for name, text in hidden.files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        est, val, clean, mission = (
            Path(folder) / name for name in ("est.csv", "val.csv", "clean.csv", "mission_est.yaml")
        )
        start = time.perf_counter()
        try:
            answer = _adapter(adapter)(
                est,
                val,
                clean=clean if clean.exists() else None,
                base=case.base,
                mission=mission if mission.exists() else None,
            )
            found = outcome(case, answer, hidden.truth)
        except Exception as error:  # a study goes on whatever one run does
            found = Outcome(
                case.key,
                case.group,
                case.request.noise,
                case.request.effects,
                error=f"{type(error).__name__}: {error}".splitlines()[0][:200],
            )
    return replace(found, seconds=round(time.perf_counter() - start, 3))


def study(cases: list[Case], adapter: str, jobs: int, results: Path | None) -> list[Outcome]:
    """Run the cases that are not in ``results`` yet; their outcomes in the order of the cases."""
    done = _kept(results)
    rest = [case for case in cases if case.key not in done]
    runs = Parallel(n_jobs=jobs, return_as="generator_unordered")(
        delayed(run)(case, adapter) for case in rest
    )
    for count, found in enumerate(runs, start=1):
        done[found.key] = found
        if results is not None:
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(found), ensure_ascii=False) + "\n")
        said = found.error or ", ".join("=".join(e) for e in found.entries) or found.verdict
        print(f"{count}/{len(rest)} {found.key}: {said} ({found.seconds:.1f} s)", file=sys.stderr)
    return [done[case.key] for case in cases]


def report(outcomes: list[Outcome]) -> str:
    """The page."""
    return "\n".join(
        [
            HEAD.format(runs=len(outcomes), planned=len(all_cases())),
            summary(outcomes),
            BY_EFFECT,
            by_effect(outcomes),
            CONFUSION,
            confusion(outcomes),
            "## Every run that was not right\n",
            failures(outcomes),
        ]
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report; 1 if a run had no answer."""
    parser = argparse.ArgumentParser(description="Hide effects in logs and have them diagnosed.")
    parser.add_argument("--quick", action="store_true", help="one case in ten")
    parser.add_argument("--only", default="", metavar="LIST", help="effects or groups, by commas")
    parser.add_argument("--seeds", type=int, default=5, help="per effect and noise level")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--adapter", default=COMMAND, metavar="MODULE:FUNCTION")
    parser.add_argument("--results", type=Path, metavar="FILE", help="keep finished runs here")
    parser.add_argument(
        "--finished", action="store_true", help="report on the runs in --results, run no more"
    )
    parser.add_argument("--list", action="store_true", help="print the cases and stop")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("reports/diagnose_study.md"), metavar="FILE"
    )
    options = parser.parse_args(arguments)
    try:
        cases = chosen(all_cases(options.seeds, options.quick), options.only)
    except ValueError as error:
        parser.error(str(error))
    if options.list:
        print("\n".join(case.key for case in cases))
        return 0
    if options.finished:
        done = _kept(options.results)
        planned, cases = len(cases), [case for case in cases if case.key in done]
        print(f"{len(cases)} of {planned} runs are finished")
    outcomes = study(cases, options.adapter, options.jobs, options.results)
    options.out.write_text(report(outcomes), encoding="utf-8")
    from stamps import stamped

    stamped(options.out)
    seconds = sorted(o.seconds for o in outcomes)
    print(
        f"{len(outcomes)} runs, median {seconds[len(seconds) // 2]:.1f} s, "
        f"longest {seconds[-1]:.1f} s; report in {options.out}"
    )
    return int(any(o.error for o in outcomes))


def _adapter(name: str) -> Adapter:
    module, _, function = name.partition(":")
    found: Adapter = getattr(importlib.import_module(module), function)
    return found


def _kept(results: Path | None) -> dict[str, Outcome]:
    if results is None or not results.exists():
        return {}
    kept = {}
    for line in results.read_text(encoding="utf-8").splitlines():
        fields = json.loads(line)
        fields["truth"] = tuple(fields["truth"])
        fields["entries"] = tuple(tuple(e) for e in fields["entries"])
        kept[fields["key"]] = Outcome(**fields)
    return kept


def _sysid(*arguments: str) -> str:
    """What ``sysid`` prints, run by the interpreter that runs the study."""
    program = "import sys; from sysid_cli.app import main; sys.exit(main())"
    try:
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"`sysid {arguments[0]}` took over {TIMEOUT:.0f} s") from None
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
        raise RuntimeError(f"exit {done.returncode}: {lines[-1]}")
    return done.stdout


HEAD = """# What `sysid diagnose` finds in logs that hide something

{runs} blind runs (the whole study has {planned}) of `benchmarks/study_diagnose.py` on logs of
`datasets/generate.py --effect`, whose twin shares no code with the workbench. Strengths, robots,
commands and noise (low 1 %, high 3 % of 10 rad/s) are random. A name is right when the hidden
effect stands first, alone or in a tie that is reported; a failed run is wrong in every row. Logs of
this generator were looked at while the rules of naming were set, but none of these seeds. Robots of
another kind will do somewhat worse: on a third generator, whose author had seen neither this one
nor the workbench, 70 of 72 single effects, 28 of 33 pairs, 31 of 31 logs with nothing hidden and 19
of 21 with something outside the catalogue came out right (on a second one, with older rules, 65 of
72 single effects, 10 of 15 pairs and 12 of 12). Most of what was wrong there has been mended since,
so that these two no longer judge.

One run on these seeds did change something: a load around a given model with a slow mode had been
taken for the state in which that mode began. All runs around given models were made again after
that, and those of the vehicle after a fourth generator had changed its weights. Last, the compiled
step was made faster and candidates with a gap are polished less: the runs of a single backlash were
made again, the others were not.

With the names that came later (`current-limit`, `dead-time`, `gravity-load`, further laws), and a
verdict that no longer drops a name because something remains beside it, a tenth of these runs
(`--quick`) and all outside the catalogue (`--only outside`) were made again: 44 of 44 single
effects, 5 of 5 pairs and 9 of 9 logs with nothing hidden are right; outside, 14 of 24 have no name,
6 the name of a part, 4 a wrong one.
"""

BY_EFFECT = """## By hidden effect

Right first / runs over all groups; *tied*: names in the right entry, 1 without a tie; *false*:
names that nothing hidden accounts for; *gap closed* by the command's own account, median / worst
of the runs that were right [%].
"""

CONFUSION = """## Confusion matrix

A row is what was hidden, a column what was named first; a reported tie with the truth in it counts
as the truth.
"""

if __name__ == "__main__":
    sys.exit(main())
