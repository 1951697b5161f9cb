/* The loop over steps: sensor clocks, rows of the log, controller, firmware, RK4. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "model.h"

/* What a run is given and gives; every array has a row per event and a column per drive. */
typedef struct {
    double step;              /* s */
    int64_t steps, substeps;
    int64_t drives;
    int64_t readings;         /* of the sensors' clock */
    const int64_t *read_at;   /* step of each reading */
    const double *noise;      /* added to a reading, before its filter if it has one */
    int64_t rows;             /* of the controller, or of the log */
    const int64_t *row_at;    /* step of each row */
    const int64_t *newest;    /* newest reading that a row knows; -1: none yet */
    const int64_t *acts_at;   /* step at which the command of a row arrives */
    double *command;          /* -1 .. 1; in a closed loop the reference comes in, the command out */
    const double *disturbance; /* N m on the output, held over a row */
    double *reading;          /* out, per reading */
    double *truth;            /* out, per row and drive: see TRUTH */
    double *pose;             /* out, every POSE_STEPS steps: x, y, heading */
} Run;

enum { TRUTH_SPEED, TRUTH_ANGLE, TRUTH_CURRENT, TRUTH_BUS, TRUTH_DUTY, TRUTH_WINDING,
       TRUTH_MOTOR_SPEED, TRUTH_VOLTAGE, TRUTH };
#define POSE_STEPS 10

/* What a sensor and a board remember. */
typedef struct {
    double ticks, last_ticks;      /* now, and at the last reading */
    double edge, span;             /* time of the last tick; time between the last two */
    double way;                    /* direction of the last tick */
    double filtered, tacho;
    double last_time;
    double slewed, soft, target;
    double sum, last;              /* of the controller */
} Memory;

static double seen_angle(const Sensor *p, double angle)
{
    if (p->eccentricity == 0.0) return angle;
    return angle + p->eccentricity * (sin(p->eccentric_periods * angle + p->eccentric_phase)
                                      - sin(p->eccentric_phase));
}

static double seen_speed(const Sensor *p, const DriveState *s)
{
    if (p->eccentricity == 0.0) return s->speed;
    return s->speed * (1.0 + p->eccentricity * p->eccentric_periods
                                 * cos(p->eccentric_periods * s->angle + p->eccentric_phase));
}

/* Ticks and their times, by a line between two steps. */
static void watch(const Sensor *p, Memory *m, double before, double now, double time, double step)
{
    double a = before * p->lines / (2.0 * PI), b = now * p->lines / (2.0 * PI), count = floor(b);
    if (count == m->ticks) return;
    double edge = count > m->ticks ? count : count + 1.0;
    double at = time + step * (a == b ? 1.0 : (edge - a) / (b - a));
    double many = fabs(count - m->ticks), way = count > m->ticks ? 1.0 : -1.0;
    m->span = way == m->way ? (at - m->edge) / many : 0.0;
    m->edge = at;
    m->way = way;
    m->ticks = count;
}

static double period_speed(const Sensor *p, const Memory *m, double time)
{
    double waited = time - m->edge, angle = 2.0 * PI / p->lines;
    if (m->span <= 0.0 || waited > p->timeout) return 0.0;
    return m->way * angle / (waited > m->span ? waited : m->span);
}

static double sense(const Sensor *p, Memory *m, const DriveState *s, double time, double noise)
{
    double dt = time - m->last_time, y;
    if (p->kind == 0.0) {
        y = (p->filter_time > 0.0 ? m->tacho : seen_speed(p, s)) + noise;
    } else if (p->kind == 3.0) {
        y = (p->lines > 0.0 ? m->ticks * 2.0 * PI / p->lines : seen_angle(p, s->angle)) + noise;
    } else {
        if (p->kind == 1.0) {
            y = dt > 0.0 ? (m->ticks - m->last_ticks) * 2.0 * PI / p->lines / dt : 0.0;
        } else {
            y = period_speed(p, m, time);
        }
        y += noise;
        if (p->filter_time > 0.0) {
            m->filtered += (y - m->filtered) * (1.0 - exp(-dt / p->filter_time));
            y = m->filtered;
        }
    }
    m->last_ticks = m->ticks;
    m->last_time = time;
    return p->signless > 0.0 ? fabs(y) : y;
}

/* From the command on the wire to the duty at the bridge. */
static double firmware(const Firmware *p, Memory *m, double step)
{
    double d = m->target;
    if (p->expo != 0.0) d += p->expo * (d - d * d * d);
    if (p->soft_start > 0.0) d = m->soft += (d - m->soft) * (1.0 - exp(-step / p->soft_start));
    if (p->slew > 0.0) {
        double most = p->slew * step, change = d - m->slewed;
        d = m->slewed += change > most ? most : change < -most ? -most : change;
    }
    double size = fabs(d), side = d > 0.0 ? 1.0 : -1.0;
    if (size > p->largest) size = p->largest;
    if (size < p->shortest_pulse) return 0.0;
    size -= p->turn_on;
    if (size <= 0.0) return 0.0;
    if (p->bits > 0.0) {
        double levels = exp2(p->bits);
        size = floor(size * levels + 0.5) / levels;
    }
    return side * size;
}

static double controlled(const Controller *p, Memory *m, double reference, double y, double dt)
{
    double error = reference - y, slope = (y - m->last) / dt;
    double u = p->proportional * error + m->sum + p->integral * error * dt - p->derivative * slope;
    m->last = y;
    if (fabs(u) <= 1.0) m->sum += p->integral * error * dt; /* no wind-up */
    return u > 1.0 ? 1.0 : u < -1.0 ? -1.0 : u;
}

static void rates(const Machine *p, const State *s, const Held *held, int drives, State *d)
{
    double ground[2] = {0.0, 0.0};
    const Battery *b = &p->battery;
    memset(d, 0, sizeof *d);
    if (p->body.mass > 0.0) {
        ground_torques(&p->body, s, held, ground, d);
    } else {
        double left = p->body.radius_left * s->drive[0].speed;
        double right = p->body.radius_right * s->drive[1].speed;
        double way = 0.5 * (left + right);
        d->x = way * cos(s->heading);
        d->y = way * sin(s->heading);
        d->heading = (right - left) / p->body.width;
    }
    d->used = bus_current(s, held, drives);
    if (b->slow_resistance > 0.0)
        d->polarisation = (d->used * b->slow_resistance - s->polarisation) / b->slow_time;
    for (int k = 0; k < drives; k++)
        drive_rates(&p->drives[k], &s->drive[k], &held[k], ground[k], &d->drive[k]);
}

static void hold(const Machine *p, const State *s, int drives, Held held[2])
{
    double ground[2] = {0.0, 0.0};
    State d;
    memset(&d, 0, sizeof d);
    if (p->body.mass > 0.0) {
        ground_torques(&p->body, s, held, ground, &d); /* with the loads of the step before */
        hold_loads(&p->body, s, &d, held);
    }
    double bus = bus_voltage(&p->battery, s, held, drives);
    for (int k = 0; k < drives; k++) {
        held[k].bus = bus;
        hold_bridge(&p->drives[k], &s->drive[k], &held[k]);
        hold_friction(&p->drives[k], &s->drive[k], ground[k], &held[k]);
    }
}

static void along(const State *s, const State *d, double h, State *out)
{
    const double *a = (const double *)s, *b = (const double *)d;
    double *o = (double *)out;
    for (int i = 0; i < NUMBERS; i++) o[i] = a[i] + h * b[i];
}

static void advance(const Machine *p, State *s, const Held *held, int drives, double h)
{
    State k1, k2, k3, k4, at, next;
    rates(p, s, held, drives, &k1);
    along(s, &k1, 0.5 * h, &at);
    rates(p, &at, held, drives, &k2);
    along(s, &k2, 0.5 * h, &at);
    rates(p, &at, held, drives, &k3);
    along(s, &k3, h, &at);
    rates(p, &at, held, drives, &k4);
    const double *a = (const double *)&k1, *b = (const double *)&k2, *c = (const double *)&k3,
                 *e = (const double *)&k4, *o = (const double *)s;
    double *n = (double *)&next;
    for (int i = 0; i < NUMBERS; i++)
        n[i] = o[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + e[i]);
    for (int k = 0; k < drives; k++) {
        const Drive *drive = &p->drives[k];
        DriveState *now = &next.drive[k];
        project_friction(drive, &held[k], now);
        now->current = drive->motor.inductance > 0.0
                           ? project_current(drive, &held[k], s->drive[k].current, now->current)
                           : still_current(drive, &held[k], now);
    }
    *s = next;
}

static void note(const Machine *p, const State *s, const Held *held, int drives, int k,
                 double *out)
{
    double constant, w, emf = back_emf(&p->drives[k], &s->drive[k], &constant, &w);
    out[TRUTH_SPEED] = s->drive[k].speed;
    out[TRUTH_ANGLE] = s->drive[k].angle;
    out[TRUTH_CURRENT] = s->drive[k].current;
    out[TRUTH_BUS] = bus_voltage(&p->battery, s, held, drives);
    out[TRUTH_DUTY] = held[k].duty;
    out[TRUTH_WINDING] = s->drive[k].winding;
    out[TRUTH_MOTOR_SPEED] = w;
    out[TRUTH_VOLTAGE] = bridge_voltage(&p->drives[k], &held[k], s->drive[k].current, emf);
}

/* All events of a step, in the order in which they can know of each other. */
static void events(const Machine *p, const Run *r, State *s, Held *held, Memory *memory,
                   int64_t step, int64_t at[3])
{
    int n = (int)r->drives;
    double time = (double)step * r->step;
    const Controller *c = &p->controller;
    int closed = c->proportional != 0.0 || c->integral != 0.0 || c->derivative != 0.0;
    for (; at[0] < r->readings && r->read_at[at[0]] <= step; at[0]++)
        for (int k = 0; k < n; k++)
            r->reading[at[0] * n + k] = sense(&p->drives[k].sensor, &memory[k], &s->drive[k], time,
                                              r->noise[at[0] * n + k]);
    for (; at[1] < r->rows && r->row_at[at[1]] <= step; at[1]++)
        for (int k = 0; k < n; k++) {
            int64_t row = at[1] * n + k, newest = r->newest[at[1]];
            double dt = at[1] ? (double)(r->row_at[at[1]] - r->row_at[at[1] - 1]) * r->step : 1.0;
            note(p, s, held, n, k, &r->truth[row * TRUTH]);
            held[k].disturbance = r->disturbance[row];
            if (closed)
                r->command[row] = controlled(c, &memory[k], r->command[row],
                                             newest < 0 ? 0.0 : r->reading[newest * n + k], dt);
        }
    for (; at[2] < r->rows && r->acts_at[at[2]] <= step; at[2]++)
        for (int k = 0; k < n; k++) memory[k].target = r->command[at[2] * n + k];
    if (step % POSE_STEPS == 0) {
        double *pose = &r->pose[step / POSE_STEPS * 3];
        pose[0] = s->x;
        pose[1] = s->y;
        pose[2] = s->heading;
    }
}

/* Runs a machine from rest; 0, or the step at which a number was no longer finite. */
int64_t run(const Machine *p, const Run *r)
{
    State s;
    Held held[2];
    Memory memory[2];
    int64_t at[3] = {0, 0, 0};
    int n = (int)r->drives;
    memset(&s, 0, sizeof s);
    memset(held, 0, sizeof held);
    memset(memory, 0, sizeof memory);
    for (int k = 0; k < 2; k++)
        held[k].load = 0.5 * p->body.mass * p->body.gravity * cos(p->body.slope);
    hold(p, &s, n, held);
    for (int64_t step = 0; step <= r->steps; step++) {
        events(p, r, &s, held, memory, step, at);
        double before[2];
        for (int k = 0; k < n; k++) {
            before[k] = seen_angle(&p->drives[k].sensor, s.drive[k].angle);
            held[k].duty = firmware(&p->drives[k].firmware, &memory[k], r->step);
        }
        for (int64_t j = 0; j < r->substeps; j++) {
            hold(p, &s, n, held);
            advance(p, &s, held, n, r->step / (double)r->substeps);
        }
        for (int k = 0; k < n; k++) {
            const Sensor *sensor = &p->drives[k].sensor;
            if (sensor->lines > 0.0)
                watch(sensor, &memory[k], before[k], seen_angle(sensor, s.drive[k].angle),
                      (double)step * r->step, r->step);
            if (sensor->kind == 0.0 && sensor->filter_time > 0.0)
                memory[k].tacho += (seen_speed(sensor, &s.drive[k]) - memory[k].tacho)
                                   * (1.0 - exp(-r->step / sensor->filter_time));
            if (!isfinite(s.drive[k].speed) || !isfinite(s.drive[k].current)) return step + 1;
        }
    }
    return 0;
}
