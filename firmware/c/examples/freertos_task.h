/* The example as a task of FreeRTOS: see freertos_task.c.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef FREERTOS_TASK_H
#define FREERTOS_TASK_H

#include "FreeRTOS.h"
#include "task.h"

#include "msbot_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PIN_BOARD_STACK_WORDS 640 /* of 4 octets; the deepest call of the firmware takes 340 (sizes.py) */

/* After `pin_board_init`, before or after the scheduler has started. */
bool pin_board_start_task(const msbot_controller *controller, UBaseType_t priority);
/* From the interrupts of the CAN controller: a frame has come or left. */
void pin_board_wake_from_interrupt(void);

#ifdef __cplusplus
}
#endif

#endif
