@{ robot }@
/* Drive the mission; the largest error, and by how many samples it ends elsewhere. */
static double drive_mission(int *later)
{
    controller_parameters parameters;
    controller_state controller;
    controller_inputs seen;
    controller_outputs decided;
    navigation_parameters navigation_p;
    navigation_state navigation;
    navigation_inputs read;
    navigation_outputs believed;
    motion_parameters motion_p;
    motion_state motion;
    motion_inputs rolled;
    motion_outputs body;
    robot_state robot, ahead;
    double pwm[2] = {0.0, 0.0};
    double omega[2];
    double worst = 0.0;
    int instant = 0;
    int k;

    controller_defaults(&parameters);
    controller_init(&controller, &parameters);
    navigation_defaults(&navigation_p);
    navigation_init(&navigation, &navigation_p);
    motion_defaults(&motion_p);
    motion_init(&motion, &motion_p);
    robot_init(&robot);
    decided.arrived = 0.0;
    believed.x = @{ start_x }@;
    believed.y = @{ start_y }@;
    believed.psi = @{ start_psi }@;
    believed.speed = 0.0;
    believed.yaw_rate = 0.0;
    for (k = 0; k <= LOOP_ROWS; k++) {
        const double t = (double)k * PLANT_SAMPLE_TIME;
        const double slack = @{ slack | number }@ * (CONTROLLER_PERIOD + t);
        const double dt = k > 0 ? PLANT_SAMPLE_TIME : 0.0;
        int pass;

        /* a reading at this sample is y(k) under the command held so far */
        const double held[2] = {pwm[0], pwm[1]};
        ahead = robot;
        robot_step(&ahead, held, omega);
        for (pass = 0; pass < 2; pass++) {
            /* first what is decided before this sample, then, with its reading, at it */
            const double until = pass == 0 ? t - slack : t + slack;
            if (pass == 1) {
@{ navigation }@
                navigation_step(&navigation, &navigation_p, &read, &believed);
            }
            while ((double)instant * CONTROLLER_PERIOD < until) {
                seen.t = (double)instant * CONTROLLER_PERIOD;
                seen.x = believed.x;
                seen.y = believed.y;
                seen.psi = believed.psi;
                seen.speed = believed.speed;
                seen.yaw_rate = believed.yaw_rate;
                controller_step(&controller, &parameters, &seen, &decided);
                pwm[0] = decided.pwm_l;
                pwm[1] = decided.pwm_r;
                instant++;
            }
        }
        robot_step(&robot, pwm, omega);
@{ motion }@
        motion_step(&motion, &motion_p, &rolled, &body);
        if (k < LOOP_ROWS) {
            const double row[LOOP_COLUMNS] = {pwm[0], pwm[1], omega[0], omega[1], body.x, body.y, body.psi};
            int i;
            for (i = 0; i < LOOP_COLUMNS; i++)
                worst = worse(worst, row[i], loop_rows[k][i], loop_ranges[i]);
        }
        if (decided.arrived > 0.5) {
            k++;
            break;
        }
    }
    *later = k - LOOP_ROWS;
    return worst;
}
