/* Plug-and-play: see msbot_part.h; the rules and the messages are those of docs/explain/plug_and_play.md.
 *
 * Frames and times come in; `book` then sends the agent whatever there is room for, in the order in which the agent
 * needs it. So nothing here waits, and nothing is forgotten when there is no room: it stays due until it is sent.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "msbot_part.h"

#include "msbot_sha256.h"

#include <string.h>

#define RETRY_US 2000000U
#define ANSWER_US 1000000U
#define SILENT_BEATS 12U
#define SHORTEST_BEAT_MS 20U
#define LONGEST_NAMES (MSBOT_XRCE_MTU - 48U) /* a claim with them fits into one message */
#define LONGEST_CALL_US 1800000000U
#define NEVER UINT32_MAX /* no GO has that number */

enum { PARTICIPANT = 0x0011, PROFILE_TOPIC = 0x0012, PUBLISHER = 0x0013, SUBSCRIBER = 0x0014, PROFILE_READER = 0x0016,
       INVENTORY = 0x0017 };
enum { OBJECTS = 5 };
enum { TELL_NATURE = 1, TELL_SOFTWARE = 2, TELL_HOME = 4 };
/* As pieces of a line (msbot_log.c), of kinds of their own; each text is one piece. */
enum { SOFTWARE_PIECE = 0xD0, HOME_PIECE = 0xE0, PIECE = 12 };
enum { PARTNER_LOST = 1, IDENTIFY = 3, STOP = 4, GO = 5 };

static bool is_due(uint32_t at, uint32_t now) { return (int32_t)(now - at) >= 0; }

static uint32_t u32(const uint8_t *octets)
{
    return octets[0] | (uint32_t)octets[1] << 8 | (uint32_t)octets[2] << 16 | (uint32_t)octets[3] << 24;
}

static void put_u32(uint8_t *octets, uint32_t value)
{
    for (unsigned i = 0; i < 4; i++) {
        octets[i] = (uint8_t)(value >> 8 * i);
    }
}

static uint32_t draw(msbot_part *part) /* xorshift32: never 0 */
{
    part->random ^= part->random << 13;
    part->random ^= part->random >> 17;
    part->random ^= part->random << 5;
    return part->random;
}

static uint16_t topic_id(unsigned port) { return (uint16_t)(0x0022 + 16 * port); }

static uint16_t endpoint_id(const msbot_part *part, unsigned port)
{
    /* Data reader 1 reads the profile, requester 1 asks the inventory. */
    static const uint16_t first[4] = {0x0026, 0x0015, 0x0018, 0x0027};
    return (uint16_t)(first[part->config.ports[port].does] + 16 * port);
}

static bool is_service(const msbot_part *part, unsigned port) { return part->config.ports[port].does >= MSBOT_SERVES; }

/* Reading what comes. */

typedef struct {
    const uint8_t *octets;
    size_t size, at;
    bool broken;
} reader;

static uint32_t take_u32(reader *from)
{
    from->at = (from->at + 3) & ~(size_t)3;
    if (from->broken || from->at + 4 > from->size) {
        from->broken = true;
        return 0;
    }
    from->at += 4;
    return u32(from->octets + from->at - 4);
}

static uint8_t take_u8(reader *from)
{
    if (from->broken || from->at >= from->size) {
        from->broken = true;
        return 0;
    }
    return from->octets[from->at++];
}

static const char *take_string(reader *from)
{
    uint32_t length = take_u32(from);
    if (from->broken || length == 0 || length > from->size - from->at || from->octets[from->at + length - 1] != 0) {
        from->broken = true;
        return "";
    }
    from->at += length;
    return (const char *)from->octets + from->at - length;
}

typedef struct {
    const char *port, *topic, *type;
    uint16_t topic_at;
    uint8_t does;
    bool reliable;
} binding;

static binding take_binding(reader *from)
{
    binding taken;
    taken.port = take_string(from);
    taken.topic = take_string(from);
    taken.topic_at = (uint16_t)(from->at - strlen(taken.topic) - 1);
    taken.type = take_string(from);
    taken.does = take_u8(from);
    taken.does = taken.does < 2 ? !taken.does : taken.does; /* there 0 is to publish, 1 to subscribe */
    taken.reliable = take_u8(from) != 0;
    return taken;
}

/* The states (the same as in MsBOT's own parts). */

static bool claims(const msbot_part *part) { return part->state == MSBOT_CLAIMING || part->state == MSBOT_REFUSED; }

static bool beats(const msbot_part *part) { return part->state == MSBOT_CONFIGURING || part->state == MSBOT_ACTIVE; }

static bool hears_master(const msbot_part *part)
{
    return part->state != MSBOT_LOOKING && part->state != MSBOT_LOST && part->state != MSBOT_WRONG_ROBOT;
}

static void retry_at(msbot_part *part, uint32_t now_us)
{
    part->has_retry = true;
    part->retry_us = now_us + RETRY_US;
}

static void claim(msbot_part *part, uint32_t now_us)
{
    part->claim_due = true;
    retry_at(part, now_us);
}

static void fetch(msbot_part *part, uint32_t now_us)
{
    part->fetch_due = true;
    part->reply_wanted = MSBOT_RELIABLE; /* only that stream can carry pieces */
    retry_at(part, now_us);
}

/* STOP that holds goes on holding when the part loses its robot; the rules are those of src/msbot/part/safe_state.py.
 * Whatever was agreed with a master is void, and perhaps another one serves the part from now on. */
static void change_master(msbot_part *part)
{
    if (part->stop_told == 0) {
        part->stop_ends_with = NEVER;
    }
    part->stop_heard = part->stop_over = 0;
    part->stop_is_masters = part->stop_is_asked = false;
}

static void end_stop(msbot_part *part)
{
    part->stopped = part->stop_is_masters = part->stop_is_asked = false;
    part->stop_told = part->stop_ends_with = 0;
}

/* A STOP that has a number was said in the robot that gave it. */
static void recognise(msbot_part *part)
{
    if (part->stop_told != 0 && part->robot_seen != part->robot_known && part->robot_known != 0) {
        end_stop(part);
    }
    part->robot_known = part->robot_seen;
}

/* Calls: each ends once, with its reply or a sentence. */

static void end_call(msbot_part *part, unsigned call, const uint8_t *reply, size_t size, const char *why)
{
    msbot_replied replied = part->calls[call].replied;
    part->calls[call].replied = NULL; /* first: it may call again */
    replied(part->calls[call].context, reply, size, why);
}

static void end_calls(msbot_part *part, int port, const char *why)
{
    for (unsigned i = 0; i < MSBOT_PART_CALLS; i++) {
        if (part->calls[i].replied != NULL && (port == MSBOT_ALL_PORTS || part->calls[i].port == port)) {
            end_call(part, i, NULL, 0, why);
        }
    }
}

static void beat(msbot_part *part, uint32_t now_us)
{
    uint8_t payload[6] = {0};
    put_u32(payload, part->lease);
    payload[4] = (uint8_t)part->stop_told;
    payload[5] = (uint8_t)(part->stop_told >> 8);
    /* With the number of the STOP that the part obeys the beat confirms it; a usual beat is four octets. */
    bool confirms = part->stopped && part->stop_told != 0;
    bool says = part->stopped && (part->stop_held || !(confirms || part->stop_is_asked));
    if (confirms || !says) {
        (void)msbot_xrce_write(&part->client, INVENTORY, MSBOT_BEST_EFFORT, payload, confirms ? sizeof payload : 4);
    }
    if (says) { /* with 0: the master has to take STOP up, or must not end it */
        payload[4] = payload[5] = 0;
        (void)msbot_xrce_write(&part->client, INVENTORY, MSBOT_BEST_EFFORT, payload, sizeof payload);
    }
    if (!part->waiting) {
        part->waiting = true;
        part->waiting_us = now_us;
    }
}

static void enter(msbot_part *part, msbot_part_state state, uint32_t now_us)
{
    msbot_part_state before = part->state;
    part->state = state;
    part->has_retry = part->claim_due = part->proof_due = part->fetch_due = false;
    part->to_tell = state == MSBOT_ACTIVE ? TELL_NATURE | TELL_SOFTWARE | TELL_HOME : 0;
    if (!beats(part)) {
        part->lease = part->version = 0;
        part->has_beat = part->waiting = false;
    }
    if (state == MSBOT_LOST || state == MSBOT_WRONG_ROBOT || state == MSBOT_RECOGNISING ||
        (state == MSBOT_CLAIMING && before != MSBOT_RECOGNISING)) {
        change_master(part);
    }
    if (state == MSBOT_CLAIMING) {
        recognise(part);
        part->profile_wanted = part->profile_read == MSBOT_READ_ALL ? MSBOT_READ_NO_MORE : part->profile_read;
        claim(part, now_us);
    } else if (state == MSBOT_REFUSED) {
        retry_at(part, now_us);
    } else if (state == MSBOT_CONFIGURING) {
        part->has_beat = true;
        part->beat_at_us = now_us + part->beat_us;
        /* Of what the master has heard as well the configuration says whether it holds; the rest it must be told. */
        part->stop_is_asked = part->stopped && part->stop_is_masters;
        fetch(part, now_us);
        if (part->stopped) {
            beat(part, now_us);
        }
    } else if (state == MSBOT_WRONG_ROBOT) {
        part->profile_wanted = MSBOT_READ_ALL;
    }
    if (before == MSBOT_ACTIVE && state != MSBOT_ACTIVE) {
        end_calls(part, MSBOT_ALL_PORTS, "the part is not active any more");
        part->config.safe(part->config.context, MSBOT_ALL_PORTS);
    }
    if (before != state && part->config.changed != NULL) {
        part->config.changed(part->config.context, state);
    }
}

static void agent_lost(msbot_part *part, uint32_t now_us)
{
    if (part->state != MSBOT_LOOKING && part->state != MSBOT_LOST) {
        enter(part, MSBOT_LOST, now_us);
    }
}

static void agent_found(msbot_part *part, uint32_t now_us)
{
    part->set_up = 0;
    part->has_publisher = false;
    part->profile_read = part->reply_stream = 0xFF; /* nothing is being read */
    part->profile_wanted = MSBOT_READ_ONE;
    part->reply_wanted = MSBOT_RELIABLE;
    for (unsigned port = 0; port < part->config.port_count; port++) {
        part->ports[port].step = MSBOT_UNBOUND;
        part->ports[port].want = part->ports[port].have = 0;
    }
    if (part->state == MSBOT_LOOKING || part->state == MSBOT_LOST) {
        enter(part, MSBOT_RECOGNISING, now_us);
    }
}

static void profile_seen(msbot_part *part, const uint8_t *payload, size_t size, uint32_t now_us)
{
    reader from = {payload, size, 0, false};
    const char *seen[5];
    (void)take_u32(&from); /* how often it was published */
    for (unsigned i = 0; i < 5; i++) {
        seen[i] = take_string(&from);
    }
    if (from.broken) {
        part->dropped++;
        return;
    }
    static const uint8_t places[4] = {0, 1, 2, 4}; /* name, version, serial number, (release date,) manufacturer */
    bool agrees = true;
    part->robot_seen = 1;
    for (unsigned i = 0; i < 4; i++) {
        const char *expected = part->config.robot[i];
        part->robot_seen = part->robot_seen * 31U + msbot_crc32((const uint8_t *)seen[places[i]], strlen(seen[places[i]]));
        agrees = agrees && (expected == NULL || strcmp(expected, seen[places[i]]) == 0);
    }
    if (!agrees) {
        if (part->state >= MSBOT_RECOGNISING && part->state != MSBOT_LOST && part->state != MSBOT_WRONG_ROBOT) {
            enter(part, MSBOT_WRONG_ROBOT, now_us);
        }
    } else if (part->state == MSBOT_RECOGNISING || part->state == MSBOT_WRONG_ROBOT) {
        enter(part, MSBOT_CLAIMING, now_us);
    }
}

static void verdict_given(msbot_part *part, const uint8_t *verdict, uint32_t now_us)
{
    uint32_t lease = u32(verdict);
    uint32_t period_ms = verdict[8] | (uint32_t)verdict[9] << 8;
    part->heard_us = now_us;
    if (lease == 0) {
        if (claims(part)) {
            enter(part, MSBOT_REFUSED, now_us);
        }
    } else if (claims(part) || beats(part)) {
        bool moved = part->state == MSBOT_ACTIVE && lease != part->lease;
        part->lease = lease;
        part->beat_us = 1000U * (period_ms < SHORTEST_BEAT_MS ? SHORTEST_BEAT_MS : period_ms);
        if (claims(part)) {
            enter(part, MSBOT_CONFIGURING, now_us);
        } else if (moved) {
            part->version = 0; /* two slots may have the same version */
            fetch(part, now_us);
        }
    }
}

void msbot_part_prove(const msbot_part_config *config, const uint8_t nonce[16], uint32_t session_key, uint8_t proof[16])
{
    static const char label[] = "MsBOT claim 1"; /* with its NUL */
    const char *texts[2] = {config->part_number, config->local_name};
    const uint8_t session[4] = {(uint8_t)(session_key >> 24), (uint8_t)(session_key >> 16), (uint8_t)(session_key >> 8),
                                (uint8_t)session_key};
    msbot_sha256 hash;
    uint8_t digest[32];
    msbot_hmac_begin(&hash, config->key, config->key_size);
    msbot_sha256_add(&hash, label, sizeof label);
    msbot_sha256_add(&hash, nonce, 16);
    msbot_sha256_add(&hash, config->can.uid, 8);
    for (unsigned i = 0; i < 2; i++) {
        size_t length = strlen(texts[i]);
        const uint8_t octets[2] = {(uint8_t)(length >> 8), (uint8_t)length};
        msbot_sha256_add(&hash, octets, 2);
        msbot_sha256_add(&hash, texts[i], length);
    }
    msbot_sha256_add(&hash, session, 4);
    msbot_hmac_end(&hash, config->key, config->key_size, digest);
    memcpy(proof, digest, 16);
}

static void challenged(msbot_part *part, const uint8_t *nonce, uint32_t now_us)
{
    part->heard_us = now_us;
    if (!claims(part)) {
        return;
    }
    if (part->config.key == NULL) {
        enter(part, MSBOT_REFUSED, now_us);
        return;
    }
    msbot_part_prove(&part->config, nonce, part->client.key, part->proof);
    part->proof_due = true;
    retry_at(part, now_us);
}

/* Configuration. */

static bool is_whole(const uint8_t *payload, size_t size)
{
    reader from = {payload, size, 0, false};
    (void)take_u32(&from);
    (void)take_string(&from);
    for (uint32_t left = take_u32(&from); left > 0 && !from.broken; left--) {
        (void)take_binding(&from);
    }
    for (uint32_t left = take_u32(&from); left > 0 && !from.broken; left--) {
        (void)take_string(&from);
        (void)take_string(&from);
    }
    return !from.broken;
}

static void want_binding(msbot_part *part, const binding *wanted)
{
    for (unsigned i = 0; i < part->config.port_count; i++) {
        const msbot_port_type *port = &part->config.ports[i];
        if (strcmp(port->name, wanted->port) == 0) {
            if (strcmp(port->type, wanted->type) != 0 || port->does != wanted->does) {
                part->dropped++; /* the library describes another port than the program */
                return;
            }
            uint32_t hash = msbot_crc32((const uint8_t *)wanted->topic, strlen(wanted->topic));
            part->ports[i].want = (hash & ~1U) | 2U | wanted->reliable;
            part->ports[i].topic_at = wanted->topic_at;
            part->ports[i].reliable = wanted->reliable;
            return;
        }
    }
}

/* False: no setting says that STOP holds. */
static bool tell_settings(msbot_part *part, reader *from)
{
    bool stop_holds = false;
    uint32_t told[MSBOT_PART_SETTINGS] = {0};
    uint32_t count = take_u32(from);
    for (uint32_t i = 0; i < count; i++) {
        const char *name = take_string(from);
        const char *value = take_string(from);
        uint32_t hash = msbot_crc32((const uint8_t *)name, strlen(name));
        stop_holds = stop_holds || strcmp(name, ".stop") == 0;
        hash = (hash * 31U + msbot_crc32((const uint8_t *)value, strlen(value))) | 1U;
        bool known = false;
        for (unsigned k = 0; k < MSBOT_PART_SETTINGS; k++) {
            known = known || part->told[k] == hash;
        }
        if (i < MSBOT_PART_SETTINGS) {
            told[i] = hash;
        }
        if (!known && part->config.setting != NULL) {
            part->config.setting(part->config.context, name, value);
        }
    }
    memcpy(part->told, told, sizeof told);
    return stop_holds;
}

static void use_configuration(msbot_part *part)
{
    reader from = {part->configuration, part->configuration_size, 0, false};
    for (unsigned i = 0; i < part->config.port_count; i++) {
        part->ports[i].want = 0;
    }
    (void)take_u32(&from);
    (void)take_string(&from);
    for (uint32_t left = take_u32(&from); left > 0; left--) {
        binding wanted = take_binding(&from);
        want_binding(part, &wanted);
    }
    for (unsigned i = 0; i < part->config.port_count; i++) {
        if (part->ports[i].have != 0 && part->ports[i].have != part->ports[i].want) {
            end_calls(part, (int)i, "the robot has taken its wire away");
        }
    }
    if (!tell_settings(part, &from) && part->stop_is_asked) {
        end_stop(part);
    }
}

static void configuration_received(msbot_part *part, const uint8_t *payload, size_t size, uint32_t now_us)
{
    if (!beats(part)) {
        return;
    }
    if (size > sizeof part->configuration || !is_whole(payload, size)) {
        part->dropped++;
        return;
    }
    uint32_t version = u32(payload);
    bool news = part->state == MSBOT_CONFIGURING || version != part->version;
    part->heard_us = now_us;
    part->version = version;
    part->has_retry = part->fetch_due = false;
    part->reply_wanted = MSBOT_BEST_EFFORT;
    if (news) {
        memcpy(part->configuration, payload, size);
        part->configuration_size = (uint16_t)size;
        use_configuration(part);
    }
    if (part->state == MSBOT_CONFIGURING) {
        enter(part, MSBOT_ACTIVE, now_us);
    }
}

bool msbot_part_next_setting(const msbot_part *part, size_t *at, const char **name, const char **value)
{
    reader from = {part->configuration, part->configuration_size, *at, false};
    if (*at == 0) {
        (void)take_u32(&from);
        (void)take_string(&from);
        for (uint32_t left = take_u32(&from); left > 0 && !from.broken; left--) {
            (void)take_binding(&from);
        }
        (void)take_u32(&from);
    }
    *name = take_string(&from);
    *value = take_string(&from);
    *at = from.at;
    return !from.broken;
}

bool msbot_part_tell(msbot_part *part, const uint8_t *told, size_t size)
{
    return msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, told, size);
}

/* The port of the configuration's binding with that number, or -1. */
static int port_at(const msbot_part *part, uint32_t number)
{
    reader from = {part->configuration, part->configuration_size, 0, false};
    (void)take_u32(&from);
    (void)take_string(&from);
    uint32_t count = take_u32(&from);
    for (uint32_t i = 0; i < count && i <= number; i++) {
        binding bound = take_binding(&from);
        for (unsigned port = 0; i == number && port < part->config.port_count; port++) {
            if (strcmp(part->config.ports[port].name, bound.port) == 0) {
                return (int)port;
            }
        }
    }
    return -1;
}

/* Beats, and STOP. */

static void beat_answered(msbot_part *part, uint32_t version, uint32_t now_us)
{
    if (!beats(part)) {
        return;
    }
    part->waiting = false;
    part->heard_us = now_us;
    if (version == 0) {
        enter(part, MSBOT_CLAIMING, now_us);
        return;
    }
    part->beats++;
    if (part->state == MSBOT_ACTIVE && version != part->version && !part->has_retry) {
        fetch(part, now_us);
    }
}

static void beat_missed(msbot_part *part, uint32_t now_us)
{
    part->missed_beats++;
    part->waiting = false;
    if (now_us - part->heard_us >= SILENT_BEATS * part->beat_us) {
        enter(part, MSBOT_LOST, now_us);
        /* The agent may well be there: a session whose streams are out of step looks the same from here. */
        msbot_xrce_connect(&part->client, now_us);
        return;
    }
    msbot_xrce_check(&part->client);
    beat(part, now_us);
}

/* STOP with the master's number; 0: it was said on the bus or here, without a number. */
static void stop(msbot_part *part, uint32_t number, uint32_t now_us)
{
    uint32_t before = part->stop_told;
    if (number == 0) {
        /* A master that has found the part hears what is said on its bus, and GO of its next STOP ends that one, too. */
        part->stop_is_masters = hears_master(part);
        part->stop_told = 0;
        part->stop_ends_with = part->stop_is_masters ? part->stop_heard + 1 : NEVER;
    } else if (number <= part->stop_over) {
        return; /* that STOP is long over */
    } else {
        part->stop_heard = number > part->stop_heard ? number : part->stop_heard;
        part->stop_told = part->stop_ends_with = part->stop_heard;
        part->stop_is_masters = true;
    }
    part->stop_is_asked = false;
    if (!part->stopped) {
        part->stopped = true;
        part->config.safe(part->config.context, MSBOT_ALL_PORTS);
    }
    if (part->stop_told != 0 && part->stop_told != before && beats(part)) {
        beat(part, now_us); /* the master waits for a sign that STOP has arrived */
    }
}

static void go(msbot_part *part, uint32_t number)
{
    part->stop_heard = number > part->stop_heard ? number : part->stop_heard;
    part->stop_over = number > part->stop_over ? number : part->stop_over;
    if (part->stopped && number >= part->stop_ends_with) {
        end_stop(part);
    }
    if (part->stop_held && !part->stopped) {
        msbot_part_say_stop(part, 1);
    }
}

static void notice(msbot_part *part, const uint8_t *payload, uint32_t now_us)
{
    uint32_t number = u32(payload);
    uint8_t kind = payload[6];
    if (kind == STOP) {
        stop(part, number, now_us);
    } else if (kind == GO) {
        go(part, number);
    } else if (kind == IDENTIFY && part->config.identify != NULL) {
        part->config.identify(part->config.context);
    } else if (kind == PARTNER_LOST && number == part->version && beats(part)) {
        int port = port_at(part, payload[4] | (uint32_t)payload[5] << 8);
        if (port >= 0) {
            end_calls(part, port, "the part that served it has left, or is held");
            part->config.safe(part->config.context, port);
        }
    }
}

static void reply_received(msbot_part *part, const uint8_t *payload, size_t size, uint32_t now_us)
{
    switch (size) { /* the kind of message follows from its length */
    case 4:
        beat_answered(part, u32(payload), now_us);
        break;
    case 8:
        notice(part, payload, now_us);
        break;
    case 12:
        verdict_given(part, payload, now_us);
        break;
    case 16:
        challenged(part, payload, now_us);
        break;
    case 17: /* the robot seals its samples (authentication = "key+data"), which this part cannot */
        part->heard_us = now_us;
        if (claims(part)) {
            enter(part, MSBOT_REFUSED, now_us);
        }
        break;
    default:
        configuration_received(part, payload, size, now_us);
    }
}

/* Requests and replies (src/msbot/part/calls.py): a reply begins with one octet, 0, or why there is no message. */

enum { DONE, STOPPED, FAILED = 3, NOT_SERVED = 5, REFUSED, STATUSES = 8 };
enum { IDENTITY = 24 }; /* octets before a request, and before its reply */

static void request_received(msbot_part *part, unsigned port, const uint8_t *payload, size_t size)
{
    uint8_t answer[MSBOT_PART_REQUEST];
    uint8_t *reply = answer + IDENTITY + 1;
    size_t length = 0;
    if (size < IDENTITY || part->state != MSBOT_ACTIVE) {
        part->dropped++;
        return;
    }
    memcpy(answer, payload, IDENTITY);
    answer[IDENTITY] = part->ports[port].serve == NULL ? NOT_SERVED : part->stopped ? STOPPED : DONE;
    if (answer[IDENTITY] == DONE) {
        reply[0] = 0;
        int given = part->ports[port].serve(part->ports[port].serve_context, payload + IDENTITY, size - IDENTITY, reply);
        if (given < 0) {
            answer[IDENTITY] = REFUSED;
            while (length < MSBOT_PART_SENTENCE && reply[length] != 0) {
                length++;
            }
        } else if (given > MSBOT_PART_REPLY) {
            answer[IDENTITY] = FAILED;
        } else {
            length = (size_t)given;
        }
    }
    if (!msbot_xrce_write(&part->client, endpoint_id(part, port), MSBOT_RELIABLE, answer, IDENTITY + 1 + length)) {
        part->dropped++;
    }
}

int msbot_refuse(uint8_t *reply, const char *why)
{
    size_t length = strlen(why);
    length = length < MSBOT_PART_SENTENCE ? length : MSBOT_PART_SENTENCE;
    memcpy(reply, why, length);
    reply[length] = 0;
    return -1;
}

static void reply_to_call(msbot_part *part, const uint8_t *payload, size_t size)
{
    static const char *const words[STATUSES] = {
        "", "STOP is in force: call again after GO", "the part that serves it has 8 requests already: call again later",
        "the function that serves it failed", "the part that serves it cannot read the request",
        "the program of the part has no function for it", "refused", "the robot does not pass it on"};
    char sentence[80 + MSBOT_PART_SENTENCE];
    uint16_t request = (uint16_t)(payload[0] << 8 | payload[1]);
    unsigned call = 0;
    while (call < MSBOT_PART_CALLS && (part->calls[call].replied == NULL || part->calls[call].request != request)) {
        call++;
    }
    if (call == MSBOT_PART_CALLS) {
        part->dropped++; /* late, or twice */
    } else if (size < 5 || payload[4] >= STATUSES) {
        end_call(part, call, NULL, 0, "the reply makes no sense to this version");
    } else if (payload[4] == DONE && part->stopped) {
        end_call(part, call, NULL, 0, words[STOPPED]); /* nothing that was said before STOP moves anything */
    } else if (payload[4] == DONE) {
        end_call(part, call, payload + 5, size - 5, NULL);
    } else {
        const char *why = words[payload[4]];
        size_t at = strlen(why);
        memcpy(sentence, why, at + 1);
        if (size > 5) {
            size_t more = size - 5;
            more = more > MSBOT_PART_SENTENCE ? MSBOT_PART_SENTENCE : more;
            memcpy(sentence + at, ": ", 2);
            memcpy(sentence + at + 2, payload + 5, more);
            sentence[at + 2 + more] = 0;
        }
        end_call(part, call, NULL, 0, sentence);
    }
}

static void data_received(void *context, uint16_t object_id, const uint8_t *payload, size_t size, uint32_t now_us)
{
    msbot_part *part = context;
    if (object_id == PROFILE_READER) {
        profile_seen(part, payload, size, now_us);
        return;
    }
    if (object_id == INVENTORY && size >= 4) {
        reply_received(part, payload + 4, size - 4, now_us); /* preceded by the ids of the request it answers */
        return;
    }
    for (unsigned port = 0; port < part->config.port_count; port++) {
        if (endpoint_id(part, port) != object_id || part->ports[port].want == 0) {
            continue;
        }
        if (part->config.ports[port].does == MSBOT_SERVES) {
            request_received(part, port, payload, size);
        } else if (part->config.ports[port].does == MSBOT_CALLS && size >= 4) {
            reply_to_call(part, payload, size);
        } else if (part->state == MSBOT_ACTIVE && !part->stopped) {
            part->config.received(part->config.context, port, payload, size);
        }
        return;
    }
    part->dropped++;
}

/* Sending what is due; all return false when there is no room. */

static bool book_objects(msbot_part *part)
{
    static const char *const service[5] = {"msbot_inventory", "msbot_inventory_request", "msbot_inventory_reply",
                                           "msbot_inventory_Request", "msbot_inventory_Reply"};
    msbot_xrce *client = &part->client;
    bool booked = true;
    while (booked && part->set_up < OBJECTS) {
        switch (part->set_up) {
        case 0: /* without a name: nothing reveals the part before it has recognised its robot */
            booked = msbot_xrce_create_participant(client, PARTICIPANT);
            break;
        case 1:
            booked = msbot_xrce_create_group(client, SUBSCRIBER, PARTICIPANT);
            break;
        case 2:
            booked = msbot_xrce_create_topic(client, PROFILE_TOPIC, PARTICIPANT, "msbot_masterTopic", "msbot_master");
            break;
        case 3:
            booked = msbot_xrce_create_endpoint(client, PROFILE_READER, SUBSCRIBER, PROFILE_TOPIC, true);
            break;
        default:
            booked = msbot_xrce_create_requester(client, INVENTORY, PARTICIPANT, service);
        }
        part->set_up += booked;
    }
    return booked;
}

static bool book_reads(msbot_part *part)
{
    if (part->profile_read != part->profile_wanted) {
        if (!msbot_xrce_read(&part->client, PROFILE_READER, MSBOT_RELIABLE, (msbot_read_what)part->profile_wanted)) {
            return false;
        }
        part->profile_read = part->profile_wanted;
    }
    if (part->reply_stream != part->reply_wanted) {
        if (!msbot_xrce_read(&part->client, INVENTORY, part->reply_wanted, MSBOT_READ_ALL)) {
            return false;
        }
        part->reply_stream = part->reply_wanted;
    }
    return true;
}

static bool book_port(msbot_part *part, unsigned port)
{
    msbot_xrce *client = &part->client;
    const msbot_port_type *type = &part->config.ports[port];
    uint16_t endpoint = endpoint_id(part, port);
    for (;;) {
        switch (part->ports[port].step) {
        case MSBOT_UNBOUND:
            if (part->ports[port].want == 0) {
                return true;
            }
            if (is_service(part, port)) {
                if (!msbot_xrce_create_service(client, endpoint, PARTICIPANT,
                                               (const char *)part->configuration + part->ports[port].topic_at, type->type)) {
                    return false;
                }
                part->ports[port].have = part->ports[port].want;
                part->ports[port].step = MSBOT_HAS_ENDPOINT;
                break;
            }
            if (type->does == MSBOT_PUBLISHES && !part->has_publisher) {
                if (!msbot_xrce_create_group(client, PUBLISHER, PARTICIPANT)) {
                    return false;
                }
                part->has_publisher = true;
            }
            if (!msbot_xrce_create_topic(client, topic_id(port), PARTICIPANT,
                                         (const char *)part->configuration + part->ports[port].topic_at, type->type)) {
                return false;
            }
            part->ports[port].have = part->ports[port].want;
            part->ports[port].step = MSBOT_HAS_TOPIC;
            break;
        case MSBOT_HAS_TOPIC:
            if (!msbot_xrce_create_endpoint(client, endpoint, type->does == MSBOT_PUBLISHES ? PUBLISHER : SUBSCRIBER, topic_id(port),
                                            part->ports[port].reliable)) {
                return false;
            }
            part->ports[port].step = type->does == MSBOT_PUBLISHES ? MSBOT_BOUND : MSBOT_HAS_ENDPOINT;
            break;
        case MSBOT_HAS_ENDPOINT:
            if (!msbot_xrce_read(client, endpoint, part->ports[port].reliable ? MSBOT_RELIABLE : MSBOT_BEST_EFFORT,
                                 MSBOT_READ_ALL)) {
                return false;
            }
            part->ports[port].step = MSBOT_BOUND;
            break;
        case MSBOT_BOUND:
            if (part->ports[port].have == part->ports[port].want) {
                return true;
            }
            if (!msbot_xrce_delete(client, endpoint)) {
                return false;
            }
            part->ports[port].step = is_service(part, port) ? MSBOT_UNBOUND : MSBOT_CLOSING;
            break;
        default: /* MSBOT_CLOSING */
            if (!msbot_xrce_delete(client, topic_id(port))) {
                return false;
            }
            part->ports[port].step = MSBOT_UNBOUND;
        }
    }
}

static size_t put_string(uint8_t *octets, size_t at, const char *text)
{
    size_t length = strlen(text) + 1;
    at = (at + 3) & ~(size_t)3;
    put_u32(octets + at, (uint32_t)length);
    memcpy(octets + at + 4, text, length);
    return at + 4 + length;
}

static bool send_claim(msbot_part *part)
{
    uint8_t payload[MSBOT_XRCE_MTU] = {0};
    size_t at = put_string(payload, 0, part->config.part_number);
    at = put_string(payload, at, part->config.local_name);
    memcpy(payload + at, part->config.can.uid, 8);
    at = (at + 8 + 3) & ~(size_t)3;
    put_u32(payload + at, part->nonce);
    return msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, payload, at + 4);
}

static bool tell_text(msbot_part *part, uint8_t place, const char *text)
{
    uint8_t told[5 + PIECE] = {0};
    put_u32(told, part->lease);
    told[4] = place;
    for (uint8_t *to = told + 5; to < told + sizeof told && *text != 0; to++, text++) {
        *to = (uint8_t)*text;
    }
    return msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, told, sizeof told);
}

/* What it says of itself; false when there is no room for all of it. */
static bool book_versions(msbot_part *part)
{
    uint8_t nature[5];
    put_u32(nature, part->lease);
    nature[4] = part->config.nature;
    if ((part->to_tell & TELL_NATURE) != 0 && nature[4] != MSBOT_NATURE_UNKNOWN &&
        !msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, nature, sizeof nature)) {
        return false;
    }
    part->to_tell &= TELL_SOFTWARE | TELL_HOME;
    if ((part->to_tell & TELL_SOFTWARE) != 0 && part->config.software != NULL &&
        !tell_text(part, SOFTWARE_PIECE, part->config.software)) {
        return false;
    }
    part->to_tell &= TELL_HOME;
    if (part->to_tell != 0 && !tell_text(part, HOME_PIECE, "C " MSBOT_VERSION)) {
        return false;
    }
    part->to_tell = 0;
    return true;
}

static bool book_requests(msbot_part *part)
{
    uint8_t request[8];
    if (part->claim_due && !send_claim(part)) {
        return false;
    }
    part->claim_due = false;
    if (part->proof_due && !msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, part->proof, 16)) {
        return false;
    }
    part->proof_due = false;
    put_u32(request, part->lease);
    put_u32(request + 4, part->version);
    if (part->fetch_due && !msbot_xrce_write(&part->client, INVENTORY, MSBOT_RELIABLE, request, 8)) {
        return false;
    }
    part->fetch_due = false;
    return book_versions(part);
}

static void book(msbot_part *part)
{
    if (part->client.state != MSBOT_XRCE_CONNECTED || part->state == MSBOT_LOOKING || part->state == MSBOT_LOST) {
        return;
    }
    bool booked = book_objects(part) && book_reads(part) && book_requests(part);
    for (unsigned port = 0; booked && port < part->config.port_count; port++) {
        booked = book_port(part, port);
    }
    if (booked && part->book_log != NULL) {
        (void)part->book_log(part->log);
    }
}

/* Frames and time. */

static void take_news(msbot_part *part, uint32_t now_us)
{
    uint8_t events = msbot_can_events(&part->link);
    if (events & MSBOT_EVENT_DOWN) {
        agent_lost(part, now_us);
        msbot_xrce_close(&part->client);
    }
    if (events & MSBOT_EVENT_UP) {
        msbot_xrce_connect(&part->client, now_us);
    }
    if (events & MSBOT_EVENT_STOP) {
        stop(part, 0, now_us);
    }
    events = msbot_xrce_events(&part->client);
    if (events & MSBOT_XRCE_LOST) {
        agent_lost(part, now_us);
    }
    if (events & MSBOT_XRCE_OPENED) {
        agent_found(part, now_us);
    }
}

static msbot_config_error fault_of(const msbot_part_config *config)
{
    static const uint8_t no_uid[8] = {0};
    bool subscribes = false;
    if (memcmp(config->can.uid, no_uid, 8) == 0) {
        return MSBOT_CONFIG_UID;
    }
    if (config->can.fd && MSBOT_CAN_DATA < 64) {
        return MSBOT_CONFIG_FD;
    }
    if (config->part_number == NULL || config->local_name == NULL ||
        strlen(config->part_number) + strlen(config->local_name) > LONGEST_NAMES) {
        return MSBOT_CONFIG_NAMES;
    }
    if (config->key != NULL && (config->key_size < 16 || config->key_size > 64)) {
        return MSBOT_CONFIG_KEY;
    }
    if (config->random == 0) {
        return MSBOT_CONFIG_RANDOM;
    }
    if (config->port_count > MSBOT_PART_PORTS) {
        return MSBOT_CONFIG_TOO_MANY_PORTS;
    }
    for (unsigned i = 0; i < config->port_count; i++) {
        const msbot_port_type *port = &config->ports[i];
        if (port->name == NULL || port->type == NULL || port->does > MSBOT_CALLS ||
            (port->does >= MSBOT_SERVES) != (strstr(port->type, " -> ") != NULL)) {
            return MSBOT_CONFIG_PORT;
        }
        for (unsigned k = 0; k < i; k++) {
            if (strcmp(port->name, config->ports[k].name) == 0) {
                return MSBOT_CONFIG_PORT;
            }
        }
        subscribes = subscribes || port->does == MSBOT_SUBSCRIBES;
    }
    return config->safe == NULL || (subscribes && config->received == NULL) ? MSBOT_CONFIG_FUNCTIONS : MSBOT_CONFIG_OK;
}

const char *msbot_config_words(msbot_config_error error)
{
    static const char *const words[] = {
        "all is well", "can.uid is all zero", "can.fd needs MSBOT_CAN_DATA 64",
        "part_number and local_name: one is missing, or together they are too long for MSBOT_XRCE_MTU",
        "key_size must be 16 to 64", "random must not be 0", "port_count is more than MSBOT_PART_PORTS",
        "ports: one has no name, no type or a wrong one, or two have the same name",
        "safe is missing, or received although a port subscribes"};
    return (unsigned)error < sizeof words / sizeof words[0] ? words[error] : "an unknown error";
}

msbot_config_error msbot_part_init(msbot_part *part, const msbot_part_config *config)
{
    msbot_config_error fault = fault_of(config);
    memset(part, 0, sizeof *part);
    if (fault != MSBOT_CONFIG_OK) {
        return fault;
    }
    part->config = *config;
    part->config.can.seed ^= config->random;
    part->random = config->random;
    msbot_can_init(&part->link, &part->config.can);
    msbot_xrce_init(&part->client, draw(part));
    part->nonce = draw(part);
    part->client.on_data = data_received;
    part->client.context = part;
    part->config.safe(part->config.context, MSBOT_ALL_PORTS);
    return MSBOT_CONFIG_OK;
}

void msbot_part_start(msbot_part *part) { msbot_can_start(&part->link); }

void msbot_part_stop(msbot_part *part, uint32_t now_us)
{
    msbot_can_stop(&part->link);
    take_news(part, now_us);
}

void msbot_part_receive(msbot_part *part, const msbot_frame *frame, uint32_t now_us)
{
    uint8_t packet[MSBOT_CAN_MTU + 1];
    msbot_can_receive(&part->link, frame, now_us);
    size_t size = msbot_can_read(&part->link, packet, sizeof packet);
    if (size > 0) {
        msbot_xrce_receive(&part->client, packet, size, now_us);
    }
    take_news(part, now_us);
}

void msbot_part_tick(msbot_part *part, uint32_t now_us)
{
    msbot_can_tick(&part->link, now_us);
    msbot_xrce_tick(&part->client, now_us);
    take_news(part, now_us);
    if (part->has_retry && is_due(part->retry_us, now_us)) {
        if (claims(part)) {
            claim(part, now_us);
        } else {
            fetch(part, now_us);
        }
    }
    for (unsigned i = 0; i < MSBOT_PART_CALLS; i++) {
        if (part->calls[i].replied != NULL && is_due(part->calls[i].until_us, now_us)) {
            end_call(part, i, NULL, 0, "no reply in time: is the part there that serves it?");
        }
    }
    if (part->waiting && is_due(part->waiting_us + ANSWER_US, now_us)) {
        beat_missed(part, now_us);
    }
    if (part->has_beat && is_due(part->beat_at_us, now_us)) {
        part->beat_at_us += part->beat_us;
        if (is_due(part->beat_at_us, now_us)) {
            part->beat_at_us = now_us + part->beat_us;
        }
        beat(part, now_us);
    }
}

static void sooner(bool *any, uint32_t *at, uint32_t due_us)
{
    if (!*any || (int32_t)(due_us - *at) < 0) {
        *at = due_us;
    }
    *any = true;
}

bool msbot_part_timer(const msbot_part *part, uint32_t *at)
{
    uint32_t due_us = 0;
    bool any = msbot_can_timer(&part->link, at);
    if (msbot_xrce_timer(&part->client, &due_us)) {
        sooner(&any, at, due_us);
    }
    if (part->has_retry) {
        sooner(&any, at, part->retry_us);
    }
    if (part->has_beat) {
        sooner(&any, at, part->beat_at_us);
    }
    if (part->waiting) {
        sooner(&any, at, part->waiting_us + ANSWER_US);
    }
    for (unsigned i = 0; i < MSBOT_PART_CALLS; i++) {
        if (part->calls[i].replied != NULL) {
            sooner(&any, at, part->calls[i].until_us);
        }
    }
    return any;
}

bool msbot_part_next(msbot_part *part, unsigned pending, msbot_frame *frame, uint32_t now_us)
{
    if (part->link.node_id > 0 && !part->link.out.waiting) {
        uint8_t packet[MSBOT_XRCE_MTU];
        book(part);
        size_t size = msbot_xrce_next(&part->client, packet, now_us);
        if (size > 0) {
            (void)msbot_can_send(&part->link, packet, size);
        }
    }
    return msbot_can_next(&part->link, pending, frame);
}

void msbot_part_drained(msbot_part *part, uint32_t now_us) { msbot_can_drained(&part->link, now_us); }

bool msbot_part_is_bound(const msbot_part *part, unsigned port)
{
    return part->state == MSBOT_ACTIVE && port < part->config.port_count && part->ports[port].want != 0;
}

static bool is_open(const msbot_part *part, unsigned port)
{
    return part->ports[port].step == MSBOT_BOUND && part->ports[port].have == part->ports[port].want;
}

bool msbot_part_publish(msbot_part *part, unsigned port, const uint8_t *message, size_t size)
{
    if (!msbot_part_is_bound(part, port) || part->config.ports[port].does != MSBOT_PUBLISHES ||
        !is_open(part, port)) {
        return false;
    }
    uint8_t stream = part->ports[port].reliable ? MSBOT_RELIABLE : MSBOT_BEST_EFFORT;
    bool sent = msbot_xrce_write(&part->client, endpoint_id(part, port), stream, message, size);
    if (part->look != NULL) {
        part->look(part->ranges, port, message, size);
    }
    return sent;
}

bool msbot_part_serve(msbot_part *part, unsigned port, msbot_serve serve, void *context)
{
    if (port >= part->config.port_count || part->config.ports[port].does != MSBOT_SERVES) {
        return false;
    }
    part->ports[port].serve = serve;
    part->ports[port].serve_context = context;
    return true;
}

const char *msbot_part_call(msbot_part *part, unsigned port, const uint8_t *request, size_t size, uint32_t timeout_us,
                            msbot_replied replied, void *context, uint32_t now_us)
{
    unsigned call = 0;
    if (port >= part->config.port_count || part->config.ports[port].does != MSBOT_CALLS || replied == NULL) {
        return "it is no port that calls";
    }
    if (part->state != MSBOT_ACTIVE) {
        return "the part is not active";
    }
    if (part->ports[port].want == 0) {
        return "this robot does not use the port";
    }
    while (call < MSBOT_PART_CALLS && part->calls[call].replied != NULL) {
        call++;
    }
    if (call == MSBOT_PART_CALLS) {
        return "MSBOT_PART_CALLS calls wait for replies already: call more slowly";
    }
    /* The id that the request will get, by rule. */
    uint16_t id = (uint16_t)(0xA000U | (part->client.next & 0x1FFFU));
    if (!is_open(part, port) || !msbot_xrce_write(&part->client, endpoint_id(part, port), MSBOT_RELIABLE, request, size)) {
        return size > MSBOT_PART_REQUEST ? "the request is larger than MSBOT_PART_REQUEST"
                                         : "there is no room on the way to the robot now: call again later";
    }
    part->calls[call].replied = replied;
    part->calls[call].context = context;
    part->calls[call].until_us = now_us + (timeout_us < LONGEST_CALL_US ? timeout_us : LONGEST_CALL_US);
    part->calls[call].request = id;
    part->calls[call].port = (uint8_t)port;
    return NULL;
}

void msbot_part_say_stop(msbot_part *part, uint8_t reason)
{
    msbot_can_say_stop(&part->link, reason);
    part->link.stop_reason = reason;
    part->link.events |= MSBOT_EVENT_STOP; /* STOP applies to the part itself, too */
}

void msbot_part_hold_stop(msbot_part *part, bool pressed, uint32_t now_us)
{
    bool news = pressed != part->stop_held;
    part->stop_held = pressed;
    if (pressed && !part->stopped) {
        msbot_part_say_stop(part, 1);
        take_news(part, now_us);
    }
    if (news && part->stopped && beats(part)) {
        beat(part, now_us);
    }
}
