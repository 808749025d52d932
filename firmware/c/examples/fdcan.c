/* FDCAN: see fdcan.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "fdcan.h"

#define REGISTER(offset) (*(volatile uint32_t *)(FDCAN_BASE + (offset)))
#define MEMORY(offset) (*(volatile uint32_t *)(FDCAN_MEMORY + (offset)))

enum { DBTP = 0x0C, CCCR = 0x18, NBTP = 0x1C, PSR = 0x44, IR = 0x50, IE = 0x54, ILE = 0x5C, RXGFC = 0x80, RXF0S = 0x90,
       RXF0A = 0x94, TXBC = 0xC0, TXFQS = 0xC4, TXBRP = 0xC8, TXBAR = 0xCC, TXBTIE = 0xDC };
enum { RX_FIFO0 = 0xB0, TX_BUFFERS = 0x278, ELEMENT = 72 };

#define INIT 1U            /* CCCR */
#define CHANGE 2U          /* CCCR CCE */
#define FD_ENABLED 0x300U  /* CCCR FDOE, BRSE */
#define BUS_OFF 0x80U      /* PSR */
#define QUEUE (1U << 24)     /* TXBC TFQM: the lowest identifier goes first */
#define QUEUE_FULL (1U << 21) /* TXFQS */
#define IS_EXTENDED (1U << 30)
#define IS_REMOTE (1U << 29)
#define IS_FD (1U << 21)
#define IS_FAST (1U << 20)

static const uint8_t LENGTHS[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

void fdcan_open(uint32_t timing, uint32_t data_timing)
{
    REGISTER(CCCR) = INIT;
    while (!(REGISTER(CCCR) & INIT)) {
    }
    REGISTER(CCCR) = INIT | CHANGE;
    REGISTER(NBTP) = timing;
    if (data_timing != 0) {
        REGISTER(DBTP) = data_timing;
        REGISTER(CCCR) |= FD_ENABLED;
    }
    REGISTER(RXGFC) = 0; /* no filters: everything goes into FIFO 0 */
    REGISTER(TXBC) = QUEUE;
    REGISTER(TXBTIE) = 7;
    REGISTER(IE) = 1U | 1U << 7; /* a frame has come, a frame has left */
    REGISTER(ILE) = 1;
    REGISTER(CCCR) &= ~INIT;
}

bool fdcan_on_bus(void *context)
{
    (void)context;
    if (!(REGISTER(PSR) & BUS_OFF)) {
        return true;
    }
    REGISTER(CCCR) &= ~INIT; /* bus-off has set it: back after 128 times 11 recessive bits */
    return false;
}

bool fdcan_receive(void *context, msbot_frame *frame)
{
    (void)context;
    uint32_t state = REGISTER(RXF0S);
    if (!(state & 15U)) {
        return false;
    }
    uint32_t place = state >> 8 & 3U;
    uint32_t at = RX_FIFO0 + place * ELEMENT;
    uint32_t id = MEMORY(at);
    uint32_t about = MEMORY(at + 4);
    size_t size = LENGTHS[about >> 16 & 15U];
    if (!(about & IS_FD) && size > 8) {
        size = 8;
    }
    bool fits = size <= MSBOT_CAN_DATA && !(id & IS_REMOTE);
    frame->id = (id & IS_EXTENDED) ? id & 0x1FFFFFFFU : id >> 18 & 0x7FFU;
    frame->flags = (uint8_t)(((id & IS_EXTENDED) ? MSBOT_EXTENDED : 0) | ((about & IS_FD) ? MSBOT_FD : 0) |
                             (fits ? 0 : MSBOT_REMOTE)); /* if it is unusable: ignored like a remote frame */
    frame->size = (uint8_t)(fits ? size : 0);
    for (size_t i = 0; i < frame->size; i++) {
        frame->data[i] = (uint8_t)(MEMORY(at + 8 + (i & ~(size_t)3)) >> 8 * (i % 4));
    }
    REGISTER(RXF0A) = place;
    return true;
}

unsigned fdcan_pending(void *context)
{
    (void)context;
    return (REGISTER(TXBRP) & 7U) ? 2 : 0; /* so that the link adds no further frame of a packet */
}

bool fdcan_has_room(void *context)
{
    (void)context;
    return !(REGISTER(TXFQS) & QUEUE_FULL);
}

void fdcan_send(void *context, const msbot_frame *frame)
{
    (void)context;
    uint32_t place = REGISTER(TXFQS) >> 16 & 3U;
    uint32_t at = TX_BUFFERS + place * ELEMENT;
    uint32_t code = 0;
    while (code < 15 && LENGTHS[code] < frame->size) {
        code++;
    }
    uint32_t about = code << 16;
    if (frame->flags & MSBOT_FD) {
        about |= IS_FD;
        about |= (frame->flags & MSBOT_BRS) ? IS_FAST : 0U;
    }
    MEMORY(at) = (frame->flags & MSBOT_EXTENDED) ? frame->id | IS_EXTENDED : frame->id << 18;
    MEMORY(at + 4) = about;
    for (size_t start = 0; start < frame->size; start += 4) {
        uint32_t word = 0;
        for (size_t i = start; i < start + 4 && i < frame->size; i++) {
            word |= (uint32_t)frame->data[i] << 8 * (i % 4);
        }
        MEMORY(at + 8 + start) = word;
    }
    REGISTER(TXBAR) = 1U << place;
}

void fdcan_interrupt(void) { REGISTER(IR) = REGISTER(IR); }
