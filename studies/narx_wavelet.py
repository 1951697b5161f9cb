"""How far NARX networks get on the measured records: orders and options chosen on training data."""

from studies.attempts import Attempt, run
from studies.runner import Study

STUDY = Study("narx_wavelet", "narx_wavelet.md", jobs=1)

ATTEMPTS = (
    *(
        Attempt(name, "narx-wavelet")
        for name in ("tanks", "generator", "tacho", "damper", "ced-low", "ced-high")
    ),
    Attempt("silverbox", "narx-wavelet", "na=3 nb=3 nk=0", {"units": "0", "degree": "3"}),
    Attempt("hoop", "narx-wavelet", "na=2 nb=2 nk=0", {"network": "pairs", "degree": "3"}),
    Attempt("ced-high", "narx-wavelet", "na=3 nb=3 nk=1"),
    Attempt("ced-low", "narx-wavelet", "na=3 nb=3 nk=1"),
    Attempt("tanks", "narx-wavelet", "na=3 nb=3 nk=1"),
    Attempt("hoop", "narx-wavelet"),
    Attempt("generator", "narx-wavelet", "na=2 nb=2 nk=1", {"units": "0"}),
    Attempt("damper", "narx-wavelet", "na=4 nb=4 nk=0", {"estimator": "neural"}),
    Attempt("silverbox", "narx-wavelet", "na=2 nb=2 nk=0", {"units": "0", "degree": "3"}),
    Attempt("robot", "narx-wavelet"),
    Attempt("robot", "narx-wavelet", "na=1 nb=1 nk=1"),
    Attempt("robot", "narx-wavelet", "na=1,1;0,1 nb=1 nk=1"),
    Attempt("robot", "narx-wavelet", "na=1,1;1,1 nb=1 nk=1"),
)
"""By record: the default fit, and what else was tried, cheap ones first."""


HEAD = """# NARX networks on the measured records

Free-run error on the test part of each record, which chose nothing. *train* is the same figure on
the training part, *hold-out fit* that of inner blocks of it: the arrow marks the entry they choose,
the others lost. Seconds are those of one processor, compilation included where a shape is new.
"""

TAIL = """
Below what was to be reached: the left track with the thesis's orders (the speed of the other track
is missing from them), CED (its sensor has no sign; Hammerstein–Wiener gets 0.09 V), and hoop_motor,
where the figure refers to the spread of each record about its own mean: what is left is an
uncertain delay where the input drops to zero.
"""

if __name__ == "__main__":
    run(STUDY, __doc__, ATTEMPTS, HEAD, TAIL)
