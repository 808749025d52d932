/* The library CAN for Arduino, as far as the example uses it; see Arduino.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef CAN_SEAM_H
#define CAN_SEAM_H

#include <stddef.h>
#include <stdint.h>

class CANControllerClass {
public:
    int begin(long bitrate);
    int beginPacket(int id, int dlc = -1, bool rtr = false);
    int beginExtendedPacket(long id, int dlc = -1, bool rtr = false);
    int endPacket();
    size_t write(uint8_t octet);
    int parsePacket();
    long packetId();
    bool packetExtended();
    bool packetRtr();
    int available();
    int read();
};

extern CANControllerClass CAN;

#endif
