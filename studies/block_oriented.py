"""How far block-oriented models get on the measured records and on a simulated circuit.

Every entry is fitted to the training part; what it leaves open (orders, statics) the fit chooses
on held-out samples of that part. The test part chooses nothing.
"""

from studies.attempts import Attempt, run
from studies.diode_circuit import NOISE
from studies.runner import Study

STUDY = Study("block_oriented", "block_oriented.md", jobs=1)
HW, WH = "hammerstein-wiener", "wiener-hammerstein"
_ROBOT_DEAD_ZONE = {"input": "dead-zone", "output": "identity"}

ATTEMPTS = (
    *(
        attempt
        for ced in ("ced-low", "ced-high")
        for attempt in (
            Attempt(ced, "oe", "nb=3 nf=3 nk=1"),
            Attempt(ced, HW, "nk=1"),
            Attempt(ced, HW, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs"}),
            Attempt(ced, HW, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,piecewise:4"}),
            Attempt(ced, HW, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,piecewise:6"}),
            Attempt(ced, HW, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,polynomial:3"}),
        )
    ),
    Attempt("tacho", "oe", "nb=2 nf=2 nk=1"),
    Attempt("tacho", HW, "nk=1"),
    Attempt("tacho", HW, "nb=2 nf=2 nk=1", {"form": "hammerstein"}),
    Attempt("tacho", HW, "nb=2 nf=2 nk=1", {"form": "wiener"}),
    Attempt("tacho", WH, "nk=1"),
    Attempt("hoop", "oe", "nb=1 nf=1 nk=1"),
    Attempt("hoop", HW, "nk=1"),
    Attempt("hoop", HW, "nb=1 nf=1 nk=1", {"input": "piecewise:8", "output": "piecewise:8"}),
    Attempt("hoop", WH, "nk=1"),
    Attempt("robot", "oe", "nb=2 nf=2 nk=1"),
    Attempt("robot", HW, "nk=1"),
    Attempt("robot", HW, "nb=2 nf=2 nk=1", _ROBOT_DEAD_ZONE),
    Attempt("robot", WH, "nb1=1 nf1=1 nb=2 nf=2 nk=1", {"static": "dead-zone"}),
    Attempt("circuit", "oe", "nb=6 nf=6 nk=0"),
    Attempt("circuit", WH, "nk=1"),
)


HEAD = f"""# Block-oriented models on measured records

Free run everywhere. Each entry is fitted to
the training part of its record (splits and figures: `studies/records.py`); what it leaves open
(`nk=1` alone: orders and statics) the fit chooses on held-out samples of that part. *hold-out* is
the fit on inner blocks of the training part when what was chosen is fitted to the rest of it;
*test* chose nothing. Least and aim are those of the record, for whatever structure. Every entry is
shown, also those that lost. CED and the circuit: root mean square errors, the others: fits.

The circuit stands in for the Wiener-Hammerstein benchmark: `studies/diode_circuit.py`, 100 000
samples to fit, 50 000 others to test, measurement noise {1e3 * NOISE:g} mV, which no model can
beat.
"""

if __name__ == "__main__":
    run(STUDY, __doc__, ATTEMPTS, HEAD)
