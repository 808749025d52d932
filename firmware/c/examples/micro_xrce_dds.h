/* MsBOT's CAN link as a custom transport of eProsima's Micro XRCE-DDS client (micro-ROS uses it, too).
 *
 *     msbot_uxr can = { .controller = &controller, .config = { .uid = ..., .codec = &msbot_compact } };
 *     uxrCustomTransport transport;
 *     uxr_set_custom_transport_callbacks(&transport, false, msbot_uxr_open, msbot_uxr_close, msbot_uxr_write, msbot_uxr_read);
 *     uxr_init_custom_transport(&transport, &can);
 *
 * Build the library with UXR_CONFIG_CUSTOM_TRANSPORT_MTU at most MSBOT_CAN_MTU. Such a client is no part of a robot by
 * itself: it is served by `msbot agent`, or by a master as one of the thesis' own programs.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MICRO_XRCE_DDS_H
#define MICRO_XRCE_DDS_H

#include <uxr/client/profile/transport/custom/custom_transport.h>

#include "msbot_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    const msbot_controller *controller;
    msbot_can_config config;
    void (*wait)(uint32_t us); /* may sleep until a frame comes; NULL = the calls below wait actively */
    msbot_can link;
    bool stopped; /* STOP has come: the program must go to its safe state, and clear this on its own GO */
} msbot_uxr;

/* How long `open` waits for the master's answer, and `write` for the bus. */
#define MSBOT_UXR_OPEN_US 3000000U
#define MSBOT_UXR_WRITE_US 250000U

bool msbot_uxr_open(uxrCustomTransport *transport);
bool msbot_uxr_close(uxrCustomTransport *transport);
size_t msbot_uxr_write(uxrCustomTransport *transport, const uint8_t *packet, size_t size, uint8_t *error);
size_t msbot_uxr_read(uxrCustomTransport *transport, uint8_t *packet, size_t room, int timeout_ms, uint8_t *error);

#ifdef __cplusplus
}
#endif

#endif
