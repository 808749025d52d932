/* The example on an STM32F405 as QEMU emulates it (`-M netduinoplus2`): bare metal, one file.
 *
 * QEMU has neither the bxCAN nor the pins of this chip. So the bus is a serial line (USART1, slcan), and the two pins
 * are another one (USART2): each driven level is written there as 0 or 1, and each 0 or 1 received is the level of the
 * pin that is read. All else is the firmware as it runs on a real board.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "../pin_board.h"
#include "../slcan.h"

#define CLOCKS_PER_US 168U
#include "../cortex_m.h"

#define USART1 0x40011000U
#define USART2 0x40004400U
#define STATUS(usart) REGISTER((usart) + 0x00)
#define DATA(usart) REGISTER((usart) + 0x04)
#define CONTROL(usart) REGISTER((usart) + 0x0C)
#define RECEIVED 0x20U
#define SENDS 0x80U
#define NVIC_ENABLE1 REGISTER(0xE000E104U)

/* Octets from USART1 wait here: the computer may be faster than a turn of the program. */
static volatile uint8_t ring[1024];
static volatile uint16_t ring_in, ring_out;

static void usart1_handler(void)
{
    uint16_t next = (uint16_t)((ring_in + 1U) % sizeof ring);
    if (next == ring_out) {
        CONTROL(USART1) &= ~(uint32_t)RECEIVED; /* full: no further interrupt until there is room again */
        return;
    }
    ring[ring_in] = (uint8_t)DATA(USART1);
    ring_in = next;
}

__attribute__((section(".vectors"), used)) const vector VECTORS[16 + 38] = {SYSTEM_VECTORS, [16 + 37] = usart1_handler};

static bool serial_read(uint8_t *octet)
{
    if (ring_in == ring_out) {
        return false;
    }
    *octet = ring[ring_out];
    ring_out = (uint16_t)((ring_out + 1U) % sizeof ring);
    CONTROL(USART1) |= RECEIVED;
    return true;
}

static void serial_write(const char *octets, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        while (!(STATUS(USART1) & SENDS)) {
        }
        DATA(USART1) = (uint8_t)octets[i];
    }
}

static void drive_pin(void *context, bool high)
{
    static int8_t shown = -1;
    (void)context;
    if (shown != high) {
        shown = high;
        while (!(STATUS(USART2) & SENDS)) {
        }
        DATA(USART2) = high ? '1' : '0';
    }
}

static bool read_pin(void *context)
{
    static bool level;
    (void)context;
    while (STATUS(USART2) & RECEIVED) {
        level = DATA(USART2) == '1';
    }
    return level;
}

int main(void)
{
    static const pin_board_pins pins = {drive_pin, read_pin, NULL};
    static slcan adapter = {serial_read, serial_write, {0}, 0, false, false};
    static const msbot_controller controller = {&adapter,       slcan_on_bus, slcan_receive, slcan_pending,
                                                slcan_has_room, slcan_send,   micros};
    static const uint8_t uid[8] = {0x05, 0xF4, 0, 0, 0, 0, 0, 1}; /* the emulator has no unique number either */
    CONTROL(USART1) = 1U << 13 | RECEIVED | 1U << 3 | 1U << 2;
    CONTROL(USART2) = 1U << 13 | 1U << 3 | 1U << 2;
    start_clock();
    NVIC_ENABLE1 = 1U << (37 - 32);
    /* The time until the first octet from the computer is the random value of this start (the emulator has no RNG). */
    msbot_frame none;
    while (!slcan_receive(&adapter, &none) && !adapter.is_open) {
        __asm volatile("wfi");
    }
    if (pin_board_init(&pins, uid, micros(NULL) * 2654435761U | 1U, 0) != MSBOT_CONFIG_OK) {
        return 1;
    }
    for (;;) {
        /* Any interrupt ends the sleep; SysTick (every 4 ms) ends it in time for all that is due. */
        if (pin_board_turn(&controller) > 0 && ring_in == ring_out) {
            __asm volatile("wfi");
        }
    }
}
