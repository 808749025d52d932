/* What every program of the examples needs below its `main`: the first instructions after reset, and a clock.
 *
 * Include it in one file, which defines CLOCKS_PER_US before it, and VECTORS after it.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef CORTEX_M_H
#define CORTEX_M_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010U)
#define SYSTICK_LOAD REGISTER(0xE000E014U)
#define SYSTICK_VALUE REGISTER(0xE000E018U)
#define TICK_US 4000U

typedef void (*vector)(void);

extern uint32_t _etext, _data, _edata, _bss, _ebss, _stack;
int main(void);
void Reset_Handler(void);

static volatile uint32_t ticks;

static void systick_handler(void) { ticks++; }

static void fault_handler(void)
{
    for (;;) { /* a watchdog would restart the board, with its pins at their reset values */
    }
}

void Reset_Handler(void)
{
    const uint32_t *from = &_etext;
    for (uint32_t *to = &_data; to < &_edata;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &_bss; to < &_ebss;) {
        *to++ = 0;
    }
    (void)main();
    fault_handler();
}

static void start_clock(void)
{
    SYSTICK_LOAD = CLOCKS_PER_US * TICK_US - 1U;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7;
}

static uint32_t micros(void *context)
{
    (void)context;
    for (;;) {
        uint32_t before = ticks;
        uint32_t value = SYSTICK_VALUE;
        if (before == ticks) {
            return before * TICK_US + (TICK_US - 1U - value / CLOCKS_PER_US);
        }
    }
}

/* The first 16 vectors. */
#define SYSTEM_VECTORS \
    (vector)(uintptr_t)&_stack, Reset_Handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, \
        0, 0, 0, 0, fault_handler, fault_handler, 0, fault_handler, systick_handler

#endif
