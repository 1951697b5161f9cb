/* Start-up of a Cortex-M4F as qemu-system-arm has it (mps2-an386), with newlib and semihosting. */
#include <stdlib.h>

/* of the linker script */
extern unsigned __bss_start__[], __bss_end__[], __stack[];
/* of newlib, and of timing.c */
extern void initialise_monitor_handles(void);
extern void report_timing(void);
extern void start_timing(void);
int main(void);
void reset(void);
void fault(void);

void reset(void)
{
    unsigned *word;
    int code;

    *(volatile unsigned *)0xE000ED88 |= 0xFu << 20; /* CPACR: the floating-point unit is on */
    __asm volatile("dsb\n\tisb");
    for (word = __bss_start__; word < __bss_end__; word++)
        *word = 0;
    initialise_monitor_handles();
    start_timing();
    code = main();
    report_timing();
    exit(code);
}

/* any fault ends the program with a failure: nothing waits for ever */
void fault(void)
{
    register unsigned reason __asm("r0") = 0x18;     /* SYS_EXIT */
    register unsigned how __asm("r1") = 0x20023;     /* run-time error */
    __asm volatile("bkpt 0xAB" : : "r"(reason), "r"(how) : "memory");
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    __stack, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
    (void *)fault, 0, 0, 0, 0, (void *)fault, (void *)fault, 0, (void *)fault, (void *)fault,
};

/* what timing.c calls to know what a call takes */
void nothing(void *a, const void *b, const void *c, void *d);
void nothing(void *a, const void *b, const void *c, void *d)
{
    (void)a;
    (void)b;
    (void)c;
    (void)d;
}

/* what newlib calls at the end where nothing is to be done */
void _fini(void);
void _fini(void) {}
