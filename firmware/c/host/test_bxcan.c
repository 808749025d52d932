/* The bxCAN driver on a model of the registers (RM0090, chapter 32): which frame leaves when, and what comes in.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "examples/bxcan.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition) \
    do { \
        if (!(condition)) { \
            printf("%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
            exit(1); \
        } \
    } while (0)

enum { MCR = 0x00, MSR = 0x04, TSR = 0x08, RF0R = 0x0C, ESR = 0x18, BTR = 0x1C, TX = 0x180, RX = 0x1B0 };

static uint32_t registers[0x400 / 4];
static bool waiting[3];
static struct {
    uint32_t id, length, low, high;
} fifo[3];
static unsigned fifo_size;

uint32_t bxcan_get(uint32_t offset)
{
    if (offset == MSR) {
        return registers[MCR / 4] & 1U; /* INAK follows INRQ */
    }
    if (offset == TSR) {
        return (waiting[0] ? 0 : 1U << 26) | (waiting[1] ? 0 : 1U << 27) | (waiting[2] ? 0 : 1U << 28);
    }
    if (offset == RF0R) {
        return fifo_size;
    }
    if (offset >= RX && offset < RX + 16) {
        const uint32_t words[4] = {fifo[0].id, fifo[0].length, fifo[0].low, fifo[0].high};
        return words[(offset - RX) / 4];
    }
    return registers[offset / 4];
}

void bxcan_set(uint32_t offset, uint32_t value)
{
    if (offset == BTR) {
        CHECK(registers[MCR / 4] & 1U); /* can be written only during initialisation */
    }
    if (offset == RF0R) {
        CHECK(value == 32U && fifo_size > 0);
        memmove(fifo, fifo + 1, sizeof fifo - sizeof *fifo);
        fifo_size--;
        return;
    }
    if (offset >= TX && offset < TX + 48) {
        unsigned box = (offset - TX) / 16;
        CHECK(!waiting[box]); /* nothing is overwritten */
        waiting[box] = (offset - TX) % 16 == 0 && (value & 1U);
    }
    registers[offset / 4] = value;
}

/* The frame that wins the bus: TXFP is 0, so the lowest identifier, then the lowest mailbox; -1 = none waits. */
static int transmit(void)
{
    int best = -1;
    for (int box = 0; box < 3; box++) {
        if (waiting[box] && (best < 0 || registers[(TX + 16 * box) / 4] < registers[(TX + 16 * best) / 4])) {
            best = box;
        }
    }
    if (best >= 0) {
        waiting[best] = false;
    }
    return best;
}

static msbot_frame frame_of(uint32_t id, uint8_t flags, const char *data)
{
    msbot_frame frame = {id, flags, (uint8_t)strlen(data), {0}};
    memcpy(frame.data, data, frame.size);
    return frame;
}

static void opens_with_its_timing_and_hears_everything(void)
{
    bxcan_open(BXCAN_TIMING(2U, 13U, 2U));
    CHECK(registers[BTR / 4] == (1U << 20 | 12U << 16 | 1U));
    CHECK(!(registers[MCR / 4] & 1U) && !(registers[MCR / 4] & 4U));
    CHECK(registers[0x240 / 4] == 0 && registers[0x244 / 4] == 0 && (registers[0x21C / 4] & 1U));
    CHECK(bxcan_on_bus(NULL));
    registers[ESR / 4] = 4;
    CHECK(!bxcan_on_bus(NULL));
    registers[ESR / 4] = 0;
}

static void sends_the_lowest_identifier_first(void)
{
    const msbot_frame packet = frame_of(0x105, 0, "packet");
    const msbot_frame join = frame_of(0x1E123456, MSBOT_EXTENDED, "joinjoin");
    const msbot_frame stop = frame_of(0x008, 0, "\1");
    CHECK(bxcan_pending(NULL) == 0);
    bxcan_send(NULL, &packet);
    CHECK(bxcan_pending(NULL) == 2); /* no second frame of a packet: equal identifiers may change places */
    bxcan_send(NULL, &join);
    CHECK(bxcan_has_room(NULL));
    bxcan_send(NULL, &stop);
    CHECK(!bxcan_has_room(NULL));
    CHECK(transmit() == 2 && registers[(TX + 32) / 4] == (0x008U << 21 | 1U));
    CHECK(transmit() == 0 && registers[TX / 4] == (0x105U << 21 | 1U));
    CHECK(registers[TX / 4 + 1] == 6 && registers[TX / 4 + 2] == 0x6B636170U && registers[TX / 4 + 3] == 0x7465U);
    CHECK(transmit() == 1 && registers[(TX + 16) / 4] == (0x1E123456U << 3 | 4U | 1U));
    CHECK(transmit() == -1 && bxcan_pending(NULL) == 0);
}

static void receives_what_waits(void)
{
    msbot_frame frame;
    CHECK(!bxcan_receive(NULL, &frame));
    fifo[0].id = 0x185U << 21;
    fifo[0].length = 3 | 0xFFFFFF00U;
    fifo[0].low = 0x636261U;
    fifo[1].id = 0x02000605U << 3 | 4U;
    fifo[1].length = 8;
    fifo[1].low = 0x64636261U;
    fifo[1].high = 0x68676665U;
    fifo[2].id = 0x700U << 21 | 2U;
    fifo[2].length = 15;
    fifo_size = 3;
    CHECK(bxcan_receive(NULL, &frame) && frame.id == 0x185 && frame.flags == 0 && frame.size == 3);
    CHECK(memcmp(frame.data, "abc", 3) == 0);
    CHECK(bxcan_receive(NULL, &frame) && frame.id == 0x02000605 && frame.flags == MSBOT_EXTENDED && frame.size == 8);
    CHECK(memcmp(frame.data, "abcdefgh", 8) == 0);
    CHECK(bxcan_receive(NULL, &frame) && frame.flags == MSBOT_REMOTE && frame.size == 0);
    CHECK(!bxcan_receive(NULL, &frame));
}

int main(void)
{
    opens_with_its_timing_and_hears_everything();
    sends_the_lowest_identifier_first();
    receives_what_waits();
    return 0;
}
