/* The example on a board with an STM32G431, bare metal: CAN FD on PB8 and PB9 (500 kbit/s and 2 Mbit/s), drives PA5,
 * reads PC13. The clock is the internal oscillator, 16 MHz (see stm32f4_bxcan/main.c). Built with MSBOT_CAN_DATA=64.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#define CLOCKS_PER_US 16U
#include "../cortex_m.h"

#include "../fdcan.h"
#include "../pin_board.h"

#include <string.h>

#define RCC_AHB2ENR REGISTER(0x4002104CU)
#define RCC_APB1ENR1 REGISTER(0x40021058U)
#define RCC_CCIPR REGISTER(0x40021088U)
#define GPIOA 0x48000000U
#define GPIOB 0x48000400U
#define GPIOC 0x48000800U
#define MODE(port) REGISTER((port) + 0x00)
#define INPUT(port) REGISTER((port) + 0x10)
#define SET_RESET(port) REGISTER((port) + 0x18)
#define ALTERNATE_HIGH(port) REGISTER((port) + 0x24)
#define UNIQUE_ID 0x1FFF7590U
#define NVIC_ENABLE0 REGISTER(0xE000E100U)

static void can_handler(void) { fdcan_interrupt(); }

__attribute__((section(".vectors"), used)) const vector VECTORS[16 + 22] = {SYSTEM_VECTORS, [16 + 21] = can_handler};

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
    static const msbot_controller controller = {NULL,           fdcan_on_bus, fdcan_receive, fdcan_pending,
                                                fdcan_has_room, fdcan_send,   micros};
    RCC_AHB2ENR |= 7U;                          /* ports A, B, C */
    RCC_CCIPR = (RCC_CCIPR & ~(3U << 24)) | 2U << 24; /* FDCAN is clocked by PCLK1 */
    RCC_APB1ENR1 |= 1U << 25;                   /* FDCAN */
    SET_RESET(GPIOA) = 1U << (5 + 16);
    MODE(GPIOA) = (MODE(GPIOA) & ~(3U << 10)) | 1U << 10;
    MODE(GPIOC) &= ~(3U << 26); /* all pins are analogue after reset */
    ALTERNATE_HIGH(GPIOB) = (ALTERNATE_HIGH(GPIOB) & ~0xFFU) | 0x99U; /* PB8, PB9: AF9 */
    MODE(GPIOB) = (MODE(GPIOB) & ~(15U << 16)) | 10U << 16;
    start_clock();
    uint32_t words[3] = {REGISTER(UNIQUE_ID), REGISTER(UNIQUE_ID + 4), REGISTER(UNIQUE_ID + 8)};
    uint32_t numbers[2] = {msbot_crc32((const uint8_t *)words, sizeof words), words[0] ^ words[2]};
    uint8_t uid[8];
    memcpy(uid, numbers, sizeof uid);
    /* 16 MHz: 32 quanta a bit at 500 kbit/s, 8 at 2 Mbit/s; both sampled at 75 %. */
    fdcan_open(FDCAN_TIMING(1U, 23U, 8U, 8U), FDCAN_DATA_TIMING(1U, 5U, 2U, 2U));
    if (pin_board_init(&pins, uid, (SYSTICK_VALUE ^ words[1]) | 1U, 500000) != MSBOT_CONFIG_OK) {
        return 1;
    }
    NVIC_ENABLE0 = 1U << 21;
    for (;;) {
        if (pin_board_turn(&controller) > 0) {
            __asm volatile("wfi");
        }
    }
}
