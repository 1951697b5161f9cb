"""Train the networks of control kind ``neural`` on the best of the other laws; by hand.

    python -m studies.train_neural_control

writes ``sysid/robot/mission/control/neural.json``. The law with the smallest tracking error over a
family of robots that differ from the identified one drives them again; the network learns which
command it gives to what it sees, the integral of the error beside it. The same seed gives the same
file.
"""

import json
import re
from pathlib import Path

import numpy as np

from studies.compensated_robots import FAMILY, PERIOD, family_rms, family_runs
from sysid.data.record import Array
from sysid.robot.mission.control.neural import features
from sysid.robot.mission.registry import kinds, law_class

WEIGHTS = Path(__file__).parents[1] / "sysid" / "robot" / "mission" / "control" / "neural.json"
HIDDEN, SEED, DIGITS = 8, 11, 5


def teacher_of(axis: str) -> tuple[str, dict[str, float]]:
    """The kind with the smallest error, and the errors of all."""
    others = [kind for kind in kinds(f"control.{axis}") if kind != "neural"]
    errors = {k: family_rms(axis, law_class(f"control.{axis}", k)(), SEED) for k in others}
    return min(errors, key=lambda kind: errors[kind]), errors


def lessons(axis: str, kind: str) -> tuple[Array, Array]:
    """What the network hears and what the teacher commands, instant by instant."""
    heard, said = [], []
    for run in family_runs(axis, law_class(f"control.{axis}", kind)(), SEED + len(FAMILY)):
        z = 0.0
        for given, command in zip(run.given, run.command, strict=True):
            free = given.low < command < given.high
            grown = z + given.error * PERIOD / given.plant.gain
            heard.append(features(given, grown, 1.0))
            said.append(command)
            z = grown if free else z
    return np.array(heard), np.array(said)


def trained(x: Array, d: Array) -> tuple[Array, Array, float]:
    """Hidden and output weights of least squares, and the error that is left [drive]."""
    import jax
    import jax.numpy as jnp
    from scipy.optimize import minimize

    jax.config.update("jax_enable_x64", True)
    scale = x.std(axis=0)
    scale[scale == 0.0] = 1.0  # what is never heard, as the rate of a yaw rate
    rng = np.random.default_rng(SEED)
    width = 1 + x.shape[1]
    first = 0.5 * rng.normal(size=HIDDEN * width + HIDDEN + 1)

    def said(p: Array, inputs: Array) -> Array:
        hidden = p[: HIDDEN * width].reshape(HIDDEN, width)
        return p[-HIDDEN - 1] + jnp.tanh(hidden[:, 0] + inputs @ hidden[:, 1:].T) @ p[-HIDDEN:]

    # A little decay keeps what the lessons do not tell small.
    loss = jax.jit(
        jax.value_and_grad(lambda p: jnp.mean((said(p, x / scale) - d) ** 2) + 1e-6 * p @ p)
    )
    found = minimize(
        lambda p: [np.asarray(v, dtype=float) for v in loss(p)],
        first,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 2000},
    ).x
    left = float(np.sqrt(np.mean((np.asarray(said(found, x / scale)) - d) ** 2)))
    hidden = found[: HIDDEN * width].reshape(HIDDEN, width).copy()
    hidden[:, 1:] /= scale
    return hidden, found[-HIDDEN - 1 :], left


def main() -> None:
    """Both axes."""
    document = {}
    for axis in ("speed", "yaw"):
        kind, errors = teacher_of(axis)
        hidden, output, left = trained(*lessons(axis, kind))
        document[axis] = {
            "taught_by": kind,
            "left_drive": round(left, DIGITS),
            "hidden": [[float(f"{w:.{DIGITS}g}") for w in row] for row in hidden],
            "output": [float(f"{w:.{DIGITS}g}") for w in output],
        }
        print(axis, {k: round(v, 4) for k, v in errors.items()}, kind, round(left, 4))
    text = json.dumps(document, indent=1)
    lines = re.sub(r"\n {3,}(?=[-\d\]])", " ", text)  # the numbers of a unit in one line
    WEIGHTS.write_text(lines + "\n", encoding="utf-8")
    for axis in document:
        law = law_class(f"control.{axis}", "neural")()
        print(axis, "neural", round(family_rms(axis, law, SEED), 4))


if __name__ == "__main__":
    main()
