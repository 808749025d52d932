/* The example on a board with an STM32F405, bare metal: CAN on PB8 and PB9 (500 kbit/s), drives PA5, reads PC13.
 *
 * Without a crystal: 16 MHz from the internal oscillator. Its 1 % is too little for a long bus; on one, run the clock from a
 * crystal and change CLOCKS_PER_US and the timing.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#define CLOCKS_PER_US 16U
#include "../cortex_m.h"

#include "../bxcan.h"
#include "../pin_board.h"

#include <string.h>

#define RCC_AHB1ENR REGISTER(0x40023830U)
#define RCC_APB1ENR REGISTER(0x40023840U)
#define GPIOA 0x40020000U
#define GPIOB 0x40020400U
#define GPIOC 0x40020800U
#define MODE(port) REGISTER((port) + 0x00)
#define INPUT(port) REGISTER((port) + 0x10)
#define SET_RESET(port) REGISTER((port) + 0x18)
#define ALTERNATE_HIGH(port) REGISTER((port) + 0x24)
#define UNIQUE_ID 0x1FFF7A10U
#define NVIC_ENABLE0 REGISTER(0xE000E100U)

static void can_sent_handler(void) { bxcan_interrupt(); }

/* A frame only wakes the processor; `main` reads it. The interrupt stays pending until then, so it is disabled. */
static void can_received_handler(void) { REGISTER(0xE000E180U) = 1U << 20; }

__attribute__((section(".vectors"), used)) const vector VECTORS[16 + 21] = {
    SYSTEM_VECTORS, [16 + 19] = can_sent_handler, [16 + 20] = can_received_handler};

static void drive_pin(void *context, bool high)
{
    (void)context;
    SET_RESET(GPIOA) = high ? 1U << 5 : 1U << (5 + 16);
}

static bool read_pin(void *context)
{
    (void)context;
    return (INPUT(GPIOC) & 1U << 13) != 0;
}

int main(void)
{
    static const pin_board_pins pins = {drive_pin, read_pin, NULL};
    static const msbot_controller controller = {NULL,           bxcan_on_bus, bxcan_receive, bxcan_pending,
                                                bxcan_has_room, bxcan_send,   micros};
    RCC_AHB1ENR |= 7U;       /* ports A, B, C */
    RCC_APB1ENR |= 1U << 25; /* CAN1 */
    SET_RESET(GPIOA) = 1U << (5 + 16); /* set low before it becomes an output */
    MODE(GPIOA) = (MODE(GPIOA) & ~(3U << 10)) | 1U << 10;
    ALTERNATE_HIGH(GPIOB) = (ALTERNATE_HIGH(GPIOB) & ~0xFFU) | 0x99U; /* PB8, PB9: AF9 */
    MODE(GPIOB) = (MODE(GPIOB) & ~(15U << 16)) | 10U << 16;
    start_clock();
    /* The unique number has 96 bits: lot, wafer and position; all of it is folded into 64. */
    uint32_t words[3] = {REGISTER(UNIQUE_ID), REGISTER(UNIQUE_ID + 4), REGISTER(UNIQUE_ID + 8)};
    uint32_t numbers[2] = {msbot_crc32((const uint8_t *)words, sizeof words), words[0] ^ words[2]};
    uint8_t uid[8];
    memcpy(uid, numbers, sizeof uid);
    /* 16 MHz / 2 = 8 MHz; 1 + 13 + 2 quanta: 500 kbit/s, sampled at 87.5 %. */
    bxcan_open(BXCAN_TIMING(2U, 13U, 2U));
    /* The time that the bus made us wait differs from start to start; on a chip with an RNG, use that. */
    if (pin_board_init(&pins, uid, (SYSTICK_VALUE ^ words[1]) | 1U, 500000) != MSBOT_CONFIG_OK) {
        return 1;
    }
    NVIC_ENABLE0 = 3U << 19;
    for (;;) {
        if (pin_board_turn(&controller) > 0) {
            NVIC_ENABLE0 = 1U << 20;
            __asm volatile("wfi");
        }
    }
}
