/* One free run of the chain command -> torque -> speed -> reading; see chain.py. Generated around it:
 * TRACKS, OUTPUTS, ORDER, ROWS, DT, EFFECTS, and of each effect its functions (constants, rest, step, holds).
 * Of one machine with several inputs each input is a track, a copy of the machine that feels the torque of all; the first is read. */

#define SEEN(i) ((i) < OUTPUTS ? (i) : 0)

typedef struct {
    double t[1], log[1];
    double w[TRACKS], w_free[TRACKS], b[TRACKS], torque[TRACKS], torque_other[TRACKS], drive[TRACKS];
    double turned[TRACKS], counted[TRACKS], holds[TRACKS], gain[TRACKS], driven[TRACKS];
} Context;

@EFFECTS@

typedef void (*Constants)(const double *, const double *, double *);
typedef void (*Step)(const Context *, const double *, const double *, double *, double *);
typedef void (*Rest)(const double *, const double *, double *);
typedef void (*Holds)(const double *, double *);
typedef void (*Undone)(const double *, double *);

enum { COMMAND, TORQUE, SPEED, READING };

typedef struct {
    int place, drives, row, rows, constant, state, states;
    Constants constants; Step step; Rest rest; Holds holds; Undone undone;
} Effect;

static const Effect EFFECT[EFFECTS + 1] = {
@TABLE@
    {0}
};

typedef struct {
    const double *drive, *y, *moving, *counted, *t, *log, *reset;
    long rows;
} Data;

/* The effects of one place, in the order in which they act. */
typedef struct {
    const Effect *acting[EFFECTS + 1];
    int n;
} Acting;

static inline void through(const Acting *at, Context *c, const double *torque,
                           const double *p, const double *k, double *s, double *signal) {
    if (!at->n) return;
    for (int i = 0; i < TRACKS; i++) {
        c->torque[i] = torque[i];
        c->torque_other[i] = TRACKS > 1 ? torque[TRACKS - 1 - i] : 0.0;
        c->driven[i] = signal[i];
    }
    for (int j = 0; j < at->n; j++) {
        const Effect *e = at->acting[j];
        e->step(c, p + e->row * TRACKS, k + e->constant, s + e->state, signal);
        if (e->drives)
            for (int i = 0; i < TRACKS; i++) c->driven[i] = signal[i];
    }
}

/* table: rows of parameters (ROWS, TRACKS), the core's first: gain, f_1 ..., b_2 ... */
static void run(const double *p, const unsigned char *acts, const Data *d, double *out) {
    double b[ORDER][TRACKS], kept[TRACKS], k[CONSTANTS + 1], s[STATES + 1], x[ORDER][TRACKS], turned[TRACKS];
    const double *gain = p, *f = p + TRACKS;
    const Effect *acting[EFFECTS + 1];
    Acting at[4] = {{{0}, 0}, {{0}, 0}, {{0}, 0}, {{0}, 0}};
    int n = 0;
    Context c;
    for (int i = 0; i < TRACKS; i++) {
        double sum = 1.0, tail = 0.0;
        for (int r = 0; r < ORDER; r++) sum += f[r * TRACKS + i];
        for (int r = 1; r < ORDER; r++) tail += b[r][i] = p[(ORDER + r) * TRACKS + i];
        b[0][i] = sum - tail;
        kept[i] = fmin(fmax(1.0 - b[0][i], 1e-9), 1.0);
        c.b[i] = b[0][i];
        c.gain[i] = gain[i];
        c.holds[i] = turned[i] = 0.0;
        for (int r = 0; r < ORDER; r++) x[r][i] = 0.0;
    }
    for (int e = 0; e < EFFECTS; e++) {
        double holds[TRACKS];
        if (!acts[e]) continue;
        acting[n++] = EFFECT + e;
        at[EFFECT[e].place].acting[at[EFFECT[e].place].n++] = EFFECT + e;
        if (EFFECT[e].constants) EFFECT[e].constants(p + EFFECT[e].row * TRACKS, kept, k + EFFECT[e].constant);
        if (!EFFECT[e].holds) continue;
        EFFECT[e].holds(p + EFFECT[e].row * TRACKS, holds);
        for (int i = 0; i < TRACKS; i++) c.holds[i] += holds[i];
    }
    for (long m = 0; m < d->rows; m++) {
        const double *drive = d->drive + m * TRACKS, *counted = d->counted + m * OUTPUTS;
        double w[TRACKS], now[TRACKS], torque[TRACKS], read[TRACKS], wanted[TRACKS], first[TRACKS];
        c.t[0] = d->t[m];
        c.log[0] = d->log[m];
        if (d->reset[m] > 0.0) {
            for (int i = 0; i < TRACKS; i++) w[i] = d->y[m * OUTPUTS + SEEN(i)];
            for (int j = n - 1; j >= 0; j--)
                if (acting[j]->undone) acting[j]->undone(p + acting[j]->row * TRACKS, w);
            for (int i = 0; i < TRACKS; i++) {
                x[0][i] = w[i];
                for (int r = 1; r < ORDER; r++) {
                    x[r][i] = 0.0;
                    for (int q = r; q < ORDER; q++) x[r][i] += (b[q][i] - f[q * TRACKS + i]) * w[i];
                }
                turned[i] = counted[SEEN(i)];
                now[i] = drive[i] * d->moving[m * TRACKS + i];
            }
            for (int j = 0; j < n; j++)
                if (acting[j]->states) acting[j]->rest(w, now, s + acting[j]->state);
        }
        for (int i = 0; i < TRACKS; i++) {
            read[i] = w[i] = x[0][i];
            now[i] = c.drive[i] = drive[i];
            c.w[i] = w[i];
            c.w_free[i] = (ORDER > 1 ? x[1 % ORDER][i] : 0.0) - f[i] * w[i];
            c.turned[i] = turned[i];
            c.counted[i] = counted[SEEN(i)];
            torque[i] = gain[i] * drive[i];
        }
        through(&at[READING], &c, torque, p, k, s, read);
        for (int i = 0; i < OUTPUTS; i++) out[m * OUTPUTS + i] = read[i];
        through(&at[COMMAND], &c, torque, p, k, s, now);
        for (int i = 0; i < TRACKS; i++) wanted[i] = gain[i] * now[i];
        for (int i = OUTPUTS; i < TRACKS; i++) wanted[0] += wanted[i];
        for (int i = 0; i < TRACKS; i++) torque[i] = wanted[i] = wanted[i < OUTPUTS ? i : 0];
        through(&at[TORQUE], &c, wanted, p, k, s, torque);
        for (int i = 0; i < TRACKS; i++) {
            first[i] = (ORDER > 1 ? x[1 % ORDER][i] : 0.0) - f[i] * w[i] + b[0][i] * torque[i];
            for (int r = 1; r < ORDER; r++)
                x[r][i] = (r + 1 < ORDER ? x[(r + 1) % ORDER][i] : 0.0) - f[r * TRACKS + i] * w[i] + b[r][i] * torque[i];
        }
        through(&at[SPEED], &c, wanted, p, k, s, first);
        for (int i = 0; i < TRACKS; i++) {
            turned[i] += 0.5 * DT * (w[i] + first[i]);
            x[0][i] = first[i];
        }
    }
}

/* Runs of a batch: q (batch, parameters), index (ROWS, TRACKS) into it, out (batch, rows, TRACKS). */
void runs(long batch, long parameters, const double *q, const double *null, const long *index, const Data *d, double *out) {
    for (long item = 0; item < batch; item++) {
        double p[ROWS * TRACKS];
        unsigned char acts[EFFECTS + 1];
        for (int r = 0; r < ROWS * TRACKS; r++) p[r] = q[item * parameters + index[r]];
        for (int e = 0; e < EFFECTS; e++) {
            acts[e] = 0;
            for (int r = EFFECT[e].row * TRACKS; r < (EFFECT[e].row + EFFECT[e].rows) * TRACKS; r++)
                acts[e] |= p[r] != null[index[r]];
        }
        run(p, acts, d, out + item * d->rows * OUTPUTS);
    }
}
