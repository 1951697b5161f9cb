typedef struct {
    controller_parameters laws;
    navigation_parameters navigation;
} all_parameters;

typedef struct {
    controller_state laws;
    navigation_state navigation;
    navigation_outputs estimate;
    controller_outputs decided;
    double sample;  /* that comes next */
    double instant; /* of control that comes next */
} fmu_state;

static void parameters_of(const double *r, all_parameters *p)
{
    controller_defaults(&p->laws);
    navigation_defaults(&p->navigation);
@{ parameters | join("\n") }@
}

static const char *fmu_begin(fmu_state *state, const double *r)
{
    all_parameters p;
    parameters_of(r, &p);
    memset(state, 0, sizeof *state);
    controller_init(&state->laws, &p.laws);
    navigation_init(&state->navigation, &p.navigation);
%% for name, value in start.items()
    state->estimate.@{ name }@ = @{ value | number }@;
%% endfor
    return NULL;
}

/* What the robot's computer does at one sample. */
static void fmu_advance(fmu_state *state, double *r)
{
    const double t = state->sample * FMU_SAMPLE_TIME;
    const double slack = @{ slack | number }@ * (CONTROLLER_PERIOD + t);
    all_parameters p;
    navigation_inputs read;
    controller_inputs seen;
    int pass;

    parameters_of(r, &p);
    read.t = t;
    read.dt = state->sample > 0.0 ? FMU_SAMPLE_TIME : 0.0;
    read.drive_l = state->decided.pwm_l / @{ full | number }@;
    read.drive_r = state->decided.pwm_r / @{ full | number }@;
@{ measurements | join("\n") }@
    for (pass = 0; pass < 2; pass++) {
        /* first what is decided before this sample, then, with its measurement, at it */
        const double until = pass == 0 ? t - slack : t + slack;
        if (pass == 1) {
            navigation_step(&state->navigation, &p.navigation, &read, &state->estimate);
            if (r[@{ given }@] > 0.5) {
%% for name, at in pose.items()
                state->estimate.@{ name }@ = r[@{ at }@];
%% endfor
            }
        }
        while (state->instant * CONTROLLER_PERIOD < until) {
            seen.t = state->instant * CONTROLLER_PERIOD;
            seen.x = state->estimate.x;
            seen.y = state->estimate.y;
            seen.psi = state->estimate.psi;
            seen.speed = state->estimate.speed;
            seen.yaw_rate = state->estimate.yaw_rate;
            controller_step(&state->laws, &p.laws, &seen, &state->decided);
            state->instant += 1.0;
        }
    }
    state->sample += 1.0;
@{ outputs | join("\n") }@
}

static void fmu_outputs(const fmu_state *state, double *r)
{
    fmu_state copy = *state;
    fmu_advance(&copy, r);
}
