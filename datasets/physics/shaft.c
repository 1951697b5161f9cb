/* Motor shaft, gear with or without a gap, output shaft, friction, heat. */
#include <math.h>

#include "model.h"

static double sign_of(double x) { return (double)((x > 0.0) - (x < 0.0)); }

/* Speed of the motor over that of the output, and its derivative by the angle. */
double gear_ratio(const Gearbox *g, double angle, double *slope)
{
    if (g->eccentricity == 0.0) {
        if (slope) *slope = 0.0;
        return g->ratio;
    }
    double turn = g->eccentric_periods * angle + g->eccentric_phase;
    if (slope) *slope = -g->ratio * g->eccentricity * g->eccentric_periods * sin(turn);
    return g->ratio * (1.0 + g->eccentricity * cos(turn));
}

/* Angle by which an eccentric gear leads: the integral of the ratio's change. */
static double gear_lead(const Gearbox *g, double angle)
{
    if (g->eccentricity == 0.0) return 0.0;
    double turn = g->eccentric_periods * angle + g->eccentric_phase;
    return g->eccentricity / g->eccentric_periods * (sin(turn) - sin(g->eccentric_phase));
}

static double coulomb(const Friction *f, double sign, double load)
{
    return (sign > 0.0 ? f->coulomb_forward : f->coulomb_backward) + f->load_share * fabs(load);
}

/* Dry friction that slides at w [N m], a magnitude. */
static double sliding(const Friction *f, double w, double sign, double load)
{
    double torque = coulomb(f, sign, load);
    if (f->breakaway != 1.0) {
        double x = w / f->stribeck_speed;
        torque *= 1.0 + (f->breakaway - 1.0) * exp(-x * x);
    }
    return torque;
}

static double wet(const Friction *f, double w)
{
    return (w > 0.0 ? f->viscous_forward : f->viscous_backward) * w + f->quadratic * fabs(w) * w;
}

/* LuGre: bristles of a stiffness that slip at the sliding friction; else dry friction. */
static double friction_torque(const Friction *f, double w, double sign, double load, double bristle,
                              double *bristle_rate)
{
    double torque = wet(f, w);
    *bristle_rate = 0.0;
    if (f->presliding > 0.0) {
        double side = w != 0.0 ? sign_of(w) : sign_of(bristle);
        double slide = sliding(f, w, side, load), level = coulomb(f, side, load);
        if (slide > 0.0) {
            double stiffness = level / f->presliding;
            *bristle_rate = w - stiffness * fabs(w) * bristle / slide;
            torque += stiffness * bristle + f->bristle_damping * *bristle_rate;
        }
        return torque;
    }
    return torque + sign * sliding(f, w, sign, load);
}

/* Torque of the teeth on the output [N m]: it pushes, never pulls. */
static double contact(const Gearbox *g, const DriveState *s)
{
    double slope, n = gear_ratio(g, s->angle, &slope);
    double twist = s->motor_angle / g->ratio - s->angle - gear_lead(g, s->angle);
    double rate = (s->motor_speed - n * s->speed) / g->ratio;
    double deep = fabs(twist) - 0.5 * g->gap;
    if (deep <= 0.0) return 0.0;
    double side = sign_of(twist);
    double torque = g->stiffness * deep + g->damping * rate * side;
    return torque > 0.0 ? side * torque : 0.0;
}

static double load_torque(const Drive *p, const DriveState *s, const Held *h, double ground)
{
    const Load *l = &p->load;
    double torque = l->constant + h->disturbance + ground;
    if (l->gravity != 0.0) torque -= l->gravity * sin(s->angle + l->gravity_phase);
    if (l->spring != 0.0) torque -= l->spring * s->angle;
    if (l->memory != 0.0) torque -= l->memory * (s->angle - s->creep);
    return torque;
}

static double motor_torque(const Drive *p, const DriveState *s, double *motor_speed)
{
    double constant;
    back_emf(p, s, &constant, motor_speed);
    double torque = constant * s->current;
    if (p->motor.cogging != 0.0) {
        double angle = p->gearbox.stiffness > 0.0 ? s->motor_angle : s->angle * p->gearbox.ratio;
        torque -= p->motor.cogging * sin(p->motor.cogging_periods * angle);
    }
    return torque;
}

/* The sign of dry friction in this step: that of the motion, or, where the shaft stands, that of a
 * torque beyond what holds it; 0 where it sticks. */
static double direction(double w, double torque, double holds_forward, double holds_backward)
{
    if (w != 0.0) return sign_of(w);
    if (torque > holds_forward) return 1.0;
    if (torque < -holds_backward) return -1.0;
    return 0.0;
}

static double holds(const Friction *f, double sign, double load)
{
    return f->presliding > 0.0 ? 0.0 : sliding(f, 0.0, sign, load);
}

void hold_friction(const Drive *p, const DriveState *s, double ground, Held *h)
{
    const Gearbox *g = &p->gearbox;
    double w, torque = motor_torque(p, s, &w), load = load_torque(p, s, h, ground);
    if (g->stiffness > 0.0) {
        double teeth = contact(g, s);
        h->motor_sign = direction(s->motor_speed, torque - teeth / g->ratio,
                                  holds(&p->motor_friction, 1.0, torque),
                                  holds(&p->motor_friction, -1.0, torque));
        h->sign = direction(s->speed, teeth + load, holds(&p->friction, 1.0, teeth),
                            holds(&p->friction, -1.0, teeth));
        return;
    }
    double n = gear_ratio(g, s->angle, 0), sent = n * torque;
    h->sign = direction(
        s->speed, sent + load,
        holds(&p->friction, 1.0, sent) + n * holds(&p->motor_friction, 1.0, torque),
        holds(&p->friction, -1.0, sent) + n * holds(&p->motor_friction, -1.0, torque));
    h->motor_sign = h->sign;
}

/* A shaft with dry friction that has changed its direction has come to rest within the step. */
void project_friction(const Drive *p, const Held *h, DriveState *now)
{
    int dry = holds(&p->friction, 1.0, 0.0) + holds(&p->friction, -1.0, 0.0) > 0.0
              || p->friction.load_share > 0.0;
    int motor_dry = holds(&p->motor_friction, 1.0, 0.0) + holds(&p->motor_friction, -1.0, 0.0) > 0.0
                    || p->motor_friction.load_share > 0.0;
    if (p->gearbox.stiffness == 0.0) {
        dry = dry || motor_dry;
    } else if (motor_dry && h->motor_sign * now->motor_speed <= 0.0) {
        now->motor_speed = 0.0;
    }
    if (dry && h->sign * now->speed <= 0.0) now->speed = 0.0;
}

static void heat_rates(const Drive *p, const DriveState *s, DriveState *d)
{
    const Thermal *t = &p->thermal;
    double through = (s->winding - s->housing) / t->winding_to_housing;
    if (t->winding_capacity > 0.0)
        d->winding = (s->current * s->current * winding_resistance(p, s) - through)
                     / t->winding_capacity;
    if (t->housing_capacity > 0.0)
        d->housing = (through - s->housing / t->housing_to_air) / t->housing_capacity;
}

void drive_rates(const Drive *p, const DriveState *s, const Held *h, double ground, DriveState *d)
{
    const Gearbox *g = &p->gearbox;
    DriveState now = *s;
    double constant, w, emf = back_emf(p, s, &constant, &w);
    double limit = p->bridge.current_limit;
    if (p->motor.inductance > 0.0) {
        if (!h->blocked)
            d->current = (bridge_voltage(p, h, s->current, emf) - emf
                          - winding_resistance(p, s) * s->current)
                         / p->motor.inductance;
        if (limit > 0.0 && fabs(s->current) >= limit) { /* it chops: the current stays there */
            now.current = sign_of(s->current) * limit;
            if (d->current * s->current > 0.0) d->current = 0.0;
        }
    } else {
        now.current = still_current(p, h, s);
    }
    double torque = motor_torque(p, &now, &w), load = load_torque(p, s, h, ground);
    double pushed = g->stiffness > 0.0 ? contact(g, s) : torque * g->ratio;
    double here = friction_torque(&p->friction, s->speed, h->sign, pushed, s->bristle, &d->bristle);
    double at_motor = friction_torque(&p->motor_friction, w, h->motor_sign, torque,
                                      s->motor_bristle, &d->motor_bristle);
    d->angle = s->speed;
    d->creep = p->load.memory != 0.0 ? (s->angle - s->creep) / p->load.memory_time : 0.0;
    if (g->stiffness > 0.0) {
        d->motor_angle = s->motor_speed;
        if (h->motor_sign != 0.0 || holds(&p->motor_friction, 1.0, torque) == 0.0)
            d->motor_speed = (torque - pushed / g->ratio - at_motor) / p->motor.inertia;
        if (h->sign != 0.0 || holds(&p->friction, 1.0, pushed) == 0.0)
            d->speed = (pushed + load - here) / g->load_inertia;
    } else {
        double slope, n = gear_ratio(g, s->angle, &slope);
        double inertia = g->load_inertia + p->motor.inertia * n * n;
        double stays = holds(&p->friction, 1.0, n * torque)
                       + n * holds(&p->motor_friction, 1.0, torque);
        if (h->sign != 0.0 || stays == 0.0)
            d->speed = (n * (torque - at_motor) + load - here
                        - p->motor.inertia * n * slope * s->speed * s->speed)
                       / inertia;
    }
    heat_rates(p, &now, d);
}
