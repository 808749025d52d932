/* A DDS-XRCE client for one agent, without I/O: one session, a reliable and a best-effort stream each way, fragments in.
 *
 * Packets and times go in, packets and deadlines come out. It implements what a part needs (docs/reference/xrce.md has
 * the full protocol): log in, create objects in binary form, write, read, acknowledge, ask whether the agent is there.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_XRCE_H
#define MSBOT_XRCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef MSBOT_XRCE_MTU
#define MSBOT_XRCE_MTU 252 /* octets of the largest message, both ways */
#endif
#ifndef MSBOT_XRCE_WINDOW
#define MSBOT_XRCE_WINDOW 4 /* messages kept until they are acknowledged */
#endif
#ifndef MSBOT_XRCE_QUEUE
#define MSBOT_XRCE_QUEUE 4 /* best-effort messages that wait for the link */
#endif
#ifndef MSBOT_XRCE_SAMPLE
#define MSBOT_XRCE_SAMPLE 64 /* octets of the largest best-effort sample */
#endif
#ifndef MSBOT_XRCE_LARGEST
#define MSBOT_XRCE_LARGEST 1024 /* octets of the largest submessage that comes in pieces */
#endif

#define MSBOT_BEST_EFFORT 0x01
#define MSBOT_RELIABLE 0x80

typedef enum { MSBOT_XRCE_CLOSED, MSBOT_XRCE_CONNECTING, MSBOT_XRCE_CONNECTED } msbot_xrce_state;

/* Events, as `msbot_xrce_events` returns them. */
enum { MSBOT_XRCE_OPENED = 1, MSBOT_XRCE_LOST = 2 };

typedef struct msbot_xrce {
    void (*on_data)(void *context, uint16_t object_id, const uint8_t *payload, size_t size, uint32_t now_us);
    void *context;
    msbot_xrce_state state;
    uint8_t session, events, logins, answers, pings;
    bool acknowledge, inform, ping, login_due, sent_in_session;
    uint8_t question[4]; /* ids of the agent's GET_INFO */
    uint32_t key;
    uint16_t request;
    uint32_t login_us, heard_us, ping_us; /* last login; last sign of the agent; last ping */
    /* Reliable stream to the agent: messages `first` to `next` - 1 are kept. */
    struct {
        uint8_t octets[MSBOT_XRCE_MTU];
        uint16_t size;
        bool send;
    } kept[MSBOT_XRCE_WINDOW];
    uint16_t first, next;
    bool open;              /* whether further submessages may join the newest message */
    uint32_t asked_us;      /* when the reliable stream last sent something, or asked for acknowledgement */
    uint32_t progress_us;   /* when the agent last acknowledged something */
    /* Best-effort stream to the agent. */
    struct {
        uint8_t octets[MSBOT_XRCE_SAMPLE + 12];
        uint16_t size;
    } queue[MSBOT_XRCE_QUEUE];
    uint8_t queue_first, queue_size;
    uint16_t best_effort;
    /* Streams from the agent. */
    uint16_t handled, announced, newest; /* reliable: last in order, newest known of; best effort */
    uint8_t pieces[MSBOT_XRCE_LARGEST];
    uint16_t pieces_size;
    bool pieces_spoilt;
    /* Counters. */
    uint16_t refused; /* objects that the agent did not create */
    uint16_t dropped; /* messages that made no sense, or were too large */
    uint16_t not_sent; /* best-effort samples that gave way to newer ones */
} msbot_xrce;

void msbot_xrce_init(msbot_xrce *client, uint32_t key); /* a key that no other client of the agent has, not 0 */
void msbot_xrce_connect(msbot_xrce *client, uint32_t now_us); /* a new session; what was booked is forgotten */
void msbot_xrce_close(msbot_xrce *client);                    /* the agent can no longer be reached */
void msbot_xrce_receive(msbot_xrce *client, const uint8_t *packet, size_t size, uint32_t now_us);
void msbot_xrce_tick(msbot_xrce *client, uint32_t now_us);
bool msbot_xrce_timer(const msbot_xrce *client, uint32_t *at);
/* The next packet for the link, which has room for one; 0 = none now. `packet` has MSBOT_XRCE_MTU octets or more. */
size_t msbot_xrce_next(msbot_xrce *client, uint8_t *packet, uint32_t now_us);
uint8_t msbot_xrce_events(msbot_xrce *client);
void msbot_xrce_check(msbot_xrce *client); /* is the agent there? if not, the session is lost soon */

/* Booking; all return false when the reliable stream has no room: try again later. */
bool msbot_xrce_create_participant(msbot_xrce *client, uint16_t object_id);
bool msbot_xrce_create_group(msbot_xrce *client, uint16_t object_id, uint16_t participant_id); /* publisher, subscriber */
bool msbot_xrce_create_topic(msbot_xrce *client, uint16_t object_id, uint16_t participant_id, const char *name,
                             const char *type);
bool msbot_xrce_create_endpoint(msbot_xrce *client, uint16_t object_id, uint16_t group_id, uint16_t topic_id,
                                bool reliable); /* data writer, data reader */
bool msbot_xrce_create_requester(msbot_xrce *client, uint16_t object_id, uint16_t participant_id,
                                 const char *const names[5]); /* service, its two types, its two topics */
/* A requester (kind 7) or a replier (kind 8) of a service of parts: its `type` is two types, "Angle -> Text". */
bool msbot_xrce_create_service(msbot_xrce *client, uint16_t object_id, uint16_t participant_id, const char *topic,
                               const char *type);
bool msbot_xrce_delete(msbot_xrce *client, uint16_t object_id);
/* How many samples a read asks for. */
typedef enum { MSBOT_READ_ONE, MSBOT_READ_ALL, MSBOT_READ_NO_MORE } msbot_read_what;
bool msbot_xrce_read(msbot_xrce *client, uint16_t object_id, uint8_t stream, msbot_read_what what);
bool msbot_xrce_write(msbot_xrce *client, uint16_t object_id, uint8_t stream, const uint8_t *payload, size_t size);

#ifdef __cplusplus
}
#endif

#endif
