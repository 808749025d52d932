/* Runs a part on a CAN controller: the interface between the code without I/O and the hardware.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_CONTROLLER_H
#define MSBOT_CONTROLLER_H

#include "msbot_part.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A CAN controller and a clock; none of the functions waits. */
typedef struct {
    void *context;
    bool (*on_bus)(void *context);                             /* takes part in the bus: open, and not bus-off */
    bool (*receive)(void *context, msbot_frame *frame);        /* the next frame that came; false: none */
    unsigned (*pending)(void *context);                        /* frames handed over that have not left yet */
    bool (*has_room)(void *context);                           /* whether it accepts another frame */
    void (*send)(void *context, const msbot_frame *frame);     /* by identifier, then in the order of the calls */
    uint32_t (*micros)(void *context);                         /* microseconds, modulo 2^32 */
} msbot_controller;

/* One turn: takes what came, does what is due, hands over what is to be sent. To be called whenever a frame has come or
 * left, and at the time it returns at the latest (in microseconds from now). */
uint32_t msbot_turn(msbot_part *part, const msbot_controller *controller);

#ifdef __cplusplus
}
#endif

#endif
