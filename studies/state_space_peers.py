"""Subspace fits by nfoursid and SIPPY: run by a Python that has them, not by ours.

    PYTHON state_space_peers.py DATA.npz

Reads u, y and n of every case; prints {case: {peer: [A, B, C, D, seconds]}} as one line of JSON.
Needs numpy, pandas, nfoursid and sippy_unipi.
"""

import contextlib
import io
import json
import sys
from time import process_time

import numpy as np

BLOCKS = 20
"""Block rows of all of them, SIPPY's default."""


def by_nfoursid(u, y, n):
    """N4SID of nfoursid."""
    import pandas
    from nfoursid.nfoursid import NFourSID

    names = [[f"{s}{k}" for k in range(v.shape[1])] for s, v in (("u", u), ("y", y))]
    frame = pandas.DataFrame(np.hstack([u, y]), columns=names[0] + names[1])
    made = NFourSID(frame, names[1], input_columns=names[0], num_block_rows=BLOCKS)
    made.subspace_identification()
    s, _ = made.system_identification(rank=n)
    return s.a, s.b, s.c, s.d


def by_sippy(method):
    """A method of SIPPY by its name."""

    def fitted(u, y, n):
        from sippy_unipi import system_identification

        s = system_identification(y.T, u.T, method, SS_fixed_order=n, SS_f=BLOCKS, SS_p=BLOCKS)
        return s.A, s.B, s.C, s.D

    return fitted


PEERS = {
    "nfoursid N4SID": by_nfoursid,
    "SIPPY N4SID": by_sippy("N4SID"),
    "SIPPY CVA": by_sippy("CVA"),
    "SIPPY PARSIM-K": by_sippy("PARSIM-K"),
}


def main(path):
    """Fit every case by every peer."""
    data = np.load(path)
    found = {}
    for case in sorted({k.rsplit("/", 1)[0] for k in data.files}):
        u, y, n = (data[f"{case}/{s}"] for s in ("u", "y", "n"))
        found[case] = {}
        for name, fitted in PEERS.items():
            start = process_time()
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    parts = fitted(u, y, int(n))
                row = [np.asarray(m).tolist() for m in parts]
                found[case][name] = [*row, process_time() - start]
            except (Exception, SystemExit) as error:  # what becomes of a peer is part of the table
                found[case][name] = str(error)[:80] or type(error).__name__
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
