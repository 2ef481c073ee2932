/* What a step costs in QEMU: instructions, and stack with all that is called.

   With -icount shift=SHIFT an instruction lasts 2^SHIFT ns of the machine's time; SysTick counts its clock of 25 MHz down.
   A step may have 10 million instructions at most. What measuring itself costs is taken off. */
#include <stdint.h>
#include <stdio.h>

#ifndef SHIFT
#define SHIFT 6
#endif

#define TICK_NS 40.0
#define PAINT 0x5AFE57ACu
#define PAINTED 2048u /* words below the caller's stack */

static struct {
    uint32_t began; /* ticks */
    double overhead; /* instructions */
    double least;
    double most;
    double sum;
    double count;
    uint32_t stack; /* bytes */
    volatile uint32_t *bottom; /* of what is painted */
    uintptr_t top; /* of the stack that a step begins with */
} measured_steps = { 0u, 0.0, 1.0e12, 0.0, 0.0, 0.0, 0u, NULL, 0u };

static volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010u; /* control, reload, value */

static inline uint32_t ticks(void)
{
    return systick[2];
}

static double instructions_since(uint32_t began, uint32_t now)
{
    return (double)((began - now) & 0xFFFFFFu) * TICK_NS / (double)(1u << SHIFT);
}

/* The stack is painted below its end, which is the caller's. */
__attribute__((noinline)) static void paint(void)
{
    const uintptr_t top = (uintptr_t)__builtin_dwarf_cfa();
    volatile uint32_t *const here = (volatile uint32_t *)(uintptr_t)__builtin_frame_address(0) - 16;
    measured_steps.top = top;
    measured_steps.bottom = (volatile uint32_t *)top - PAINTED;
    for (volatile uint32_t *word = measured_steps.bottom; word < here; word++) {
        *word = PAINT;
    }
}

/* Around every step. */
static inline void begin_step(void)
{
    paint();
    if (systick[0] == 0u) {
        systick[1] = 0xFFFFFFu;
        systick[2] = 0u;
        systick[0] = 5u; /* the processor's clock, no interrupt */
        while (ticks() == 0u) {
        }
        measured_steps.began = ticks();
        measured_steps.overhead = instructions_since(measured_steps.began, ticks());
    }
    measured_steps.began = ticks();
}

static inline void end_step(void)
{
    const uint32_t now = ticks();
    const volatile uint32_t *word = measured_steps.bottom;
    double count;
    while (((uintptr_t)word < measured_steps.top) && (*word == PAINT)) {
        word++;
    }
    if ((measured_steps.top - (uintptr_t)word) > measured_steps.stack) {
        measured_steps.stack = (uint32_t)(measured_steps.top - (uintptr_t)word);
    }
    count = instructions_since(measured_steps.began, now) - measured_steps.overhead; /* after the stack was looked at */
    measured_steps.least = (count < measured_steps.least) ? count : measured_steps.least;
    measured_steps.most = (count > measured_steps.most) ? count : measured_steps.most;
    measured_steps.sum += count;
    measured_steps.count += 1.0;
}

__attribute__((noinline)) static void do_nothing(void)
{
    __asm volatile(".rept 1000\n nop\n .endr" ::: "memory");
}

/* How many instructions a thousand are told to be. */
static double told_of_a_thousand(void)
{
    const uint32_t began = ticks();
    do_nothing();
    return instructions_since(began, ticks()) - measured_steps.overhead;
}

/* What benchmarks/microcontroller.py reads. */
static void print_measured(void)
{
    (void)printf("instructions a step: least %.0f, mean %.0f, most %.0f; stack %lu; 1000 are told to be %.0f\n",
        measured_steps.least, measured_steps.sum / measured_steps.count, measured_steps.most,
        (unsigned long)measured_steps.stack, told_of_a_thousand());
}
