"""Do the bands of a look hold the truth?

Each log is of another plant: one to three poles drawn at random, real or a pair, a dead time; noise
of 2 to 20 % of the output, white or coloured; an input of random levels, held 1 to 5 samples. The
truth is the plant's own pulse response and e^{iω}. Counted are the lags up to where the truth has
decayed, its sums, and frequencies. What stands on one log is correlated, so a log is one
observation of a share, and ± is 1.96 standard errors over logs.
"""

from argparse import Namespace

import numpy as np
from scipy.signal import freqz, lfilter

from studies.runner import Study, finished, seeds
from sysid.data.excitation import multisine
from sysid.data.record import Record
from sysid.estimation.look.frequency import (
    FrequencyEstimate,
    blackman_tukey,
    local_models,
    periodic,
    welch,
)
from sysid.estimation.look.impulse import KERNELS, impulse_response
from sysid.report.markdown import table

Array = np.ndarray
COLOURS = {"white": [1.0], "coloured": [1.0, -0.8]}
SAMPLES, LAGS, DT = 800, 60, 0.05
STUDY = Study("look", "look.md", runs=100, first=1000)  # seeds below 100 chose the usual kernel

INTRODUCTION = f"""# A look: do the bands hold the truth?

Logs of {SAMPLES} samples, each of another plant of one to three poles with a dead time; 2 to 20 %
of the output are noise, white or of first order with a pole at 0.8. ± is 1.96 standard errors over
logs: what stands on one log is correlated.
"""


LOCAL = """
## Local polynomials and rational functions

Logs as above, and of one or two resonances (pole radius 0.97 to 0.998: most are narrower than a
window). Error: size of Ĝ − G over that of G at all frequencies, median and middle half of the logs.
Either: by frequency that of both which errs less at lines left out of its fit. Its numbers were
chosen on other logs (300 of another generator, seeds 0 to 11 of this one).
"""


def plant(rng: np.random.Generator) -> tuple[Array, Array]:
    """b and a of a stable plant of unit peak gain whose response lasts 5 to 50 samples."""
    radius = rng.uniform(0.5, 0.93)
    if rng.random() < 0.5:
        turn = rng.uniform(0.1, 1.2)
        poles = radius * np.exp(1j * np.array([turn, -turn]))
    else:
        poles = radius * rng.uniform(0.3, 1.0, int(rng.integers(1, 4)))
    a = np.real(np.poly(poles))
    b = np.concatenate([np.zeros(int(rng.integers(1, 5))), rng.standard_normal(2)])
    return b / np.max(np.abs(freqz(b, a)[1])), a


def logged(
    b: Array,
    a: Array,
    colour: list[float],
    rng: np.random.Generator,
    u: Array | None = None,
    samples: int = SAMPLES,
) -> Record:
    """A record that begins in motion."""
    run_in = 300
    if u is None:
        hold = int(rng.integers(1, 6))
        u = np.repeat(rng.standard_normal((samples + run_in) // hold + 1), hold)
        u = u[: samples + run_in]
    y = lfilter(b, a, u)
    noise = lfilter([1.0], colour, rng.standard_normal(len(u)))
    share = np.exp(rng.uniform(np.log(0.02), np.log(0.2)))
    y = y + share * np.std(y) * noise / np.std(noise)
    return Record(u[run_in:, None], y[run_in:, None], DT)


def responses(seed: int, colour: str) -> dict[str, tuple[float, int]]:
    """Share inside and number of places, by what is shown."""
    rng = np.random.default_rng((seed, len(colour)))
    b, a = plant(rng)
    r = logged(b, a, COLOURS[colour], rng)
    truth = lfilter(b, a, np.eye(1, LAGS)[0])
    kept = np.abs(truth) > 1e-3 * np.max(np.abs(truth))
    found: dict[str, tuple[float, int]] = {}
    for kernel in KERNELS:
        g = impulse_response([r], 0, LAGS, kernel)
        name = f"impulse response, {kernel}"
        inside = np.abs(g.g[:, 0] - truth) < 1.96 * g.error[:, 0]
        found[name] = float(np.mean(inside[kept])), int(kept.sum())
        steps = np.abs(g.step[:, 0] - np.cumsum(truth)) < 1.96 * g.step_error[:, 0]
        found[name.replace("impulse", "step")] = float(np.mean(steps)), LAGS
    for name, method in (
        ("local models", local_models),
        ("Welch", welch),
        ("Blackman–Tukey", blackman_tukey),
    ):
        found[name] = of_frequencies(method([r]), b, a)
    period = multisine(12.8, DT, 15000.0, (0.0, 8.0), seed, ("u",), odd=True).excited[:, 0]
    u = np.tile(period / 15000.0, 9)
    by_period = periodic([logged(b, a, COLOURS[colour], rng, u)])
    assert by_period is not None
    found["periods of a multisine"] = of_frequencies(by_period, b, a)
    return found


def resonant(rng: np.random.Generator) -> tuple[Array, Array]:
    """b and a of one or two resonances of damping 0.1 to 10 %, of unit peak gain."""
    poles = []
    for _ in range(int(rng.integers(1, 3))):
        radius = 1.0 - np.exp(rng.uniform(np.log(0.002), np.log(0.03)))
        poles.append(radius * np.exp(1j * rng.uniform(0.15, 2.2)))
    a = np.real(np.poly([*poles, *np.conj(poles)]))
    b = np.concatenate([np.zeros(int(rng.integers(1, 5))), rng.standard_normal(2)])
    return b / np.max(np.abs(freqz(b, a, 4096)[1])), a


def local(seed: int, kind: str, samples: int) -> dict[str, tuple[float, float]]:
    """Size of the error over that of the response, and share inside, of two local estimates."""
    rng = np.random.default_rng((seed, samples, len(kind)))
    b, a = resonant(rng) if kind == "resonances" else plant(rng)
    r = logged(b, a, COLOURS["white" if seed % 2 else "coloured"], rng, samples=samples)
    found = {}
    for name, rational in (("polynomials", False), ("either", True)):
        f = local_models([r], rational)
        truth = freqz(b, a, f.w * DT)[1]
        known = np.isfinite(f.error[:, 0, 0])
        gone = np.linalg.norm((f.value[:, 0, 0] - truth)[known]) / np.linalg.norm(truth[known])
        found[name] = float(gone), of_frequencies(f, b, a)[0]
    return found


def of_frequencies(f: FrequencyEstimate, b: Array, a: Array) -> tuple[float, int]:
    """Share of the 95 % circles that hold the truth."""
    known = np.isfinite(f.error[:, 0, 0])
    truth = freqz(b, a, f.w * DT)[1]
    inside = np.abs(f.value[:, 0, 0] - truth) < f.radius[:, 0, 0]
    return float(np.mean(inside[known])), int(known.sum())


def local_table(asked: Namespace) -> str:
    """Local polynomials alone, and beside rational functions."""
    kinds = [(kind, n) for kind in ("resonances", "plain") for n in (800, 3000)]
    wanted = {
        f"local, {kind}, {n}, {seed}": (seed, kind, n) for kind, n in kinds for seed in seeds(asked)
    }
    done = finished(local, wanted, asked)
    rows = []
    for kind, n in kinds:
        every = [found for key, found in done.items() if key.startswith(f"local, {kind}, {n},")]
        for name in every[0] if every else ():
            errors, shares = np.array([e[name] for e in every]).T
            spread = 1.96 * float(np.std(shares)) / np.sqrt(len(shares))
            inside = f"{100 * shares.mean():.1f} ± {100 * spread:.1f} %"
            low, middle, high = np.percentile(100 * errors, (25, 50, 75))
            cells = (kind, str(n), name, f"{middle:.2g} % ({low:.2g} to {high:.2g} %)", inside)
            rows.append(cells)
    return table(("plant", "samples", "local models", "error", "inside its 95 % band"), rows)


def main() -> None:
    """Run the study and write its page."""
    asked = STUDY.asked(__doc__)
    wanted = {f"{c}, {seed}": (seed, c) for c in COLOURS for seed in seeds(asked)}
    done = finished(responses, wanted, asked)
    rows = []
    for colour in COLOURS:
        every = [found for key, found in done.items() if key.startswith(f"{colour},")]
        for name in every[0] if every else ():
            shares = np.array([e[name][0] for e in every])
            spread = 1.96 * float(np.std(shares)) / np.sqrt(len(shares))
            share = f"{100 * shares.mean():.1f} ± {100 * spread:.1f} %"
            rows.append((name, colour, share, str(sum(e[name][1] for e in every))))
    heads = ("shown", "noise", "inside its 95 % band", "places")
    text = f"{INTRODUCTION}\n{table(heads, rows)}\n{LOCAL}\n{local_table(asked)}"
    STUDY.write(asked, text)


if __name__ == "__main__":
    main()
