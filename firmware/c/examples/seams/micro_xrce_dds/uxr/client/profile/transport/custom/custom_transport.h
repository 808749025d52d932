/* What a custom transport sees of eProsima's Micro XRCE-DDS client, declared as its documentation says: only to compile and
 * test the example without the library.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef CUSTOM_TRANSPORT_SEAM_H
#define CUSTOM_TRANSPORT_SEAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct uxrCustomTransport {
    void *args; /* as handed to uxr_init_custom_transport */
} uxrCustomTransport;

#endif
