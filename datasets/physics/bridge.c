/* Battery, bridge and winding, averaged over a PWM period. */
#include <math.h>

#include "model.h"

static double sign_of(double x) { return (double)((x > 0.0) - (x < 0.0)); }

/* Emf [V], the constant at this temperature and direction, and the motor's speed. */
double back_emf(const Drive *p, const DriveState *s, double *constant, double *motor_speed)
{
    double w = p->gearbox.stiffness > 0.0
                   ? s->motor_speed
                   : s->speed * gear_ratio(&p->gearbox, s->angle, 0);
    double k = p->motor.constant * (1.0 + p->thermal.magnets * s->housing);
    if (w < 0.0) k *= p->motor.backward_constant;
    *constant = k;
    *motor_speed = w;
    return k * w;
}

double winding_resistance(const Drive *p, const DriveState *s)
{
    return p->motor.resistance * (1.0 + p->thermal.copper * (s->winding + p->thermal.air - 20.0));
}

/* What the drives take: a bridge takes the motor's current for the share it is on. */
double bus_current(const State *s, const Held *held, int drives)
{
    double sum = 0.0;
    for (int k = 0; k < drives; k++) {
        double i = s->drive[k].current;
        int off = held[k].rectifying && held[k].side == 0.0;
        sum += off ? -fabs(i) : held[k].duty * i;
    }
    return sum;
}

double bus_voltage(const Battery *b, const State *s, const Held *held, int drives)
{
    double left = b->charge - s->used / b->capacity;
    double open = b->full - b->slope * (1.0 - left);
    if (b->knee > 0.0) open -= b->knee * exp(-left / 0.05);
    double volts = open - s->polarisation - b->resistance * bus_current(s, held, drives);
    return volts > 0.0 ? volts : 0.0;
}

/* Which way the current may flow in this step, and whether it flows at all. */
void hold_bridge(const Drive *p, const DriveState *s, Held *h)
{
    const Bridge *b = &p->bridge;
    int off = h->duty == 0.0 && (b->coast_at_zero > 0.0 || b->quadrants == 1.0);
    h->rectifying = off || b->quadrants == 1.0;
    h->side = off ? 0.0 : sign_of(h->duty);
    h->flows = sign_of(s->current);
    h->blocked = 0;
    if (h->rectifying && s->current == 0.0) {
        double k, w, emf = back_emf(p, s, &k, &w);
        h->blocked = off || (fabs(h->duty) * h->bus - (1.0 - fabs(h->duty)) * b->diode_drop
                                 <= h->side * emf
                             && (b->pwm_period == 0.0 || h->bus <= h->side * emf));
    }
}

/* One quadrant: the diode carries the current between pulses until it is dry, after which the
 * terminals show the emf (averaged model of discontinuous conduction). */
static double with_diode(const Drive *p, const Held *h, double current, double emf)
{
    const Bridge *b = &p->bridge;
    /* which way it flows is held: a stage of RK4 beyond zero is not the current turning */
    if (h->flows * h->side < 0.0) return h->side * (h->bus + 2.0 * b->diode_drop);
    double d = fabs(h->duty), i = fmax(h->side * current, 0.0), e = h->side * emf;
    double on = h->bus - b->on_resistance * i, off = 1.0 - d;
    if (b->pwm_period > 0.0 && on > e) {
        double dry = 2.0 * p->motor.inductance * i / (d * b->pwm_period * (on - e)) - d;
        if (dry < off) off = dry > 0.0 ? dry : 0.0;
    }
    return h->side * (d * on - off * b->diode_drop + (1.0 - d - off) * e);
}

double bridge_voltage(const Drive *p, const Held *h, double current, double emf)
{
    const Bridge *b = &p->bridge;
    double v;
    if (h->rectifying && h->side == 0.0)
        return b->quadrants == 1.0 && h->duty == 0.0 && !(b->coast_at_zero > 0.0)
                   ? -h->flows * b->diode_drop
                   : -h->flows * (h->bus + 2.0 * b->diode_drop);
    if (h->rectifying) return with_diode(p, h, current, emf);
    v = h->duty * h->bus - b->on_resistance * current;
    if (b->dead_time > 0.0 && h->duty != 0.0) {
        double share = current / b->ripple_current;
        share = share > 1.0 ? 1.0 : share < -1.0 ? -1.0 : share;
        v -= share * b->dead_time * (h->bus + b->diode_drop);
    }
    return v;
}

/* The current of a winding without inductance. */
double still_current(const Drive *p, const Held *h, const DriveState *s)
{
    double k, w, emf = back_emf(p, s, &k, &w), i;
    double r = winding_resistance(p, s) + p->bridge.on_resistance;
    double limit = p->bridge.current_limit;
    if (h->rectifying && h->side == 0.0) return 0.0;
    if (h->rectifying) {
        double d = fabs(h->duty);
        i = h->side * (d * h->bus - (1.0 - d) * p->bridge.diode_drop) - emf;
        i = h->side * i > 0.0 ? i / r : 0.0;
    } else {
        i = (h->duty * h->bus - emf) / r;
    }
    if (limit > 0.0 && fabs(i) > limit) i = sign_of(i) * limit;
    return i;
}

/* Diodes end a current at zero, the chopper ends it at its limit. */
double project_current(const Drive *p, const Held *h, double before, double now)
{
    double limit = p->bridge.current_limit;
    if (h->blocked) return 0.0;
    if (h->rectifying && before != 0.0 && before * now <= 0.0) now = 0.0;
    if (h->rectifying && before == 0.0 && h->side * now < 0.0) now = 0.0;
    if (limit > 0.0 && fabs(now) > limit) now = sign_of(now) * limit;
    return now;
}
