/* Two tracks on a body: friction in points under each track, load, slope, pose. */
#include <math.h>

#include "model.h"

static void pose_rates(const State *s, State *d)
{
    double c = cos(s->heading), k = sin(s->heading);
    d->x = s->forward * c - s->sideways * k;
    d->y = s->forward * k + s->sideways * c;
    d->heading = s->turning;
}

/* Load of each track [N] from the acceleration sideways and the slope. */
void hold_loads(const Body *b, const State *s, const State *d, Held *held)
{
    double weight = b->mass * b->gravity * cos(b->slope);
    double side = b->mass * (d->sideways + s->turning * s->forward
                             - b->gravity * sin(b->slope) * sin(s->heading));
    double moved = b->height * side / b->width;
    if (moved > 0.5 * weight) moved = 0.5 * weight;
    if (moved < -0.5 * weight) moved = -0.5 * weight;
    held[0].load = 0.5 * weight - moved; /* a turn to the left loads the right track */
    held[1].load = 0.5 * weight + moved;
}

/* Torque of the ground on each wheel [N m] and the rates of the body. */
void ground_torques(const Body *b, const State *s, const Held *held, double torque[2], State *d)
{
    const double radius[2] = {b->radius_left, b->radius_right}, side[2] = {0.5, -0.5};
    double forward = 0.0, sideways = 0.0, moment = 0.0;
    int points = b->length == 0.0 ? 1 : POINTS; /* all of a short track are one */
    for (int k = 0; k < 2; k++) {
        double y = side[k] * b->width, track = radius[k] * s->drive[k].speed, pull = 0.0;
        double along = s->forward - s->turning * y - track;
        double soft = b->slip_speed + b->creep * fabs(track);
        for (int j = 0; j < points; j++) {
            double x = b->length * ((j + 0.5) / points - 0.5) - b->ahead;
            double across = s->sideways + s->turning * x;
            double per = held[k].load / points / sqrt(along * along + across * across + soft * soft);
            double f = -b->grip * per * along, g = -b->side_grip * per * across;
            pull += f;
            sideways += g;
            moment += x * g;
        }
        torque[k] = -radius[k] * pull;
        /* the ground that is pressed down resists the body, which the track must push */
        double rolls = along + track;
        pull -= b->rolling * held[k].load * rolls / sqrt(rolls * rolls + 1e-4);
        forward += pull;
        moment -= y * pull;
    }
    double fall = b->mass * b->gravity * sin(b->slope);
    d->forward = (forward - fall * cos(s->heading)) / b->mass + s->turning * s->sideways;
    d->sideways = (sideways + fall * sin(s->heading)) / b->mass - s->turning * s->forward;
    d->turning = (moment - b->yaw_viscosity * s->turning) / b->yaw_inertia;
    pose_rates(s, d);
}
