"""The generator of hidden effects, its catalogue and its files."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hidden_effect_cases import DT, Array
from sysid_datasets import generate
from sysid_datasets.driving import STYLES
from sysid_datasets.effect_robot import PWM_FULL
from sysid_datasets.hidden_effects import KNOWN, RANGES, SIDES, needs_pose, plain_robot, with_effect
from sysid_datasets.hidden_logs import AR_POLE, NOISE, TYPICAL_SPEED, Request, hide, plain_fit
from sysid_datasets.outside_effects import OUTSIDE


def columns(text: str) -> dict[str, Array]:
    header, *rows = text.strip().split("\n")
    values = np.array([[float(v) for v in row.split(",")] for row in rows])
    return dict(zip(header.split(","), values.T, strict=True))


SHORT = Request(duration=20.0, seed=4)


def asked(effect: str, **changes: object) -> Request:
    return replace(SHORT, effects=() if effect == "none" else (effect,), **changes)  # type: ignore[arg-type]


@cache
def nothing_hidden() -> dict[str, str]:
    return hide(SHORT).files


# ------------------ the catalogue


@pytest.mark.slow
@pytest.mark.parametrize("effect", KNOWN[1:])
def test_an_effect_shows_at_its_strength_and_is_gone_at_none(effect: str) -> None:
    hidden = hide(asked(effect))
    (told,) = hidden.truth["effects"]  # type: ignore[misc]
    excess = hidden.truth["excess"]["est"]  # type: ignore[index]
    low = NOISE["low"] * TYPICAL_SPEED
    if told["stage"] == "vehicle":
        assert max(excess["turn"], excess["way"]) > 0.01
    else:
        assert max(excess[c] for c in told["channels"]) > 1.5 * low
    gone = hide(asked(effect, strength=0.0)).files
    nothing = nothing_hidden()
    for name in ("est.csv", "val.csv"):
        null, plain = columns(gone[name]), columns(nothing[name])
        assert hidden.files[name] != gone[name]
        for column in plain:
            np.testing.assert_array_equal(null[column], plain[column], err_msg=column)


@pytest.mark.parametrize("effect", sorted(RANGES))
def test_strengths_lie_in_the_documented_table(effect: str) -> None:
    seen = set()
    for seed in range(12):
        _, told = with_effect(plain_robot(seed), effect, seed, 1.0, DT, 100.0)
        for values in told["parameters"].values():  # type: ignore[attr-defined]
            for r in RANGES[effect].ranges:
                if r.field not in values:
                    continue  # one of several was picked
                x = values[r.field] / {"": 1.0, "sample": DT, "log": 0.01}[r.per]
                if r.mirror == "sign":
                    x = abs(x)
                elif r.mirror == "inverse" and (x - 1.0) * (r.low - 1.0) < 0.0:
                    x = 1.0 / x
                # The tracks are 8 % apart from the drawn value at most.
                assert 0.9 * min(r.low, x * 2) <= x <= 1.1 * r.high
                seen.add(round(values[r.field], 9))
    # a speed without its sign has no strength: the two numbers of its table stand still
    assert len(seen) == 2 if effect == "unsigned-speed" else len(seen) >= 10


def test_nothing_hidden_is_a_linear_first_order_robot_and_white_noise() -> None:
    hidden = hide(replace(SHORT, duration=120.0))
    log, base = columns(hidden.files["est.csv"]), hidden.truth["base"]
    for i, side in enumerate(SIDES):
        pwm = log["pwm_" + side[-1]]
        gain, tau, error = plain_fit(pwm, log[side], DT)
        truth = base[side]  # type: ignore[index]
        assert gain == pytest.approx(truth["K"], rel=0.01)
        assert tau == pytest.approx(truth["tau"], rel=0.02)
        # 4 standard errors of a standard deviation, 1/sqrt(2 N).
        assert error == pytest.approx(0.1, rel=4.0 / math.sqrt(2.0 * len(pwm))), i
        residual = log[side] - _first_order(pwm, truth["K"], truth["tau"])
        lag = np.corrcoef(residual[:-1], residual[1:])[0, 1]
        assert abs(lag) < 4.0 / math.sqrt(len(residual))


def _first_order(pwm: Array, gain: float, tau: float) -> Array:
    a, state, out = math.exp(-DT / tau), 0.0, []
    for d in (pwm / PWM_FULL).tolist():
        out.append(state)
        state = a * state + (1.0 - a) * gain * d
    return np.array(out)


@pytest.mark.slow
def test_the_disturbances_are_what_their_names_say() -> None:
    for disturbance in ("white", "ar", "walk"):
        request = replace(SHORT, duration=90.0, disturbance=disturbance)
        hidden = hide(request)
        log, base = columns(hidden.files["est.csv"]), hidden.truth["base"]
        rest = np.column_stack(
            [_residual(log, side, base[side]) for side in SIDES]  # type: ignore[index]
        )
        lags = [np.corrcoef(rest[:-1, i], rest[1:, i])[0, 1] for i in (0, 1)]
        if disturbance == "white":
            # 4/sqrt(1800)
            assert np.abs(lags).max() < 0.1
        elif disturbance == "ar":
            # 4 standard errors of an AR(1) coefficient, sqrt((1 − a²)/N).
            assert lags == pytest.approx([AR_POLE] * 2, abs=4.0 * math.sqrt(0.19 / len(rest)))
        else:
            quarter = len(rest) // 4
            early, late = rest[:quarter].mean(axis=0), rest[-quarter:].mean(axis=0)
            assert np.abs(late - early).max() > 0.1
        floor = hidden.truth["floor"]["est"]  # type: ignore[index]
        measured = np.sqrt(np.mean(rest**2, axis=0))
        np.testing.assert_allclose(measured, [floor[side] for side in SIDES], rtol=1e-3)


def _residual(log: dict[str, Array], side: str, base: dict[str, float]) -> Array:
    return log[side] - _first_order(log["pwm_" + side[-1]], base["K"], base["tau"])


def test_a_closed_loop_feeds_the_noise_back() -> None:
    for closed in (False, True):
        quiet, loud = (
            columns(hide(replace(SHORT, closed_loop=closed, noise=n)).files["est.csv"])
            for n in ("low", "high")
        )
        change = loud["pwm_l"] - quiet["pwm_l"]
        if not closed:
            assert not change.any()
            continue
        base = hide(SHORT).truth["base"]["omega_l"]  # type: ignore[index]
        noise = _residual(loud, "omega_l", base)
        # The loop changes the commands, not the robot: the rest is still the sensor's noise.
        assert noise.std() == pytest.approx(0.3, rel=4.0 / math.sqrt(2.0 * len(noise)))
        # P acts on the reading at once and against it; I and the answer to it blur the rest.
        assert np.corrcoef(noise, change)[0, 1] < -0.5


# ------------------ the files


def test_the_same_arguments_give_the_same_bytes(tmp_path: Path) -> None:
    arguments = ["--effect", "backlash,track-slip", "--seed", "7", "--noise", "high"]
    arguments += ["--style", "driving", "--duration", "20", "--rate", "10"]
    for name in ("a", "b", "c"):
        other = ["--seed", "8"] if name == "c" else []
        assert generate.main([*arguments, *other, "-o", str(tmp_path / name)]) == 0
    names = ("est.csv", "val.csv", "truth/truth.json")
    first, again, other_seed = (
        [(tmp_path / d / n).read_bytes() for n in names] for d in ("a", "b", "c")
    )
    assert first == again
    assert all(x != y for x, y in zip(first, other_seed, strict=True))


def test_the_truth_tells_all_and_the_logs_nothing(tmp_path: Path) -> None:
    arguments = ["--effect", "load-bias,track-slip", "--duration", "20", "-o", str(tmp_path)]
    assert generate.main(arguments) == 0
    truth = json.loads((tmp_path / "truth" / "truth.json").read_text(encoding="utf-8"))
    assert [(e["id"], e["stage"]) for e in truth["effects"]] == [
        ("load-bias", "motor"),
        ("track-slip", "vehicle"),
    ]
    assert truth["effects"][1]["channels"] == ["x", "y", "psi"]
    assert 0.05 <= truth["effects"][1]["parameters"]["robot"]["slip"] <= 0.35
    side = truth["effects"][0]["channels"][0]
    assert 0.9 <= abs(truth["effects"][0]["parameters"][side]["load"]) <= 3.3
    assert truth["noise_sigma"] == {
        "omega_l": 0.1, "omega_r": 0.1, "x": 0.001, "y": 0.001, "psi": 0.002,
    }  # fmt: skip
    assert truth["floor"]["est"][side] == pytest.approx(0.1, rel=0.2)
    assert set(truth["base"][side]) == {"K", "tau"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["est.csv", "truth", "val.csv"]
    for name in ("est.csv", "val.csv"):
        text = (tmp_path / name).read_text(encoding="ascii")
        assert text.startswith("t,pwm_l,pwm_r,omega_l,omega_r,x,y,psi\n0,0,0,")
        assert "load" not in text
    lengths = [len(columns((tmp_path / n).read_text())["t"]) for n in ("est.csv", "val.csv")]
    assert lengths == [400, 240]


def test_a_changed_parameter_comes_with_the_log_it_changed_from() -> None:
    hidden = hide(asked("changed-parameter"))
    assert set(hidden.files) == {"est.csv", "val.csv", "clean.csv"}
    (told,) = hidden.truth["effects"]  # type: ignore[misc]
    base = hidden.truth["base"]
    for side in SIDES:
        changed = told["parameters"].get(side, {})
        for name, factor in (("est.csv", changed), ("clean.csv", {})):
            log = columns(hidden.files[name])
            gain, tau, _ = plain_fit(log["pwm_" + side[-1]], log[side], DT)
            k = base[side]["K"] * factor.get("gain_factor", 1.0)  # type: ignore[index]
            slow = base[side]["tau"] * factor.get("time_constant_factor", 1.0)  # type: ignore[index]
            # Standard errors at 40 s and 1 % of noise are below 0.2 % of K and 0.7 % of τ.
            assert gain == pytest.approx(k, rel=0.01)
            assert tau == pytest.approx(slow, rel=0.03)


def test_a_mission_ends_at_its_goal_and_misses_it_with_slip(tmp_path: Path) -> None:
    ends = {}
    for effect in ("none", "track-slip"):
        out = tmp_path / effect
        arguments = ["--effect", effect, "--mission", "--seed", "2", "--strength", "2"]
        arguments += ["-o", str(out)]
        assert generate.main(arguments) == 0
        log = columns((out / "est.csv").read_text())
        assert log["t"][1] == 0.1
        x, y = (
            float(v)
            for v in (out / "mission_est.yaml").read_text().split("[")[1].split("]")[0].split(",")
        )
        ends[effect] = math.hypot(log["x"][-1] - x, log["y"][-1] - y)
    # Arrived is within 0.1 m by odometry, which drifts by the noise of the encoders.
    assert ends["none"] < 0.15
    assert ends["track-slip"] > 2.0 * ends["none"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--effect", "dead-zne"],
        ["--effect", "dead-zone,dead-zone"],
        ["--effect", "none", "--rate", "0.1"],
        ["--effect", "none", "--duration", "1"],
        ["--effect", "none", "--seed", "-1"],
        ["--effect", "none", "--style", "waltz"],
    ],
)
def test_impossible_requests_are_refused(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        generate.main([*arguments, "-o", str(tmp_path)])
    assert ended.value.code == 2
    assert "error: " in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("style", sorted(STYLES))
def test_every_style_rests_reverses_and_uses_the_range(style: str) -> None:
    pwm = STYLES[style](np.random.default_rng(2), 1200, DT)
    assert pwm.shape == (1200, 2)
    assert not pwm[:20].any()
    for track in pwm.T:
        assert 15000 < np.abs(track).max() <= PWM_FULL
        assert min(np.mean(track > 1000), np.mean(track < -1000)) > 0.2
        assert np.mean(np.abs(track[20:]) < 600) > 0.01
    # Collinear tracks could not tell what one does to the other.
    assert abs(np.corrcoef(pwm.T)[0, 1]) < 0.8


def test_the_catalogue_is_complete() -> None:
    stages: dict[str, int] = {}
    for hidden in RANGES.values():
        stages[hidden.stage] = stages.get(hidden.stage, 0) + 1
    assert stages == {"actuator": 11, "motor": 12, "vehicle": 3, "sensor": 6, "any": 1}
    assert len(OUTSIDE) >= 5
    page = Path(generate.__file__).with_name("README.md").read_text(encoding="utf-8")
    rows = {line.split("`")[1]: line for line in page.splitlines() if line.startswith("| `")}
    for effect in KNOWN[1:]:
        ranges = RANGES[effect].ranges if effect in RANGES else ()
        for r in ranges:
            assert f"`{r.field}`" in rows[effect]
            if r.kind != "either":
                assert f"{r.low:g}" in rows[effect]
                assert f"{r.high:g}" in rows[effect]
        if effect in OUTSIDE:
            low, high = OUTSIDE[effect][1]
            assert f"`size` {low:g} … {high:g}" in rows[effect]
    assert [e for e in KNOWN if needs_pose((e,))] == [
        "track-slip",
        "radius-mismatch",
        "track-width",
    ]
