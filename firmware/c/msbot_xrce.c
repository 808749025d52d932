/* A DDS-XRCE client: see msbot_xrce.h.
 *
 * Messages of the agent's reliable stream are only accepted in order: an early one is requested again. On CAN that
 * costs little, because frames of one sender come in order and hardly any is lost, and it saves the memory of a window.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_xrce.h"

#include <string.h>

/* Waiting times for one part among many on a slow bus: losses are rare there, and the questions of many would fill it. */
#define LOGIN_PERIOD_US 1000000U
#define HEARTBEAT_US 1000000U
#define QUIET_US 5000000U
#define PING_US 2000000U
#define PINGS 3
#define STALL_US 30000000U

enum { CREATE = 1, GET_INFO = 2, DELETE = 3, STATUS_AGENT = 4, STATUS = 5, INFO = 6, WRITE_DATA = 7, READ_DATA = 8,
       DATA = 9, ACKNACK = 10, HEARTBEAT = 11, FRAGMENT = 13 };
enum { LITTLE_ENDIAN_FLAG = 1, LAST_FRAGMENT_FLAG = 2, REUSE_AND_REPLACE = 6 };

#define FIRST_REQUEST 10U
#define LAST_REQUEST 0x7FFFU

static bool is_due(uint32_t at, uint32_t now) { return (int32_t)(now - at) >= 0; }

static uint16_t u16(const uint8_t *octets) { return (uint16_t)(octets[0] | octets[1] << 8); }

static uint16_t ids(const uint8_t *octets) { return (uint16_t)(octets[0] << 8 | octets[1]); }

static void put_u16(uint8_t *octets, uint16_t value)
{
    octets[0] = (uint8_t)value;
    octets[1] = (uint8_t)(value >> 8);
}

static void put_ids(uint8_t *octets, uint16_t value)
{
    octets[0] = (uint8_t)(value >> 8);
    octets[1] = (uint8_t)value;
}

/* The distance from one sequence number to another. */
static int16_t way(uint16_t from, uint16_t to) { return (int16_t)(uint16_t)(to - from); }

void msbot_xrce_init(msbot_xrce *client, uint32_t key)
{
    memset(client, 0, sizeof *client);
    client->key = key;
    client->session = 0x82;
}

static void restart_input(msbot_xrce *client)
{
    client->handled = client->announced = client->newest = 0xFFFF;
    client->pieces_size = 0;
    client->pieces_spoilt = false;
    client->acknowledge = false;
}

static void restart(msbot_xrce *client, uint32_t now_us)
{
    restart_input(client);
    client->first = client->next = client->best_effort = 0;
    client->open = client->inform = client->ping = client->sent_in_session = false;
    client->queue_size = client->pings = 0;
    client->request = FIRST_REQUEST - 1;
    client->heard_us = client->asked_us = client->progress_us = now_us;
}

void msbot_xrce_connect(msbot_xrce *client, uint32_t now_us)
{
    client->session = client->session == 0x81 ? 0x82 : 0x81; /* late packets of the old one do not count as new */
    client->state = MSBOT_XRCE_CONNECTING;
    client->logins = client->answers = 0;
    client->login_due = true;
    restart(client, now_us);
}

void msbot_xrce_close(msbot_xrce *client)
{
    client->state = MSBOT_XRCE_CLOSED;
    client->events = 0;
}

static void lose(msbot_xrce *client, uint32_t now_us)
{
    msbot_xrce_connect(client, now_us);
    client->events = MSBOT_XRCE_LOST;
}

uint8_t msbot_xrce_events(msbot_xrce *client)
{
    uint8_t events = client->events;
    client->events = 0;
    return events;
}

void msbot_xrce_check(msbot_xrce *client)
{
    if (client->state == MSBOT_XRCE_CONNECTED && client->pings == 0) {
        client->ping = true;
    }
}

/* Receiving. */

static void take_login_answer(msbot_xrce *client, uint8_t status, uint32_t now_us)
{
    if (client->state == MSBOT_XRCE_CONNECTING) {
        if (status < 0x80) {
            client->state = MSBOT_XRCE_CONNECTED;
            client->answers = 1;
            restart(client, now_us);
            client->events = MSBOT_XRCE_OPENED;
        }
    } else if (client->answers < client->logins) {
        /* Each repeated login made the agent restart its streams. */
        client->answers++;
        restart_input(client);
    } else if (client->sent_in_session && status < 0x80) {
        lose(client, now_us); /* a late login has reached the agent */
    }
}

static void take_acknack(msbot_xrce *client, uint16_t first, uint16_t bitmap, uint32_t now_us)
{
    if (way(client->first, first) < 0 || way(first, client->next) < 0) {
        client->dropped++;
        return;
    }
    if (client->first != first) {
        client->first = first;
        client->progress_us = client->asked_us = now_us;
    }
    for (uint16_t i = 0; i < 16 && (uint16_t)(first + i) != client->next; i++) {
        if ((unsigned)bitmap >> i & 1U) {
            client->kept[(first + i) % MSBOT_XRCE_WINDOW].send = true;
        }
    }
}

static void take_heartbeat(msbot_xrce *client, uint16_t first, uint16_t last)
{
    if (way(client->handled, first) > 1) { /* messages missing before `first` will never come */
        client->handled = (uint16_t)(first - 1);
        client->pieces_size = 0;
        client->pieces_spoilt = true;
        if (way(client->announced, client->handled) > 0) {
            client->announced = client->handled;
        }
    }
    if (way(client->announced, last) > 0) {
        client->announced = last;
    }
    client->acknowledge = true;
}

static void take_submessage(msbot_xrce *client, uint8_t kind, uint8_t stream, const uint8_t *contents, size_t size,
                            uint32_t now_us)
{
    bool connected = client->state == MSBOT_XRCE_CONNECTED;
    if (kind == STATUS_AGENT && size >= 1 && stream == 0) {
        take_login_answer(client, contents[0], now_us);
    } else if (connected && kind == DATA && size >= 4) {
        client->on_data(client->context, ids(contents + 2), contents + 4, size - 4, now_us);
    } else if (connected && kind == STATUS && size >= 6) {
        if (contents[4] >= 0x80) {
            client->refused++;
        }
    } else if (connected && kind == ACKNACK && size >= 5) {
        if (contents[4] == MSBOT_RELIABLE) {
            take_acknack(client, u16(contents), ids(contents + 2), now_us);
        }
    } else if (connected && kind == HEARTBEAT && size >= 5) {
        if (contents[4] == MSBOT_RELIABLE) {
            take_heartbeat(client, u16(contents), u16(contents + 2));
        }
    } else if (connected && kind == INFO && size >= 6) {
        if (contents[5] != 1) {
            lose(client, now_us); /* the agent does not know this session any more */
        }
    } else if (connected && kind == GET_INFO && size >= 4) {
        memcpy(client->question, contents, 4);
        client->inform = true;
    } else {
        client->dropped++;
    }
}

/* Takes a FRAGMENT; if it is the last, returns the size of the whole, which is in `pieces`; else 0. */
static size_t take_piece(msbot_xrce *client, bool last, const uint8_t *piece, size_t size)
{
    if (client->pieces_size + size > sizeof client->pieces) {
        client->pieces_spoilt = true;
    }
    if (!client->pieces_spoilt) {
        memcpy(client->pieces + client->pieces_size, piece, size);
        client->pieces_size = (uint16_t)(client->pieces_size + size);
    }
    if (!last) {
        return 0;
    }
    size_t whole = client->pieces_spoilt ? 0 : client->pieces_size;
    if (client->pieces_spoilt) {
        client->dropped++;
    }
    client->pieces_size = 0;
    client->pieces_spoilt = false;
    return whole;
}

typedef struct {
    const uint8_t *octets;
    size_t size, at;
} submessages;

/* Takes submessages one after the other, and those from fragments in their place; an unreadable one ends the message. */
static void take_all(msbot_xrce *client, uint8_t stream, const uint8_t *octets, size_t size, uint32_t now_us)
{
    uint8_t session = client->session;
    submessages outer = {octets, size, 0};
    submessages inner = {client->pieces, 0, 0};
    while (session == client->session) {
        bool inside = inner.at + 4 <= inner.size;
        submessages *from = inside ? &inner : &outer;
        if (from->at + 4 > from->size) {
            return;
        }
        const uint8_t *head = from->octets + from->at;
        size_t length = u16(head + 2);
        if (length > from->size - from->at - 4 || !(head[1] & LITTLE_ENDIAN_FLAG)) {
            client->dropped++;
            return;
        }
        from->at = (from->at + 4 + length + 3) & ~(size_t)3;
        if (head[0] == FRAGMENT && stream == MSBOT_RELIABLE && !inside) {
            inner.size = take_piece(client, (head[1] & LAST_FRAGMENT_FLAG) != 0, head + 4, length);
            inner.at = 0;
        } else {
            take_submessage(client, head[0], stream, head + 4, length, now_us);
        }
    }
}

void msbot_xrce_receive(msbot_xrce *client, const uint8_t *packet, size_t size, uint32_t now_us)
{
    if (client->state == MSBOT_XRCE_CLOSED || size < 4 || packet[0] != client->session) {
        client->dropped++;
        return;
    }
    uint8_t stream = packet[1];
    uint16_t number = u16(packet + 2);
    client->heard_us = now_us;
    client->pings = 0;
    if (stream != 0 && client->state != MSBOT_XRCE_CONNECTED) {
        client->dropped++;
        return;
    }
    if (stream == MSBOT_RELIABLE) {
        client->acknowledge = true;
        if (way(client->announced, number) > 0 && way(client->handled, number) <= 32) {
            client->announced = number;
        }
        if (way(client->handled, number) != 1) {
            return; /* early, or a repetition */
        }
        client->handled = number;
    } else if (stream == MSBOT_BEST_EFFORT) {
        if (way(client->newest, number) <= 0) {
            return;
        }
        client->newest = number;
    } else if (stream != 0) {
        client->dropped++;
        return;
    }
    take_all(client, stream, packet + 4, size - 4, now_us);
}

/* Time. */

void msbot_xrce_tick(msbot_xrce *client, uint32_t now_us)
{
    if (client->state == MSBOT_XRCE_CONNECTING) {
        if (!client->login_due && is_due(client->login_us + LOGIN_PERIOD_US, now_us)) {
            client->login_due = true;
        }
    } else if (client->state == MSBOT_XRCE_CONNECTED) {
        if (client->first == client->next) {
            client->progress_us = now_us;
        } else if (is_due(client->progress_us + STALL_US, now_us)) {
            lose(client, now_us);
            return;
        }
        if (client->pings == 0) {
            client->ping = client->ping || is_due(client->heard_us + QUIET_US, now_us);
        } else if (!client->ping && is_due(client->ping_us + PING_US, now_us)) {
            if (client->pings >= PINGS) {
                lose(client, now_us);
            } else {
                client->ping = true;
            }
        }
    }
}

bool msbot_xrce_timer(const msbot_xrce *client, uint32_t *at)
{
    if (client->state == MSBOT_XRCE_CONNECTED) {
        *at = client->pings ? client->ping_us + PING_US : client->heard_us + QUIET_US;
        if (client->first != client->next && (int32_t)(client->asked_us + HEARTBEAT_US - *at) < 0) {
            *at = client->asked_us + HEARTBEAT_US;
        }
    } else {
        *at = client->login_us + LOGIN_PERIOD_US;
    }
    return client->state != MSBOT_XRCE_CLOSED;
}

/* Sending. */

static size_t put_outside(const msbot_xrce *client, uint8_t *packet, uint8_t kind, const uint8_t *contents, size_t size)
{
    const uint8_t head[8] = {client->session, 0, 0, 0, kind, LITTLE_ENDIAN_FLAG, (uint8_t)size, 0};
    memcpy(packet, head, 8);
    memcpy(packet + 8, contents, size);
    return 8 + size;
}

static size_t put_login(msbot_xrce *client, uint8_t *packet, uint32_t now_us)
{
    uint8_t contents[16] = {'X', 'R', 'C', 'E', 1, 0, 1, 15};
    put_ids(contents + 8, (uint16_t)(client->key >> 16));
    put_ids(contents + 10, (uint16_t)client->key);
    contents[12] = client->session;
    put_u16(contents + 14, MSBOT_XRCE_MTU);
    client->login_due = false;
    client->login_us = now_us;
    if (client->logins < UINT8_MAX) {
        client->logins++;
    }
    size_t size = put_outside(client, packet, 0, contents, sizeof contents);
    packet[0] = 0x80; /* outside of sessions */
    return size;
}

static size_t put_acknack(msbot_xrce *client, uint8_t *packet)
{
    uint8_t contents[5];
    int missing = way(client->handled, client->announced);
    uint16_t bitmap = (uint16_t)(missing <= 0 ? 0 : missing >= 16 ? 0xFFFF : (1U << missing) - 1U);
    client->acknowledge = false;
    put_u16(contents, (uint16_t)(client->handled + 1));
    put_ids(contents + 2, bitmap);
    contents[4] = MSBOT_RELIABLE;
    return put_outside(client, packet, ACKNACK, contents, sizeof contents);
}

static size_t put_ping(msbot_xrce *client, uint8_t *packet, uint32_t now_us)
{
    static const uint8_t contents[8] = {0, 10, 0xFF, 0xFD, 2, 0, 0, 0};
    client->ping = false;
    client->ping_us = now_us;
    client->pings++;
    return put_outside(client, packet, GET_INFO, contents, sizeof contents);
}

static size_t put_info(msbot_xrce *client, uint8_t *packet)
{
    uint8_t contents[8] = {0};
    client->inform = false;
    memcpy(contents, client->question, 4);
    return put_outside(client, packet, INFO, contents, sizeof contents);
}

static size_t put_heartbeat(msbot_xrce *client, uint8_t *packet, uint32_t now_us)
{
    uint8_t contents[5];
    client->asked_us = now_us;
    put_u16(contents, client->first);
    put_u16(contents + 2, (uint16_t)(client->next - 1));
    contents[4] = MSBOT_RELIABLE;
    return put_outside(client, packet, HEARTBEAT, contents, sizeof contents);
}

size_t msbot_xrce_next(msbot_xrce *client, uint8_t *packet, uint32_t now_us)
{
    if (client->login_due && client->state == MSBOT_XRCE_CONNECTING) {
        return put_login(client, packet, now_us);
    }
    if (client->state != MSBOT_XRCE_CONNECTED) {
        return 0;
    }
    if (client->acknowledge) {
        return put_acknack(client, packet);
    }
    if (client->inform) {
        return put_info(client, packet);
    }
    for (uint16_t number = client->first; number != client->next; number++) {
        unsigned slot = number % MSBOT_XRCE_WINDOW;
        if (client->kept[slot].send) {
            client->kept[slot].send = false;
            client->open = client->open && (uint16_t)(number + 1) != client->next;
            client->asked_us = now_us;
            client->sent_in_session = true;
            memcpy(packet, client->kept[slot].octets, client->kept[slot].size);
            return client->kept[slot].size;
        }
    }
    if (client->queue_size > 0) {
        unsigned slot = client->queue_first;
        client->queue_first = (uint8_t)((slot + 1) % MSBOT_XRCE_QUEUE);
        client->queue_size--;
        client->sent_in_session = true;
        memcpy(packet, client->queue[slot].octets, client->queue[slot].size);
        return client->queue[slot].size;
    }
    if (client->ping) {
        return put_ping(client, packet, now_us);
    }
    if (client->first != client->next && is_due(client->asked_us + HEARTBEAT_US, now_us)) {
        return put_heartbeat(client, packet, now_us);
    }
    return 0;
}

/* Booking. */

static size_t begin_message(msbot_xrce *client, uint8_t *octets, uint8_t stream, uint16_t number)
{
    octets[0] = client->session;
    octets[1] = stream;
    put_u16(octets + 2, number);
    return 4;
}

/* Appends a submessage to a message of `at` octets; returns its new size, filled up to a multiple of 4. */
static size_t append(uint8_t *octets, size_t at, uint8_t kind, uint8_t flags, const uint8_t *contents, size_t size)
{
    octets[at] = kind;
    octets[at + 1] = flags;
    put_u16(octets + at + 2, (uint16_t)size);
    memcpy(octets + at + 4, contents, size);
    size_t end = at + 4 + size;
    memset(octets + end, 0, -end & 3U);
    return (end + 3) & ~(size_t)3;
}

/* Books a submessage on the reliable stream, in the newest message if it fits and may join it. */
static bool book(msbot_xrce *client, uint8_t kind, uint8_t flags, const uint8_t *contents, size_t size, bool alone)
{
    if (client->state != MSBOT_XRCE_CONNECTED || size > MSBOT_XRCE_MTU - 11) {
        return false;
    }
    unsigned slot = (uint16_t)(client->next - 1) % MSBOT_XRCE_WINDOW;
    if (alone || !client->open || client->kept[slot].size + size + 7 > MSBOT_XRCE_MTU) {
        if ((uint16_t)(client->next - client->first) >= MSBOT_XRCE_WINDOW) {
            return false;
        }
        slot = client->next % MSBOT_XRCE_WINDOW;
        client->kept[slot].size = (uint16_t)begin_message(client, client->kept[slot].octets, MSBOT_RELIABLE, client->next);
        client->kept[slot].send = true;
        client->next++;
    }
    client->kept[slot].size = (uint16_t)append(client->kept[slot].octets, client->kept[slot].size, kind, flags, contents, size);
    client->open = !alone;
    return true;
}

/* The objects to be created, in their form on the wire. */
typedef struct {
    uint8_t octets[MSBOT_XRCE_MTU];
    size_t size;
    bool full;
} writer;

static void put(writer *to, const void *octets, size_t size)
{
    if (size > sizeof to->octets - to->size) {
        to->full = true;
        return;
    }
    memcpy(to->octets + to->size, octets, size);
    to->size += size;
}

static void put_octet(writer *to, uint8_t octet) { put(to, &octet, 1); }

/* Every CREATE begins with 12 octets, a multiple of 4, so positions can count from the blob. */
static void put_joined(writer *to, const char *text, size_t length, const char *ending)
{
    size_t more = strlen(ending) + 1;
    const uint8_t size[4] = {(uint8_t)(length + more), (uint8_t)((length + more) >> 8)};
    static const uint8_t zeros[3] = {0};
    put(to, zeros, -to->size & 3U);
    put(to, size, 4);
    put(to, text, length);
    put(to, ending, more);
}

static void put_string(writer *to, const char *text) { put_joined(to, text, strlen(text), ""); }

static void put_optional(writer *to, const char *text)
{
    put_octet(to, 1);
    put_string(to, text);
}

static bool create(msbot_xrce *client, uint16_t object_id, writer *blob, uint16_t parent)
{
    uint8_t *octets = blob->octets;
    uint16_t request = client->request < LAST_REQUEST ? client->request + 1U : FIRST_REQUEST;
    put_ids(octets, request);
    put_ids(octets + 2, object_id);
    octets[4] = object_id & 15U;
    octets[5] = 3; /* binary */
    put_u16(octets + 6, 0);
    put_u16(octets + 8, (uint16_t)(blob->size - 12));
    put_u16(octets + 10, 0);
    const uint8_t parents[2] = {(uint8_t)(parent >> 8), (uint8_t)parent};
    put(blob, parents, 2);
    if (blob->full || !book(client, CREATE, LITTLE_ENDIAN_FLAG | REUSE_AND_REPLACE, octets, blob->size, false)) {
        return false;
    }
    client->request = request;
    return true;
}

static void begin_blob(writer *blob)
{
    blob->size = 12;
    blob->full = false;
}

bool msbot_xrce_create_group(msbot_xrce *client, uint16_t object_id, uint16_t participant_id)
{
    writer blob;
    begin_blob(&blob);
    put(&blob, "\0\0", 2); /* no name */
    return create(client, object_id, &blob, participant_id);
}

bool msbot_xrce_create_participant(msbot_xrce *client, uint16_t object_id)
{
    return msbot_xrce_create_group(client, object_id, 0); /* in place of a parent: domain 0 */
}

bool msbot_xrce_create_topic(msbot_xrce *client, uint16_t object_id, uint16_t participant_id, const char *name,
                             const char *type)
{
    writer blob;
    begin_blob(&blob);
    put_string(&blob, name);
    put_octet(&blob, 0);
    put_optional(&blob, type);
    return create(client, object_id, &blob, participant_id);
}

bool msbot_xrce_create_endpoint(msbot_xrce *client, uint16_t object_id, uint16_t group_id, uint16_t topic_id,
                                bool reliable)
{
    /* Topic; quality of service: (reliable,) keep last; no depth, and no further policies, of which a writer has one
     * less. */
    const uint8_t octets[12] = {(uint8_t)(topic_id >> 8), (uint8_t)topic_id, 1, 0, reliable ? 3 : 2, 0};
    writer blob;
    begin_blob(&blob);
    put(&blob, octets, (object_id & 15U) == 5 ? 11 : 12);
    return create(client, object_id, &blob, group_id);
}

bool msbot_xrce_create_requester(msbot_xrce *client, uint16_t object_id, uint16_t participant_id,
                                 const char *const names[5])
{
    writer blob;
    begin_blob(&blob);
    put_string(&blob, names[0]);
    put_string(&blob, names[1]);
    put_string(&blob, names[2]);
    put_optional(&blob, names[3]);
    put_optional(&blob, names[4]);
    return create(client, object_id, &blob, participant_id);
}

bool msbot_xrce_create_service(msbot_xrce *client, uint16_t object_id, uint16_t participant_id, const char *topic,
                               const char *type)
{
    const char *arrow = strstr(type, " -> ");
    writer blob;
    if (arrow == NULL) {
        return false;
    }
    begin_blob(&blob);
    put_string(&blob, topic);
    put_joined(&blob, type, (size_t)(arrow - type), "");
    put_string(&blob, arrow + 4);
    put_octet(&blob, 1);
    put_joined(&blob, topic, strlen(topic), "_Request");
    put_octet(&blob, 1);
    put_joined(&blob, topic, strlen(topic), "_Reply");
    return create(client, object_id, &blob, participant_id);
}

bool msbot_xrce_delete(msbot_xrce *client, uint16_t object_id)
{
    uint8_t contents[4];
    uint16_t request = client->request < LAST_REQUEST ? client->request + 1U : FIRST_REQUEST;
    put_ids(contents, request);
    put_ids(contents + 2, object_id);
    if (!book(client, DELETE, LITTLE_ENDIAN_FLAG, contents, sizeof contents, false)) {
        return false;
    }
    client->request = request;
    return true;
}

bool msbot_xrce_read(msbot_xrce *client, uint16_t object_id, uint8_t stream, msbot_read_what what)
{
    uint8_t contents[16] = {0};
    put_ids(contents, (uint16_t)(0xC000U | (object_id & 0x3FFFU))); /* by rule: header compression leaves it out */
    put_ids(contents + 2, object_id);
    contents[4] = stream;
    contents[7] = what != MSBOT_READ_ONE; /* a delivery control follows */
    contents[8] = contents[9] = what == MSBOT_READ_ALL ? 0xFF : 0;
    return book(client, READ_DATA, LITTLE_ENDIAN_FLAG, contents, what == MSBOT_READ_ONE ? 8 : 16, false);
}

bool msbot_xrce_write(msbot_xrce *client, uint16_t object_id, uint8_t stream, const uint8_t *payload, size_t size)
{
    uint8_t contents[MSBOT_XRCE_MTU];
    bool reliable = stream == MSBOT_RELIABLE;
    uint16_t number = reliable ? client->next : client->best_effort;
    if (client->state != MSBOT_XRCE_CONNECTED || size > (reliable ? MSBOT_XRCE_MTU - 15 : MSBOT_XRCE_SAMPLE)) {
        return false;
    }
    put_ids(contents, (uint16_t)((reliable ? 0xA000U : 0x8000U) | (number & 0x1FFFU))); /* by rule, too */
    put_ids(contents + 2, object_id);
    if (size > 0) {
        memcpy(contents + 4, payload, size);
    }
    if (reliable) {
        return book(client, WRITE_DATA, LITTLE_ENDIAN_FLAG, contents, size + 4, true);
    }
    if (client->queue_size == MSBOT_XRCE_QUEUE) { /* the oldest is dropped */
        client->queue_first = (uint8_t)((client->queue_first + 1) % MSBOT_XRCE_QUEUE);
        client->queue_size--;
        client->not_sent++;
    }
    unsigned slot = (client->queue_first + client->queue_size) % MSBOT_XRCE_QUEUE;
    uint8_t *octets = client->queue[slot].octets;
    size_t head = begin_message(client, octets, MSBOT_BEST_EFFORT, number);
    client->queue[slot].size = (uint16_t)append(octets, head, WRITE_DATA, LITTLE_ENDIAN_FLAG, contents, size + 4);
    client->queue_size++;
    client->best_effort++;
    return true;
}
