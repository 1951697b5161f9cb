typedef struct {
    motion_state motion;
    double sample; /* that comes next */
} fmu_state;

static void parameters_of(const double *r, motion_parameters *p)
{
    motion_defaults(p);
@{ parameters | join("\n") }@
    (void)r;
}

static const char *fmu_begin(fmu_state *state, const double *r)
{
    motion_parameters p;
    parameters_of(r, &p);
    motion_init(&state->motion, &p);
    state->sample = 0.0;
    return NULL;
}

static void fmu_advance(fmu_state *state, double *r)
{
    motion_parameters p;
    motion_inputs rolled;
    motion_outputs body;

    parameters_of(r, &p);
    rolled.t = state->sample * FMU_SAMPLE_TIME;
    rolled.dt = state->sample > 0.0 ? FMU_SAMPLE_TIME : 0.0;
@{ measurements | join("\n") }@
    motion_step(&state->motion, &p, &rolled, &body);
    state->sample += 1.0;
@{ outputs | join("\n") }@
}

static void fmu_outputs(const fmu_state *state, double *r)
{
    fmu_state copy = *state;
    fmu_advance(&copy, r);
}
