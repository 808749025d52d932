/* The CAN link of a part: see msbot_can.h.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_can.h"

#include <string.h>

/* Identifiers (docs/reference/can.md). */
#define ID_STOP 0x008U
#define ID_UP 0x100U
#define ID_DOWN 0x180U
#define ID_BEACON 0x700U
#define ID_JOIN 0x1E000000U
#define ID_ASSIGN 0x02000000U
#define NODES 120U

/* Segment header. */
#define FIRST 0x80U
#define LAST 0x40U
#define COUNTER 0x3FU

#define MESSAGE_PAUSE_US 250000U
#define REPEAT_UNKNOWN 78U /* 5 ms, where the bit rate is unknown */
#define BEACON_TIMEOUT_US 3500000U
#define FIRST_PAUSE_US 10000U
#define LONGEST_PAUSE_US 800000U /* with the jitter: 1 s */
#define ASKS_SOON_US 12500
#define STOP_TIMES 3U
#define STOP_QUIET_US 100000U
#define PACKET_FRAMES 2U /* in the controller at a time: its third mailbox is for frames that go before packets */

static bool is_due(uint32_t at, uint32_t now) { return (int32_t)(now - at) >= 0; }

static uint16_t u16(const uint8_t *octets) { return (uint16_t)(octets[0] | octets[1] << 8); }

uint32_t msbot_crc32(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xFFFFFFFFU;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc >> 1 ^ ((crc & 1U) ? 0xEDB88320U : 0U);
        }
    }
    return ~crc;
}

/* CRC-8/AUTOSAR without its final value. */
static uint8_t check_step(uint8_t crc, uint8_t octet)
{
    crc ^= octet;
    for (int bit = 0; bit < 8; bit++) {
        crc = (uint8_t)((crc & 0x80U) ? (unsigned)crc << 1 ^ 0x2FU : (unsigned)crc << 1);
    }
    return crc;
}

/* The shortest data field of CAN FD for so many bytes. */
static size_t fd_length(size_t size)
{
    size_t few = size <= 8 ? size : (size + 3) & ~(size_t)3;
    return size <= 24 ? few : size <= 32 ? 32 : size <= 48 ? 48 : 64;
}

/* Segments: joining them. */

static void count(msbot_joiner *joiner, int reason)
{
    if (joiner->dropped[reason] < UINT16_MAX) {
        joiner->dropped[reason]++;
    }
}

static void drop(msbot_joiner *joiner, int reason)
{
    joiner->open = false;
    joiner->stray = true;
    count(joiner, reason);
}

void msbot_joiner_reset(msbot_joiner *joiner, uint16_t limit, uint16_t repeat)
{
    joiner->limit = limit;
    joiner->repeat = repeat;
    joiner->size = 0;
    joiner->expected = -1;
    joiner->open = joiner->several = joiner->stray = false;
    joiner->heard = 0;
    memset(joiner->seen, 0, sizeof joiner->seen);
}

/* Forgets frames that CAN can no longer repeat: 63 others were heard since, or their time is over. */
static void forget_frames(msbot_joiner *joiner, uint32_t now_us)
{
    bool all = now_us - joiner->called_us >= (uint32_t)joiner->repeat << 6;
    joiner->called_us = now_us;
    for (unsigned q = 0; q < 64; q++) {
        uint8_t frames = (uint8_t)(joiner->heard - joiner->seen_nr[q]);
        uint16_t age = (uint16_t)((now_us >> 6) - joiner->seen_at[q]);
        if (all || frames >= 63 || age >= joiner->repeat) {
            joiner->seen[q] = 0;
        }
    }
}

/* Whether CAN has repeated this frame; a new one is remembered. Two frames with the same hash only cost a message. */
static bool is_repeated(msbot_joiner *joiner, const uint8_t *data, size_t size, uint32_t now_us)
{
    uint32_t crc = msbot_crc32(data, size);
    uint16_t hash = (uint16_t)((crc ^ crc >> 16) | 1U);
    uint8_t q = data[0] & COUNTER;
    forget_frames(joiner, now_us);
    if (joiner->seen[q] == hash) {
        return true;
    }
    joiner->seen[q] = hash;
    joiner->seen_at[q] = (uint16_t)(now_us >> 6);
    joiner->seen_nr[q] = ++joiner->heard;
    return false;
}

static void append(msbot_joiner *joiner, const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        joiner->check = check_step(joiner->check, data[i]);
        if (joiner->size < sizeof joiner->body) {
            joiner->body[joiner->size] = data[i];
        }
        joiner->size++;
    }
}

static size_t finish(msbot_joiner *joiner)
{
    joiner->open = false;
    if (joiner->several && joiner->size > 0) {
        /* A message followed by its check byte always leaves the same remainder. */
        if (joiner->check != check_step(0, 0xFF)) {
            count(joiner, MSBOT_DROP_WRONG_CHECK_BYTE);
            return 0;
        }
        joiner->size--;
    }
    if (joiner->size == 0 || joiner->size > joiner->limit) {
        count(joiner, joiner->size ? MSBOT_DROP_TOO_LONG : MSBOT_DROP_EMPTY_MESSAGE);
        return 0;
    }
    return joiner->size;
}

/* Applies the frame to the message in progress; false: it belongs to none. */
static bool fits(msbot_joiner *joiner, uint8_t header, uint32_t now_us)
{
    uint8_t q = header & COUNTER;
    bool first_ever = joiner->expected < 0;
    bool skipped = q != joiner->expected;
    joiner->expected = (int16_t)((q + 1U) & COUNTER);
    if (joiner->open) {
        if (skipped) {
            drop(joiner, MSBOT_DROP_FRAME_LOST);
        } else if (now_us - joiner->at_us > MESSAGE_PAUSE_US) {
            drop(joiner, MSBOT_DROP_TOO_SLOW);
        } else if (header & FIRST) {
            drop(joiner, MSBOT_DROP_UNFINISHED);
        }
    } else if (skipped && !first_ever && (header & FIRST) && !joiner->stray) {
        count(joiner, MSBOT_DROP_MESSAGE_LOST);
    }
    if (header & FIRST) {
        joiner->stray = joiner->several = false;
        joiner->open = true;
        joiner->size = 0;
        joiner->check = 0xFF;
        return true;
    }
    joiner->several = true;
    if (!joiner->open) {
        if (!joiner->stray) {
            count(joiner, MSBOT_DROP_NO_FIRST_FRAME);
        }
        joiner->stray = !(header & LAST);
    }
    return joiner->open;
}

size_t msbot_joiner_take(msbot_joiner *joiner, const uint8_t *data, size_t size, uint32_t now_us)
{
    if (size == 0) {
        count(joiner, MSBOT_DROP_EMPTY_FRAME);
        return 0;
    }
    if (is_repeated(joiner, data, size, now_us)) {
        count(joiner, MSBOT_DROP_REPEATED);
        return 0;
    }
    uint8_t header = data[0];
    if (!fits(joiner, header, now_us)) {
        return 0;
    }
    if ((header & LAST) && size > 8) {
        if (data[1] > 62 || fd_length(data[1] + 2U) != size) {
            drop(joiner, MSBOT_DROP_WRONG_LENGTH);
            joiner->stray = false;
            return 0;
        }
        append(joiner, data + 2, data[1]);
    } else {
        append(joiner, data + 1, size - 1);
    }
    if (header & LAST) {
        return finish(joiner);
    }
    joiner->at_us = now_us;
    if (joiner->size > joiner->limit + 1U) {
        drop(joiner, MSBOT_DROP_TOO_LONG);
    }
    return 0;
}

/* Segments: cutting. */

void msbot_splitter_begin(msbot_splitter *splitter)
{
    if (splitter->size > (splitter->fd ? 62 : 7)) {
        uint8_t check = 0xFF;
        for (size_t i = 0; i < splitter->size; i++) {
            check = check_step(check, splitter->body[i]);
        }
        splitter->body[splitter->size++] = check ^ 0xFFU;
    }
    splitter->sent = 0;
    splitter->waiting = true;
    splitter->begun = false;
}

size_t msbot_splitter_next(msbot_splitter *splitter, uint8_t *data)
{
    if (!splitter->waiting) {
        return 0;
    }
    size_t rest = (size_t)splitter->size - splitter->sent;
    size_t most = splitter->fd ? 63 : 7;
    bool last = splitter->fd ? rest < most : rest <= most; /* a last frame of CAN FD has a length byte */
    size_t size = rest < most ? rest : most;
    size_t at = last && size > 7 ? 2 : 1;
    data[0] = (uint8_t)((splitter->begun ? 0U : FIRST) | (last ? LAST : 0U) | splitter->q);
    if (at == 2) {
        data[1] = (uint8_t)size;
    }
    memcpy(data + at, splitter->body + splitter->sent, size);
    size_t length = fd_length(at + size);
    memset(data + at + size, 0, length - at - size);
    splitter->q = (splitter->q + 1U) & COUNTER;
    splitter->sent = (uint16_t)(splitter->sent + size);
    splitter->begun = true;
    splitter->waiting = !last;
    return length;
}

/* Joining. */

static uint8_t caps_of(const msbot_can *link)
{
    return (uint8_t)((link->config.fd ? MSBOT_CAP_FD : 0) | (link->config.codec != NULL ? MSBOT_CAP_COMPRESSION : 0));
}

static void ask(msbot_can *link)
{
    link->has_due = false;
    link->ask = link->awaiting_departure = true;
}

static void be_silent(msbot_can *link)
{
    link->node_id = 0;
    link->has_due = link->ask = link->awaiting_departure = false;
    link->out.waiting = false;
    link->packet = 0;
}

static void join(msbot_can *link)
{
    be_silent(link);
    link->state = MSBOT_CAN_JOINING;
    link->has_deadline = false;
    link->pause_us = FIRST_PAUSE_US;
    ask(link);
}

static void tell_lost(msbot_can *link, msbot_lost reason)
{
    link->reason = reason;
    link->events = (uint8_t)((link->events & ~(unsigned)MSBOT_EVENT_UP) | MSBOT_EVENT_DOWN);
}

static void lose(msbot_can *link, msbot_lost reason)
{
    join(link);
    tell_lost(link, reason);
}

static void expect_beacon(msbot_can *link, uint32_t now_us)
{
    link->has_deadline = true;
    link->deadline_us = now_us + BEACON_TIMEOUT_US;
}

/* Whether a JOIN still waits for the bus, or the next one is due about as soon as the answer to the last. */
static bool asks_soon(const msbot_can *link, uint32_t now_us)
{
    return link->awaiting_departure || (link->has_due && (int32_t)(link->due_us - now_us) <= ASKS_SOON_US);
}

static void hear_foreign_beacon(msbot_can *link, uint16_t epoch, uint32_t now_us)
{
    if (link->state == MSBOT_CAN_JOINED && epoch != link->epoch) {
        return; /* our own master is on the bus, too; it deals with the other */
    }
    bool known = link->state == MSBOT_CAN_FOREIGN;
    be_silent(link);
    link->state = MSBOT_CAN_FOREIGN;
    expect_beacon(link, now_us);
    if (!known) {
        tell_lost(link, MSBOT_LOST_OTHER_ROBOT);
    }
}

static void hear_beacon(msbot_can *link, const uint8_t *data, uint32_t now_us)
{
    uint16_t epoch = u16(data + 2) & 0x3FFFU;
    uint32_t robot = u16(data + 4) | (uint32_t)u16(data + 6) << 16;
    bool news = !link->has_beacon || epoch != link->beacon_epoch;
    link->has_beacon = true;
    link->beacon_epoch = epoch;
    if (link->state == MSBOT_CAN_OFF) {
        return;
    }
    if (link->config.has_robot && robot != link->config.robot) {
        hear_foreign_beacon(link, epoch, now_us);
    } else if (link->state == MSBOT_CAN_JOINED) {
        bool changed = link->has_profile && robot != link->profile;
        expect_beacon(link, now_us);
        if (epoch != link->epoch) {
            lose(link, MSBOT_LOST_EPOCH);
        } else if (changed) {
            lose(link, MSBOT_LOST_PROFILE);
        } else {
            link->has_profile = true;
            link->profile = robot;
        }
    } else if (link->state == MSBOT_CAN_FOREIGN || (news && !asks_soon(link, now_us))) {
        join(link);
    }
}

static void hear_assign(msbot_can *link, uint32_t id, const uint8_t *uid, uint32_t now_us)
{
    uint8_t node_id = id & 0xFFU;
    if (node_id > NODES || link->state == MSBOT_CAN_OFF) {
        return;
    }
    if (memcmp(uid, link->config.uid, sizeof link->config.uid) != 0) {
        if (link->state == MSBOT_CAN_JOINED && node_id == link->node_id) {
            lose(link, MSBOT_LOST_TO_ANOTHER);
        }
        return;
    }
    if (link->state != MSBOT_CAN_JOINING) {
        return;
    }
    if (node_id == 0) {
        link->pause_us = LONGEST_PAUSE_US;
        if (!link->refused) {
            tell_lost(link, MSBOT_LOST_FULL);
        }
        link->refused = true;
        return;
    }
    be_silent(link);
    link->state = MSBOT_CAN_JOINED;
    link->node_id = node_id;
    link->epoch = id >> 10 & 0x3FFFU;
    link->use = (uint8_t)(id >> 8 & caps_of(link));
    link->has_profile = link->refused = false;
    link->events |= MSBOT_EVENT_UP;
    expect_beacon(link, now_us);
    /* The counter cannot wrap within 64 full frames, each longer than 100 bits (except with FD). */
    bool fd = (link->use & MSBOT_CAP_FD) != 0;
    uint32_t repeat = fd || link->config.bitrate == 0 ? REPEAT_UNKNOWN : 100000000U / link->config.bitrate;
    msbot_joiner_reset(&link->in, MSBOT_CAN_MTU + (link->use & MSBOT_CAP_COMPRESSION ? 1 : 0),
                       (uint16_t)(repeat > 0x7FFF ? 0x7FFF : repeat));
    link->out.fd = fd;
    link->out.q = 0;
}

static void hear_stop(msbot_can *link, const msbot_frame *frame, uint32_t now_us)
{
    uint8_t reason = frame->size > 0 ? frame->data[0] : 0;
    /* Frames with one reason that follow each other within this time are one STOP. */
    if (!link->has_stop || link->stop_heard != reason || now_us - link->stop_us > STOP_QUIET_US) {
        link->stop_reason = reason;
        link->events |= MSBOT_EVENT_STOP;
    }
    link->has_stop = true;
    link->stop_heard = reason;
    link->stop_us = now_us;
}

void msbot_can_init(msbot_can *link, const msbot_can_config *config)
{
    uint32_t random = msbot_crc32(config->uid, sizeof config->uid) ^ config->seed;
    memset(link, 0, sizeof *link);
    link->config = *config;
    link->random = random ? random : 1;
}

void msbot_can_start(msbot_can *link) { join(link); }

void msbot_can_stop(msbot_can *link)
{
    be_silent(link);
    link->state = MSBOT_CAN_OFF;
    link->has_deadline = false;
    link->stop_frames = 0;
    tell_lost(link, MSBOT_LOST_BUS);
}

void msbot_can_receive(msbot_can *link, const msbot_frame *frame, uint32_t now_us)
{
    if (frame->flags & MSBOT_REMOTE) {
        return;
    }
    bool is_classic = !(frame->flags & MSBOT_FD);
    if (frame->flags & MSBOT_EXTENDED) {
        if (is_classic && frame->size == 8 && (frame->id & ~0xFFFFFFU) == ID_ASSIGN) {
            hear_assign(link, frame->id, frame->data, now_us);
        }
    } else if (link->node_id > 0 && frame->id == ID_DOWN + link->node_id) {
        link->packet = (uint16_t)msbot_joiner_take(&link->in, frame->data, frame->size, now_us);
    } else if (frame->id == ID_STOP && is_classic) {
        hear_stop(link, frame, now_us);
    } else if (frame->id == ID_BEACON && is_classic && frame->size == 8 && frame->data[0] == 1) {
        hear_beacon(link, frame->data, now_us);
    }
}

void msbot_can_tick(msbot_can *link, uint32_t now_us)
{
    if (link->has_due && is_due(link->due_us, now_us)) {
        ask(link);
    }
    if (link->has_deadline && is_due(link->deadline_us, now_us)) {
        link->has_deadline = false;
        if (link->state == MSBOT_CAN_FOREIGN) {
            join(link);
        } else {
            lose(link, MSBOT_LOST_BEACON);
        }
    }
}

bool msbot_can_timer(const msbot_can *link, uint32_t *at)
{
    bool due_first = link->has_due && (!link->has_deadline || is_due(link->due_us, link->deadline_us));
    *at = due_first ? link->due_us : link->deadline_us;
    return link->has_due || link->has_deadline;
}

bool msbot_can_next(msbot_can *link, unsigned pending, msbot_frame *frame)
{
    frame->flags = 0;
    if (link->stop_frames > 0) {
        link->stop_frames--;
        frame->id = ID_STOP;
        frame->size = 1;
        frame->data[0] = link->stop_to_send;
        return true;
    }
    if (link->ask) {
        link->ask = false;
        frame->id = ID_JOIN | (uint32_t)caps_of(link) << 22 | (msbot_crc32(link->config.uid, 8) & 0x3FFFFFU);
        frame->flags = MSBOT_EXTENDED;
        frame->size = 8;
        memcpy(frame->data, link->config.uid, 8);
        return true;
    }
    bool may_send = link->node_id > 0 && pending < PACKET_FRAMES;
    frame->size = may_send ? (uint8_t)msbot_splitter_next(&link->out, frame->data) : 0;
    frame->id = ID_UP + link->node_id;
    frame->flags = link->out.fd ? MSBOT_FD | (link->config.fast ? MSBOT_BRS : 0) : 0;
    return frame->size > 0;
}

void msbot_can_drained(msbot_can *link, uint32_t now_us)
{
    if (!link->awaiting_departure || link->ask) {
        return;
    }
    link->awaiting_departure = false;
    link->random ^= link->random << 13; /* xorshift32 */
    link->random ^= link->random >> 17;
    link->random ^= link->random << 5;
    /* The pause, a quarter more or less. */
    uint32_t jitter = (link->pause_us >> 4) * (link->random >> 16) >> 13;
    link->has_due = true;
    link->due_us = now_us + link->pause_us - link->pause_us / 4 + jitter;
    link->pause_us = 2 * link->pause_us < LONGEST_PAUSE_US ? 2 * link->pause_us : LONGEST_PAUSE_US;
}

uint8_t msbot_can_events(msbot_can *link)
{
    uint8_t events = link->events;
    link->events = 0;
    return events;
}

void msbot_can_say_stop(msbot_can *link, uint8_t reason)
{
    if (link->state != MSBOT_CAN_OFF) {
        link->stop_to_send = reason;
        link->stop_frames = STOP_TIMES;
    }
}

bool msbot_can_send(msbot_can *link, const uint8_t *packet, size_t size)
{
    msbot_splitter *out = &link->out;
    if (link->node_id == 0 || out->waiting || size == 0 || size > MSBOT_CAN_MTU) {
        return false;
    }
    if (link->use & MSBOT_CAP_COMPRESSION) {
        out->size = (uint16_t)link->config.codec->compress(out->body, packet, size);
    } else {
        memcpy(out->body, packet, size);
        out->size = (uint16_t)size;
    }
    msbot_splitter_begin(out);
    return true;
}

size_t msbot_can_read(msbot_can *link, uint8_t *packet, size_t room)
{
    size_t size = link->packet;
    link->packet = 0;
    if (size > 0 && link->use & MSBOT_CAP_COMPRESSION) {
        int whole = link->config.codec->decompress(packet, room, link->in.body, size);
        if (whole < 0) {
            count(&link->in, MSBOT_DROP_NOT_COMPRESSED);
        }
        return whole > 0 ? (size_t)whole : 0;
    }
    if (size > room) {
        count(&link->in, MSBOT_DROP_TOO_LONG);
        return 0;
    }
    memcpy(packet, link->in.body, size);
    return size;
}
