/* The FDCAN controller of an STM32G4, after ST's reference manual RM0440, chapter 44.
 *
 * Like bxCAN it has three places for frames to be sent; as a queue the lowest identifier goes first. See bxcan.h for why
 * only one frame of a packet is in it at a time.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef FDCAN_H
#define FDCAN_H

#include "msbot_can.h"

#ifdef __cplusplus
extern "C" {
#endif

#ifndef FDCAN_BASE
#define FDCAN_BASE 0x40006400U   /* FDCAN1 */
#define FDCAN_MEMORY 0x4000A400U /* its section of the message RAM */
#endif

/* Timing for NBTP: `prescaler` clocks are a quantum, 1 + segment1 + segment2 quanta a bit. */
#define FDCAN_TIMING(prescaler, segment1, segment2, jump) \
    ((uint32_t)((jump) - 1U) << 25 | (uint32_t)((prescaler) - 1U) << 16 | (uint32_t)((segment1) - 1U) << 8 | \
     ((segment2) - 1U))
/* The same for DBTP, the data phase of CAN FD. */
#define FDCAN_DATA_TIMING(prescaler, segment1, segment2, jump) \
    ((uint32_t)((prescaler) - 1U) << 16 | (uint32_t)((segment1) - 1U) << 8 | (uint32_t)((segment2) - 1U) << 4 | \
     ((jump) - 1U))

/* Joins the bus; its clock and pins must be enabled already. `data_timing` 0: classic CAN only. */
void fdcan_open(uint32_t timing, uint32_t data_timing);

bool fdcan_on_bus(void *context);
bool fdcan_receive(void *context, msbot_frame *frame);
unsigned fdcan_pending(void *context);
bool fdcan_has_room(void *context);
void fdcan_send(void *context, const msbot_frame *frame);
void fdcan_interrupt(void); /* acknowledges all pending interrupts */

#ifdef __cplusplus
}
#endif

#endif
