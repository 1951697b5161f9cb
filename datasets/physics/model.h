/* States, what is held within a step, and the functions between the files.
 * parameters.h is written from parameters.py when this is compiled. */
#ifndef PHYSICS_MODEL_H
#define PHYSICS_MODEL_H

#include "parameters.h"

#define PI 3.14159265358979323846
#define POINTS 4 /* in which a track touches the ground */

typedef struct {
    double current;       /* A */
    double motor_speed;   /* rad/s, of the motor's shaft where the gear has a gap */
    double motor_angle;   /* rad */
    double speed;         /* rad/s, output */
    double angle;         /* rad */
    double motor_bristle; /* rad */
    double bristle;       /* rad */
    double creep;         /* rad, slow end of a creeping belt */
    double winding;       /* K above the air */
    double housing;       /* K above the air */
} DriveState;

typedef struct {
    double used;         /* A s taken from the battery */
    double polarisation; /* V */
    double forward;      /* m/s, in the frame of the body */
    double sideways;     /* m/s */
    double turning;      /* rad/s */
    double x, y;         /* m */
    double heading;      /* rad */
    DriveState drive[2];
} State;

#define NUMBERS ((int)(sizeof(State) / sizeof(double)))

/* What a step decides at its beginning and keeps until its end. */
typedef struct {
    double duty;        /* at the bridge */
    double bus;         /* V */
    int rectifying;     /* the current has one sign or is zero */
    double side;        /* that sign; 0: it decays whatever its sign */
    double flows;       /* sign of the current */
    int blocked;        /* no current flows: the diodes hold it */
    double motor_sign;  /* of dry friction; 0: it sticks */
    double sign;
    double disturbance; /* N m on the output */
    double load;        /* N on the ground under the track */
} Held;

double back_emf(const Drive *p, const DriveState *s, double *constant, double *motor_speed);
double bus_voltage(const Battery *b, const State *s, const Held *held, int drives);
double bus_current(const State *s, const Held *held, int drives);
double bridge_voltage(const Drive *p, const Held *h, double current, double emf);
double still_current(const Drive *p, const Held *h, const DriveState *s);
void hold_bridge(const Drive *p, const DriveState *s, Held *h);
double project_current(const Drive *p, const Held *h, double before, double now);
double winding_resistance(const Drive *p, const DriveState *s);

double gear_ratio(const Gearbox *g, double angle, double *slope);
void hold_friction(const Drive *p, const DriveState *s, double ground, Held *h);
void project_friction(const Drive *p, const Held *h, DriveState *now);
void drive_rates(const Drive *p, const DriveState *s, const Held *h, double ground, DriveState *d);

void ground_torques(const Body *b, const State *s, const Held *held, double torque[2], State *d);
void hold_loads(const Body *b, const State *s, const State *d, Held *held);

#endif
