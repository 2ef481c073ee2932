/* From reset to main on QEMU's boards mps2-an386 (Cortex-M4F) and mps2-an500 (Cortex-M7).

   What the C library does after `_start`, such as clearing .bss and printing over semihosting, is newlib's. */
#include <stdint.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88u) /* which coprocessors may be used */
#define FLOATING_POINT (0xFu << 20)

extern uint32_t __stack; /* of the linker script: where the stack begins */
void _start(void);
void on_reset(void);
void on_fault(void);
void SysTick_Handler(void);

void on_reset(void)
{
    CPACR |= FLOATING_POINT;
    __asm volatile("dsb\n isb");
    _start();
}

/* Nothing is left to be done here: QEMU is told to end with an error (SYS_EXIT, internal error). */
void on_fault(void)
{
    for (;;) {
        __asm volatile("mov r0, #0x18\n mov r1, #0x20000\n add r1, r1, #0x24\n bkpt 0xAB" ::: "r0", "r1", "memory");
    }
}

/* A program that has a use for the timer has a handler of its own. */
__attribute__((weak)) void SysTick_Handler(void)
{
    on_fault();
}

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &__stack, (void *)on_reset, (void *)on_fault, (void *)on_fault, (void *)on_fault, (void *)on_fault,
    (void *)on_fault, 0, 0, 0, 0, (void *)on_fault, (void *)on_fault, 0, (void *)on_fault, (void *)SysTick_Handler,
};
