"""Building and running the C code of a plant, for tests."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.export.c.step import c_sources
from sysid.plant.selftest import make_selftest
from sysid.structures.model import Model

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc, clang) here")

FLAGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-O2"]

# Steps the plant through rows of inputs on stdin and prints every output in full; u and y share
# one array, which plant_step allows. From the row named on the command line on the parameters
# are those that follow there, in the order of the struct, which holds nothing but doubles.
DRIVER = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "plant.h"
#define WIDTH (PLANT_INPUTS > PLANT_OUTPUTS ? PLANT_INPUTS : PLANT_OUTPUTS)
int main(int count, char **given)
{
    plant_parameters parameters;
    plant_state state;
    double both[WIDTH];
    static double changed[4096];
    int j;
    int k;
    plant_defaults(&parameters);
    plant_init(&state, &parameters);
    for (k = 0;; k++) {
        if (count > 1 && k == atoi(given[1])) {
            for (j = 2; j < count; j++)
                changed[j - 2] = strtod(given[j], NULL);
            memcpy(&parameters, changed, sizeof parameters);
        }
        for (j = 0; j < PLANT_INPUTS; j++)
            if (scanf("%lf", &both[j]) != 1)
                return 0;
        plant_step(&state, &parameters, both, both);
        for (j = 0; j < PLANT_OUTPUTS; j++)
            printf("%.17g ", both[j]);
        printf("\n");
    }
}
"""


def build(folder: Path, model: Model, *mains: str) -> dict[str, Path]:
    """Compile the plant with each main; return the programs."""
    for name, text in c_sources(model, make_selftest(model)).items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "driver.c").write_text(DRIVER)
    programs = {}
    for main in mains:
        programs[main] = folder / main
        command = [str(COMPILER), *FLAGS, "-o", main, "plant.c", f"{main}.c", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return programs


def driven(program: Path, u: Array, changed: Sequence[float] = (), at: int = 0) -> Array:
    """Outputs (N, ny) of a built driver for inputs (N, nu).

    Args:
        changed: parameters, all of them, that hold from row ``at`` on; none for those of the model.
    """
    rows = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in u)
    given = [str(at), *(f"{v:.17g}" for v in changed)] if len(changed) else []
    done = subprocess.run([program, *given], input=rows, capture_output=True, text=True, check=True)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


def worst_error(program: Path) -> float:
    """What a built self-test prints; it must pass."""
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return float(done.stdout)
