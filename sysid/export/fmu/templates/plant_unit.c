typedef plant_state fmu_state;

/* where the parameters of the start stand among the variables, and the states after them */
enum {
    START = PLANT_INPUTS + PLANT_OUTPUTS,
    START_SETTLED = START + PLANT_STATES,
    STATE = START_SETTLED + 1
};

static void parameters_of(const double *r, plant_parameters *p)
{
%% for t in tunable
    p->@{ t.name }@ = r[@{ first + loop.index0 }@];
%% else
    (void)r;
    plant_defaults(p);
%% endfor
}

/* after so many samples under one input every mode of the plant has died away */
#define SETTLING_SAMPLES @{ samples }@
static const double settled_scale[PLANT_OUTPUTS] = {@{ scale | numbers }@};

static const char *fmu_begin(fmu_state *state, const double *r)
{
    double before[PLANT_OUTPUTS], y[PLANT_OUTPUTS];
    plant_parameters p;
    int k;
    parameters_of(r, &p);
    plant_init(state, &p);
    if (r[START_SETTLED] > 0.5) {
        for (k = 0; k < PLANT_OUTPUTS; k++)
            y[k] = 0.0;
        for (k = 0; k < SETTLING_SAMPLES; k++) {
            memcpy(before, y, sizeof y);
            plant_step(state, &p, r, y);
        }
        for (k = 0; k < PLANT_OUTPUTS; k++)
            if (!(fabs(y[k] - before[k]) <= 1e-9 * settled_scale[k]))
                return "the plant does not settle under the first inputs: leave start_settled off";
    }
    for (k = 0; k < PLANT_STATES; k++)
        state->x[k] += r[START + k];
    return NULL;
}

static void fmu_outputs(const fmu_state *state, double *r)
{
    fmu_state copy = *state;
    fmu_state rest;
    plant_parameters p;
    int k;
    parameters_of(r, &p);
    plant_step(&copy, &p, r, r + PLANT_INPUTS);
    plant_init(&rest, &p);
    for (k = 0; k < PLANT_STATES; k++)
        r[STATE + k] = state->x[k] - rest.x[k];
}

static void fmu_advance(fmu_state *state, double *r)
{
    plant_parameters p;
    parameters_of(r, &p);
    plant_step(state, &p, r, r + PLANT_INPUTS);
}
