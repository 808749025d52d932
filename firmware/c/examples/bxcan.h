/* The bxCAN controller of an STM32 (F0, F1, F2, F3, F4, F7, L4), after ST's reference manual RM0090, chapter 32.
 *
 * Frames wait in its three mailboxes, and the lowest identifier goes first. With equal identifiers the lower mailbox
 * goes first, whichever was filled earlier; so at most one frame of a packet is in a mailbox at a time, and the other
 * two are for STOP and JOIN.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef BXCAN_H
#define BXCAN_H

#include "msbot_can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The registers by their offsets; a test puts a model in their place. */
#ifdef BXCAN_MODEL
uint32_t bxcan_get(uint32_t offset);
void bxcan_set(uint32_t offset, uint32_t value);
#else
#ifndef BXCAN_BASE
#define BXCAN_BASE 0x40006400U /* CAN1 */
#endif
static inline uint32_t bxcan_get(uint32_t offset) { return *(volatile uint32_t *)(uintptr_t)(BXCAN_BASE + offset); }
static inline void bxcan_set(uint32_t offset, uint32_t value) { *(volatile uint32_t *)(uintptr_t)(BXCAN_BASE + offset) = value; }
#endif

/* Timing for CAN_BTR: `prescaler` clocks of the bus are a quantum, 1 + segment1 + segment2 quanta a bit. */
#define BXCAN_TIMING(prescaler, segment1, segment2) \
    ((uint32_t)((segment2) - 1U) << 20 | (uint32_t)((segment1) - 1U) << 16 | ((prescaler) - 1U))

/* Joins the bus; its clock and pins must be enabled already. Interrupts: a frame has come, a mailbox is empty. */
void bxcan_open(uint32_t timing);

bool bxcan_on_bus(void *context);
bool bxcan_receive(void *context, msbot_frame *frame);
unsigned bxcan_pending(void *context);
bool bxcan_has_room(void *context);
void bxcan_send(void *context, const msbot_frame *frame);
void bxcan_interrupt(void); /* acknowledges the interrupt of an empty mailbox */

#ifdef __cplusplus
}
#endif

#endif
