"""The S-function, with a stand-in for what Simulink's header declares and Simulink does."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_programs import COMPILER, FLAGS, needs_compiler
from plant_models import bench_model

from sysid.export.c.step import tunable_parameters
from sysid.export.package import package_files

HEADER = r"""
#include <stddef.h>
typedef double real_T;
typedef int int_T;
typedef struct { size_t n; double *values; } mxArray;
typedef struct {
    const mxArray *parameter;
    real_T *input;
    real_T output[8];
    real_T work[2][512];
    int_T width[2];
    int_T feedthrough;
    const char *error;
} SimStruct;
#define SS_DOUBLE 0
#define mxGetNumberOfElements(a) ((a)->n)
#define mxGetPr(a) ((a)->values)
#define ssGetSFcnParam(S, k) ((S)->parameter)
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssGetErrorStatus(S) ((S)->error)
#define ssSetNumSFcnParams(S, n) ((void)(S))
#define ssGetNumSFcnParams(S) 1
#define ssGetSFcnParamsCount(S) 1
#define ssSetSFcnParamTunable(S, k, yes) ((void)(S))
#define ssSetNumContStates(S, n) ((void)(S))
#define ssSetNumDiscStates(S, n) ((void)(S))
#define ssSetNumInputPorts(S, n) 1
#define ssSetNumOutputPorts(S, n) 1
#define ssSetInputPortWidth(S, k, n) ((void)(S))
#define ssSetInputPortRequiredContiguous(S, k, yes) ((void)(S))
#define ssSetInputPortDirectFeedThrough(S, k, yes) ((S)->feedthrough = (yes))
#define ssSetOutputPortWidth(S, k, n) ((void)(S))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetSampleTime(S, k, dt) ((void)(S), (void)(dt))
#define ssSetOffsetTime(S, k, t) ((void)(t))
#define ssSetNumDWork(S, n) ((void)(S))
#define ssSetDWorkWidth(S, k, n) ((S)->width[k] = (n))
#define ssSetDWorkDataType(S, k, type) ((void)(type))
#define ssGetDWork(S, k) ((void *)(S)->work[k])
#define ssGetInputPortSignal(S, k) ((void *)(S)->input)
#define ssGetOutputPortSignal(S, k) ((void *)(S)->output)
"""

SIMULATION = r"""
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **given)
{
    static SimStruct S;
    static double values[64], u[PLANT_INPUTS];
    mxArray parameter = {0, values};
    int_T j, k;
    for (k = 1; k < count; k++)
        values[parameter.n++] = strtod(given[k], NULL);
    S.parameter = &parameter;
    S.input = u;
    mdlInitializeSizes(&S);
    if (S.error != NULL) {
        puts(S.error);
        return 1;
    }
    mdlInitializeSampleTimes(&S);
    mdlInitializeConditions(&S);
    for (k = 0; k < 20; k++) {
        for (j = 0; j < PLANT_INPUTS; j++)
            u[j] = 5.0 + (double)((k * (j + 3)) % 7);
        mdlOutputs(&S, 0);
        mdlOutputs(&S, 0); /* as often as Simulink likes: it changes nothing */
        for (j = 0; j < PLANT_OUTPUTS; j++)
            printf("%.17g ", S.output[j]);
        printf("\n");
        mdlUpdate(&S, 0);
        if (k == 9)
            mdlProcessParameters(&S);
    }
    mdlTerminate(&S);
    return S.feedthrough == PLANT_FEEDTHROUGH ? 0 : 2;
}
"""


@needs_compiler
@pytest.mark.parametrize("nk", [0, 1])
def test_it_steps_the_plant_as_simulink_would_ask_it_to(tmp_path: Path, nk: int) -> None:
    model = bench_model("arx", nk=nk)
    for name, content in package_files(model, formats=["c"]).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    c = tmp_path / "c"
    assert f"PLANT_FEEDTHROUGH {1 - nk}" in (c / "plant.h").read_text(encoding="utf-8")
    (c / "simstruc.h").write_text(HEADER, encoding="utf-8")
    (c / "simulink.c").write_text(SIMULATION, encoding="utf-8")
    made = [*FLAGS, "-DMATLAB_MEX_FILE", "-I.", "-o", "sfun", "simulink/plant_sfun.c", "plant.c"]
    command = [str(COMPILER), *made, "-lm"]
    done = subprocess.run(command, cwd=c, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    u = 5.0 + np.array([[(k * 3) % 7] for k in range(20)], dtype=float)
    expected = model.simulate(u)
    plain = subprocess.run([c / "sfun"], capture_output=True, text=True, check=True).stdout
    np.testing.assert_allclose(np.array(plain.split(), dtype=float), expected[:, 0], atol=1e-12)

    numbers = [repr(t.value) for t in tunable_parameters(model)]
    same = subprocess.run([c / "sfun", *numbers], capture_output=True, text=True, check=True)
    assert same.stdout == plain
    wrong = subprocess.run([c / "sfun", "1", "2"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert f"its parameter is [] or {len(numbers)} numbers" in wrong.stdout
