"""Chapter 7: the body that is printed for Gazebo."""

import numpy as np

from thesis.entries import Row, Sheet, compared, number

MASS = 0.82573504
SIZE = (0.19, 0.134, 0.047)
TENSOR = (2.2124416e-3, 2.1193702e-3, 2.0064271e-3)
"""Diagonal of the printed inertia [kg m²]."""


def body() -> Sheet:
    """§7.2: mass, size and inertia of one link."""
    squares = np.square(SIZE)
    box = MASS / 12.0 * (squares.sum() - squares)
    reason = "the tensor is not that of the printed box; the mesh it may be of is not printed"
    rows = (
        *(compared("§7.2", f"I_{axis} of a solid box of the printed mass and size [kg m²]", printed,
                   ours, ".3g", reason)
          for axis, printed, ours in zip(("xx", "yy", "zz"), TENSOR, box.tolist(), strict=True)),
        Row("§7.2", "may the printed tensor be a body's", "–",
            "yes" if 2 * max(TENSOR) <= sum(TENSOR) else "no", "none",
            "no moment exceeds the sum of the other two"),
        Row("§7.2", "mass [kg]", f"{MASS:.3f} of the link, 1.5 (§8.2), 1.592 (Table 5.2)",
            "1.5 in the twin", "–", "one link of several, of which the others are not printed"),
        Row("§7.2", "J of the pendulum over I_zz", "–", number(0.0652 / TENSOR[2], ".0f"), "–",
            "two printed inertias about the vertical that do not agree"),
    )  # fmt: skip
    return Sheet(rows)
