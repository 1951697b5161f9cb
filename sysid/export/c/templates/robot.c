/* One robot: the plant@{ twins_words }@, and what makes its inputs and outputs those of two tracks. */
typedef struct {
    plant_parameters parameters;
    plant_state plant[@{ copies }@];
} robot_state;

static void robot_init(robot_state *robot)
{
    plant_defaults(&robot->parameters);
@{ rest }@
}

/* PWM of both tracks in, wheel speeds out. */
static void robot_step(robot_state *robot, const double pwm[2], double omega[2])
{
    double u[PLANT_INPUTS];
    double y[PLANT_OUTPUTS];
@{ drive }@
}
