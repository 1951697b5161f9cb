"""The gate's judgement, on rows made up here: what passes, what fails, what is measured again."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import pytest
import scripts

pytestmark = pytest.mark.slow

gate = scripts.load("benchmarks/gate_judging.py")

LIMITS = gate.SpeedLimits(hand=1.5, ci=1.75, rounds=1, repeats=2)
ROW = "speed/made-up"
RATIO = gate.Committed(10.0, "Ten times as long.")


@dataclass
class Machine:
    """A clock that goes on only where work is done; ``loads`` slow the subject, one a call."""

    loads: Iterator[float]
    now: float = 0.0
    done: list[str] = field(default_factory=list)

    def work(self, name: str, seconds: float) -> None:
        self.done.append(name)
        self.now += seconds


def made_up(
    loads: Sequence[float], name: str = ROW, repetitions: int = 1
) -> tuple[object, Machine]:
    """A row whose subject takes 10 s times the load and whose reference takes 1 s."""
    machine = Machine(iter(loads))
    return gate.SpeedRow(
        name,
        "made up",
        lambda: machine.work("subject", 10.0 * next(machine.loads)),
        lambda: machine.work("reference", 1.0),
        lambda: machine.now,
        repetitions,
    ), machine


def judged(loads: Sequence[float], ci: bool = False, doubled: Sequence[str] = ()) -> object:
    row, _ = made_up(loads)
    (found,) = gate.measure_in_turns(
        {ROW: lambda: row}, {ROW: RATIO}, ci, doubled=doubled, limits=LIMITS
    )
    return found


@pytest.mark.parametrize(
    ("loads", "ci", "verdict", "measured"),
    [
        ([1.0], False, "OK", 1),
        ([1.49], False, "OK", 1),  # up to the limit
        ([1.51] * 3, False, "FAIL", 3),  # beyond it, however often
        ([1.51], True, "OK", 1),  # CI allows more
        ([1.76] * 3, True, "FAIL", 3),
        ([5.0, 5.0, 1.0], True, "OK", 3),  # load that goes by: the best counts
        ([5.0, 1.0], False, "OK", 2),
        ([0.7], False, "BETTER", 1),
    ],
)
def test_a_ratio_fails_beyond_its_limit_and_only_again_and_again(
    loads: Sequence[float], ci: bool, verdict: str, measured: int
) -> None:
    found = judged(loads, ci)
    assert found.verdict is gate.Verdict[verdict]
    assert found.measured == measured
    assert found.value == pytest.approx(10.0 * min(loads))


@pytest.mark.parametrize("ci", [False, True])
def test_a_doubling_of_the_work_is_caught_by_hand_and_in_ci(ci: bool) -> None:
    found = judged([1.0] * 6, ci, doubled=[ROW])
    assert found.verdict is gate.Verdict.FAIL
    assert found.value == pytest.approx(20.0)


def test_the_limits_that_are_used_leave_room_on_both_sides_of_a_doubling() -> None:
    assert 1.0 < gate.LIMITS.hand < gate.LIMITS.ci < 2.0
    assert gate.LIMITS.better < 1.0 < gate.LIMITS.repeats + 1


def test_subject_and_reference_take_turns_and_the_quickest_of_each_counts() -> None:
    row, machine = made_up([3.0, 1.0, 2.0], repetitions=3)
    times = gate.measure(row, gate.Times())
    assert machine.done == ["subject", "reference"] * 3
    assert times == gate.Times(10.0, 1.0, 1)


def test_a_short_reference_is_timed_in_bursts() -> None:
    row, machine = made_up([1.0])
    times = gate.measure(replace(row, bursts=4), gate.Times())
    assert machine.done == ["subject", *["reference"] * 4]
    assert times.ratio == pytest.approx(10.0)


def test_rows_over_the_limit_go_to_the_end_of_the_queue() -> None:
    order: list[str] = []
    rows = {
        name: lambda name=name, loads=loads: made_up(loads, name)[0]
        for name, loads in {"slow": [9.0, 9.0, 9.0], "quick": [1.0]}.items()
    }
    lines = dict.fromkeys(rows, RATIO)
    slow, quick = gate.measure_in_turns(rows, lines, True, limits=LIMITS, said=order.append)
    assert order == ["slow", "quick", "slow", "slow"]
    assert (slow.verdict, quick.verdict) == (gate.Verdict.FAIL, gate.Verdict.OK)


def test_rounds_go_over_all_rows_before_any_is_judged() -> None:
    order: list[str] = []
    rows = {name: lambda name=name: made_up([1.0] * 2, name)[0] for name in ("one", "other")}
    limits = replace(LIMITS, rounds=2)
    found = gate.measure_in_turns(
        rows, dict.fromkeys(rows, RATIO), False, limits=limits, said=order.append
    )
    assert order == ["one", "other"] * 2
    assert [j.measured for j in found] == [2, 2]


def missing() -> object:
    raise gate.Skip("no measured record here")


def test_what_cannot_be_measured_is_skipped_with_its_reason_and_fails_nothing() -> None:
    (found,) = gate.measure_in_turns({ROW: missing}, {ROW: RATIO}, False, limits=LIMITS)
    assert found.verdict is gate.Verdict.SKIP
    assert found.words == "no measured record here"


def test_a_row_without_a_committed_value_fails_at_once_and_says_what_to_do() -> None:
    row, machine = made_up([1.0])
    (found,) = gate.measure_in_turns({ROW: lambda: row}, {}, True, limits=LIMITS)
    assert found.verdict is gate.Verdict.FAIL
    assert "--update" in found.words
    assert machine.done.count("subject") == 1
    assert gate.judge_accuracy("a/b", 1.0, None).verdict is gate.Verdict.FAIL


ERROR = gate.Committed(2.0, "Rounding.", tolerance=0.01, unit="V")
FIT = gate.Committed(90.0, "Rounding.", tolerance=0.001, higher_is_better=True, unit="%")
BELOW_ZERO = gate.Committed(-4.0, "Rounding.", tolerance=0.01, higher_is_better=True)
NAMES = gate.Committed(("dead-zone",), "Names are exact.")


@pytest.mark.parametrize(
    ("committed", "value", "verdict"),
    [
        (ERROR, 2.0, "OK"),
        (ERROR, 2.019, "OK"),
        (ERROR, 2.021, "FAIL"),
        (ERROR, 1.9, "BETTER"),  # one-sided: said, and never a failure
        (ERROR, float("nan"), "FAIL"),
        (ERROR, float("inf"), "FAIL"),
        (FIT, 89.92, "OK"),
        (FIT, 89.90, "FAIL"),
        (FIT, 95.0, "BETTER"),
        (FIT, float("inf"), "FAIL"),
        (BELOW_ZERO, -4.03, "OK"),
        (BELOW_ZERO, -4.05, "FAIL"),
        (NAMES, ("dead-zone",), "OK"),
        (NAMES, ("dead-zone", "stiction"), "FAIL"),
        (NAMES, (), "FAIL"),
        (NAMES, 1.0, "FAIL"),
    ],
)
def test_an_error_fails_where_it_is_worse_than_its_tolerance(
    committed: object, value: object, verdict: str
) -> None:
    assert gate.judge_accuracy("a/b", value, committed).verdict is gate.Verdict[verdict]


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ([], ["a/one", "a/two", "b/one"]),
        (["all"], ["a/one", "a/two", "b/one"]),
        (["a"], ["a/one", "a/two"]),
        (["b/one", "a/two"], ["a/two", "b/one"]),
    ],
)
def test_rows_are_chosen_by_name_or_group(asked: list[str], found: list[str]) -> None:
    assert list(gate.chosen(asked, ["a/one", "a/two", "b/one"])) == found


def test_an_unknown_row_is_refused_and_all_are_listed() -> None:
    with pytest.raises(KeyError, match=r"no row c.*a/one, b/one"):
        gate.chosen(["c"], ["a/one", "b/one"])


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[[], object]:
    """The command and its rows, loaded as they are where it runs."""
    monkeypatch.syspath_prepend(str(scripts.ROOT / "benchmarks"))
    return scripts.load("benchmarks/gate.py")


def test_every_row_has_a_committed_line_with_a_reason_and_every_line_a_row(command: object) -> None:
    raw = json.loads(command.FILE.read_text(encoding="utf-8"))
    lines = gate.Gate.of(raw)
    accuracy = scripts.load("benchmarks/gate_rows_accuracy.py").ROWS
    speed = scripts.load("benchmarks/gate_rows_speed.py").ROWS
    assert (lines.accuracy.keys(), lines.speed.keys()) == (accuracy.keys(), speed.keys())
    for line in (*lines.accuracy.values(), *lines.speed.values()):
        assert line.reason.endswith(".")
        assert isinstance(line.value, tuple) or line.value != 0.0


def test_measured_records_that_are_missing_are_skipped(
    command: object, monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    monkeypatch.setenv("SYSID_DATA", str(tmp_path))
    rows = scripts.load("benchmarks/gate_rows_accuracy.py")
    with pytest.raises(rows.Skip, match="SYSID_DATA"):
        rows.ROWS["dryer/arx"]()


def test_the_command_ends_with_2_for_a_row_that_is_not_there(
    command: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"):
        monkeypatch.setenv(name, "1")  # so that it is put back
    assert command.main(["speed/nothing"]) == 2
    assert "there is no row speed/nothing" in capsys.readouterr().err


def test_the_command_answers_in_json_and_ends_with_1_on_failure(
    command: object,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: object,
) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"):
        monkeypatch.setenv(name, "1")
    raw = json.loads(command.FILE.read_text(encoding="utf-8"))
    assert command.main(["forward_back/arx", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["verdict"] in ("ok", gate.Verdict.BETTER.value)
    raw["accuracy"]["forward_back/arx"]["value"] = 99.0
    worse = tmp_path / "gate.json"
    worse.write_text(json.dumps(raw), encoding="utf-8")
    monkeypatch.setattr(command, "FILE", worse)
    assert command.main(["forward_back/arx"]) == 1
    assert "FAIL" in capsys.readouterr().out
    assert command.main(["--update", "forward_back/arx"]) == 0
    again = json.loads(worse.read_text(encoding="utf-8"))["accuracy"]["forward_back/arx"]
    assert again == {**raw["accuracy"]["forward_back/arx"], "value": pytest.approx(row["value"])}
