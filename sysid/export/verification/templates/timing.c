/* Instructions of each step function: the linker puts __wrap_NAME in the place of NAME.
 *
 * With -icount shift=0 an instruction takes a nanosecond of the emulated time, and SysTick counts
 * down once in 40 ns. What a call of nothing takes is subtracted. A function that another timed
 * one calls is not timed there: its caller's count is that of both.
 */
#include <stdio.h>

#define CONTROL (*(volatile unsigned long *)0xE000E010)
#define RELOAD (*(volatile unsigned long *)0xE000E014)
#define CURRENT (*(volatile unsigned long *)0xE000E018)
#define TICKS 0xFFFFFFul
#define INSTRUCTIONS_A_TICK 40.0
#define CALLS_OF_NOTHING 1000

typedef struct {
    unsigned long ticks;
    unsigned long most;
    unsigned long calls;
} spent;

static int inside;

void start_timing(void);
void report_timing(void);
void nothing(void *a, const void *b, const void *c, void *d);

/* weak: a program need not have all functions of the package */
#define TIMED(name)                                                                                \
    __attribute__((weak)) void __real_##name(void *a, const void *b, const void *c, void *d);      \
    void __wrap_##name(void *a, const void *b, const void *c, void *d);                            \
    static spent of_##name;                                                                        \
    void __wrap_##name(void *a, const void *b, const void *c, void *d)                             \
    {                                                                                              \
        unsigned long begun, took;                                                                 \
        if (inside) {                                                                              \
            __real_##name(a, b, c, d);                                                             \
            return;                                                                                \
        }                                                                                          \
        inside = 1;                                                                                \
        begun = CURRENT;                                                                           \
        __real_##name(a, b, c, d);                                                                 \
        took = (begun - CURRENT) & TICKS;                                                          \
        inside = 0;                                                                                \
        of_##name.ticks += took;                                                                   \
        of_##name.calls += 1;                                                                      \
        if (took > of_##name.most)                                                                 \
            of_##name.most = took;                                                                 \
    }

TIMED(nothing)
$timed
static double mean(const spent *s)
{
    return s->calls > 0 ? INSTRUCTIONS_A_TICK * (double)s->ticks / (double)s->calls : 0.0;
}

static void tell(const char *name, const spent *s)
{
    const double idle = mean(&of_nothing);

    if (s->calls > 0)
        printf("instructions %s %.0f %.0f\n", name, mean(s) - idle,
               INSTRUCTIONS_A_TICK * (double)s->most - idle);
}

void start_timing(void)
{
    RELOAD = TICKS;
    CURRENT = 0;
    CONTROL = 5; /* on, by the processor's clock, without interrupts */
}

void report_timing(void)
{
    int k;

    for (k = 0; k < CALLS_OF_NOTHING; k++)
        nothing(NULL, NULL, NULL, NULL);
$told
}
