/* The CAN link of a part: joining, segments and STOP (docs/reference/can.md), without I/O.
 *
 * Frames and times go in, frames, packets and deadlines come out; nothing here waits, allocates or knows a controller.
 * `msbot_controller.h` runs it on one. Times are microseconds of any clock that counts modulo 2^32.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_CAN_H
#define MSBOT_CAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef MSBOT_CAN_MTU
#define MSBOT_CAN_MTU 256 /* octets of the largest packet; tell the agent 4 less (CREATE_CLIENT) */
#endif
#ifndef MSBOT_CAN_DATA
#define MSBOT_CAN_DATA 8 /* data bytes of a frame that the controller takes: 8, or 64 for CAN FD */
#endif

enum { MSBOT_EXTENDED = 1, MSBOT_FD = 2, MSBOT_BRS = 4, MSBOT_REMOTE = 8 };

typedef struct {
    uint32_t id;   /* 11 bits, or 29 with MSBOT_EXTENDED */
    uint8_t flags; /* MSBOT_EXTENDED ... */
    uint8_t size;  /* data bytes */
    uint8_t data[MSBOT_CAN_DATA];
} msbot_frame;

/* Capabilities in JOIN, ASSIGN and BEACON. */
enum { MSBOT_CAP_FD = 1, MSBOT_CAP_COMPRESSION = 2 };

/* Why a frame or a message was dropped; counted in `msbot_joiner.dropped`. */
enum {
    MSBOT_DROP_EMPTY_FRAME, MSBOT_DROP_FRAME_LOST, MSBOT_DROP_MESSAGE_LOST, MSBOT_DROP_NO_FIRST_FRAME,
    MSBOT_DROP_UNFINISHED, MSBOT_DROP_WRONG_CHECK_BYTE, MSBOT_DROP_TOO_LONG, MSBOT_DROP_TOO_SLOW,
    MSBOT_DROP_WRONG_LENGTH, MSBOT_DROP_EMPTY_MESSAGE, MSBOT_DROP_REPEATED, MSBOT_DROP_NOT_COMPRESSED, MSBOT_DROPS
};

/* Joins the master's frames into messages. A short form may be one octet longer than its packet, and a check byte
 * follows. */
typedef struct {
    uint8_t body[MSBOT_CAN_MTU + 2];
    uint16_t size;  /* octets of the message in progress, including those beyond the body */
    uint16_t limit; /* longest message */
    uint32_t at_us; /* when its last frame came */
    int16_t expected;
    bool open, several, stray;
    uint8_t check, heard;
    uint16_t repeat; /* how long CAN may repeat a frame, in units of 64 us */
    uint32_t called_us;
    uint16_t seen[64], seen_at[64]; /* by counter: a hash of the frame, 0 = none, and when it came in units of 64 us */
    uint8_t seen_nr[64];
    uint16_t dropped[MSBOT_DROPS];
} msbot_joiner;

/* A packet on its way out, cut into frames when the controller has room. */
typedef struct {
    uint8_t body[MSBOT_CAN_MTU + 2];
    uint16_t size, sent;
    uint8_t q;
    bool fd, waiting, begun;
} msbot_splitter;

typedef enum { MSBOT_CAN_OFF, MSBOT_CAN_JOINING, MSBOT_CAN_JOINED, MSBOT_CAN_FOREIGN } msbot_can_state;

/* Events, as `msbot_can_events` returns them. */
enum { MSBOT_EVENT_DOWN = 1, MSBOT_EVENT_UP = 2, MSBOT_EVENT_STOP = 4 };

/* Why there is no address. */
typedef enum {
    MSBOT_LOST_NOTHING,
    MSBOT_LOST_BUS,          /* the controller has left the bus */
    MSBOT_LOST_BEACON,       /* no beacon of the master for 3.5 s */
    MSBOT_LOST_EPOCH,        /* the master has restarted */
    MSBOT_LOST_PROFILE,      /* the robot's profile has changed */
    MSBOT_LOST_TO_ANOTHER,   /* the master has given the address to another part */
    MSBOT_LOST_FULL,         /* the master has no free address */
    MSBOT_LOST_OTHER_ROBOT   /* this bus belongs to another robot */
} msbot_lost;

/* Shortens packets and restores them exactly; `compress` makes at most size + 1 octets, `decompress` returns -1 for
 * octets that are not a short form. */
typedef struct {
    size_t (*compress)(uint8_t *form, const uint8_t *packet, size_t size);
    int (*decompress)(uint8_t *packet, size_t room, const uint8_t *form, size_t size);
} msbot_codec;

typedef struct {
    uint8_t uid[8];       /* identifies this piece of hardware; not all zero */
    const msbot_codec *codec; /* shortens packets: &msbot_compact, or NULL */
    bool fd;              /* the controller takes CAN FD frames (needs MSBOT_CAN_DATA 64) */
    bool fast;            /* ... and switches to the data bit rate in them */
    bool has_robot;       /* made for one robot only: */
    uint32_t robot;       /* CRC-32 of its name, version and serial number */
    uint32_t bitrate;     /* bit/s of a classic bus; 0 = unknown */
    uint32_t seed;        /* any value that differs between parts and between starts */
} msbot_can_config;

typedef struct {
    msbot_can_config config;
    msbot_can_state state;
    msbot_lost reason;
    uint8_t node_id; /* 1 to 120, 0 = none */
    uint8_t use;     /* the capabilities that both sides use */
    uint8_t events, stop_reason, stop_heard, stop_frames, stop_to_send;
    bool ask, awaiting_departure, refused, has_due, has_deadline, has_beacon, has_profile, has_stop;
    uint16_t epoch, beacon_epoch;
    uint32_t profile, due_us, deadline_us, pause_us, random, stop_us;
    uint16_t packet; /* octets of the message that waits in the joiner's body */
    msbot_joiner in;
    msbot_splitter out;
} msbot_can;

/* The link. */
void msbot_can_init(msbot_can *link, const msbot_can_config *config);
void msbot_can_start(msbot_can *link); /* at power-up, or when the controller is back on the bus */
void msbot_can_stop(msbot_can *link);  /* the controller has left the bus */
void msbot_can_receive(msbot_can *link, const msbot_frame *frame, uint32_t now_us);
void msbot_can_tick(msbot_can *link, uint32_t now_us);     /* do what is due */
bool msbot_can_timer(const msbot_can *link, uint32_t *at); /* when `tick` must be called */
/* The next frame for the controller, which already holds `pending` frames; false: none for now. */
bool msbot_can_next(msbot_can *link, unsigned pending, msbot_frame *frame);
void msbot_can_drained(msbot_can *link, uint32_t now_us); /* all frames have left the controller */
uint8_t msbot_can_events(msbot_can *link);                /* MSBOT_EVENT_...; returns each once */
void msbot_can_say_stop(msbot_can *link, uint8_t reason); /* STOP for every node on the bus */
/* Hands a packet over; false: no address, the previous one is still on its way, or it is empty or longer than the MTU. */
bool msbot_can_send(msbot_can *link, const uint8_t *packet, size_t size);
/* The packet that came, or 0. `room` is MSBOT_CAN_MTU + 1 or more. To be called before the next frame is received. */
size_t msbot_can_read(msbot_can *link, uint8_t *packet, size_t room);

/* Its components, which the tests drive separately. */
void msbot_joiner_reset(msbot_joiner *joiner, uint16_t limit, uint16_t repeat);
size_t msbot_joiner_take(msbot_joiner *joiner, const uint8_t *data, size_t size, uint32_t now_us);
void msbot_splitter_begin(msbot_splitter *splitter); /* finishes `body` of `size` octets */
size_t msbot_splitter_next(msbot_splitter *splitter, uint8_t *data); /* data bytes of the next frame, 0 = no more */
uint32_t msbot_crc32(const uint8_t *data, size_t size);

#ifdef __cplusplus
}
#endif

#endif
