/* bxCAN: see bxcan.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "bxcan.h"

enum { MCR = 0x00, MSR = 0x04, TSR = 0x08, RF0R = 0x0C, IER = 0x14, ESR = 0x18, BTR = 0x1C, TX = 0x180, RX = 0x1B0,
       FMR = 0x200, FM1R = 0x204, FS1R = 0x20C, FFA1R = 0x214, FA1R = 0x21C, FILTER0 = 0x240 };
enum { ID = 0, LENGTH = 4, LOW = 8, HIGH = 12, MAILBOX = 16 };

#define MAILBOXES 3U
#define INIT 1U              /* MCR: request initialisation; MSR: acknowledged */
#define BUS_OFF_BY_ITSELF 64U /* MCR ABOM: automatic return after bus-off */
#define IS_BUS_OFF 4U        /* ESR */
#define EMPTY (1U << 26)     /* TSR TME0 and the two after it */
#define COMPLETED 0x00010101U /* TSR RQCP0 to 2: write 1 to clear */
#define RELEASE 32U          /* RF0R RFOM0 */
#define WAITING 3U           /* RF0R FMP0: frames in the FIFO */
#define REQUEST 1U           /* TIR TXRQ */
#define REMOTE 2U            /* RIR RTR */
#define EXTENDED 4U          /* TIR, RIR IDE */

void bxcan_open(uint32_t timing)
{
    bxcan_set(MCR, INIT); /* this also ends the sleep mode after reset */
    while (!(bxcan_get(MSR) & INIT)) {
    }
    bxcan_set(BTR, timing);
    bxcan_set(FMR, bxcan_get(FMR) | 1U); /* filter 0: a mask of 32 bits that lets everything into FIFO 0 */
    bxcan_set(FM1R, bxcan_get(FM1R) & ~1U);
    bxcan_set(FS1R, bxcan_get(FS1R) | 1U);
    bxcan_set(FFA1R, bxcan_get(FFA1R) & ~1U);
    bxcan_set(FILTER0, 0);
    bxcan_set(FILTER0 + 4, 0);
    bxcan_set(FA1R, bxcan_get(FA1R) | 1U);
    bxcan_set(FMR, bxcan_get(FMR) & ~1U);
    bxcan_set(MCR, BUS_OFF_BY_ITSELF);
    while (bxcan_get(MSR) & INIT) { /* until 11 recessive bits were seen */
    }
    bxcan_set(IER, 1U | 2U); /* a mailbox is empty, a frame waits in FIFO 0 */
}

bool bxcan_on_bus(void *context)
{
    (void)context;
    return !(bxcan_get(ESR) & IS_BUS_OFF);
}

bool bxcan_receive(void *context, msbot_frame *frame)
{
    (void)context;
    if (!(bxcan_get(RF0R) & WAITING)) {
        return false;
    }
    uint32_t id = bxcan_get(RX + ID);
    const uint32_t words[2] = {bxcan_get(RX + LOW), bxcan_get(RX + HIGH)};
    uint32_t size = bxcan_get(RX + LENGTH) & 15U;
    frame->id = (id & EXTENDED) ? id >> 3 : id >> 21;
    frame->flags = (uint8_t)(((id & EXTENDED) ? MSBOT_EXTENDED : 0) | ((id & REMOTE) ? MSBOT_REMOTE : 0));
    frame->size = (uint8_t)((id & REMOTE) ? 0 : size > 8 ? 8 : size);
    for (unsigned i = 0; i < frame->size; i++) {
        frame->data[i] = (uint8_t)(words[i / 4] >> 8 * (i % 4));
    }
    bxcan_set(RF0R, RELEASE);
    return true;
}

static unsigned mailboxes_in_use(void)
{
    unsigned used = 0;
    for (unsigned i = 0; i < MAILBOXES; i++) {
        used += (bxcan_get(TSR) & (EMPTY << i)) ? 0 : 1;
    }
    return used;
}

unsigned bxcan_pending(void *context)
{
    (void)context;
    return mailboxes_in_use() ? 2 : 0; /* so that the link adds no further frame of a packet */
}

bool bxcan_has_room(void *context)
{
    (void)context;
    return mailboxes_in_use() < MAILBOXES;
}

void bxcan_send(void *context, const msbot_frame *frame)
{
    (void)context;
    unsigned box = 0;
    while (box < MAILBOXES && !(bxcan_get(TSR) & (EMPTY << box))) {
        box++;
    }
    if (box == MAILBOXES) {
        return;
    }
    uint32_t words[2] = {0, 0};
    for (unsigned i = 0; i < frame->size && i < 8; i++) {
        words[i / 4] |= (uint32_t)frame->data[i] << 8 * (i % 4);
    }
    uint32_t at = TX + box * MAILBOX;
    bool extended = (frame->flags & MSBOT_EXTENDED) != 0;
    bxcan_set(at + LENGTH, frame->size);
    bxcan_set(at + LOW, words[0]);
    bxcan_set(at + HIGH, words[1]);
    bxcan_set(at + ID, (extended ? frame->id << 3 | EXTENDED : frame->id << 21) | REQUEST);
}

void bxcan_interrupt(void) { bxcan_set(TSR, COMPLETED); }
