/* A part of a robot: both steps of plug-and-play, beats, configuration, keys, STOP and safe values, without I/O.
 *
 * Describe the part in a `msbot_part_config`, then let `msbot_controller.h` run it on a controller. It joins by itself,
 * and again whenever necessary; the functions of the configuration are called as events happen (docs/howto/stm32.md).
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef MSBOT_PART_H
#define MSBOT_PART_H

#include "msbot_can.h"
#include "msbot_xrce.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MSBOT_VERSION "0.1.0"

#ifndef MSBOT_PART_PORTS
#define MSBOT_PART_PORTS 7 /* ports of the part, at most */
#endif
#ifndef MSBOT_PART_SETTINGS
#define MSBOT_PART_SETTINGS 16 /* settings whose values the part remembers; any beyond are reported again */
#endif
#ifndef MSBOT_PART_CALLS
#define MSBOT_PART_CALLS 4 /* calls that wait for their replies */
#endif
#ifndef MSBOT_PART_CONFIGURATION
#define MSBOT_PART_CONFIGURATION MSBOT_XRCE_LARGEST /* octets of the largest configuration */
#endif

typedef enum {
    MSBOT_LOOKING,     /* no agent has answered yet */
    MSBOT_RECOGNISING, /* step 1: waits for the robot's profile */
    MSBOT_CLAIMING,    /* step 2: asks for its place */
    MSBOT_CONFIGURING, /* has a lease, waits for its configuration */
    MSBOT_ACTIVE,
    MSBOT_LOST,
    MSBOT_REFUSED,     /* the robot has refused it, with a reason; it keeps asking */
    MSBOT_WRONG_ROBOT
} msbot_part_state;

/* What a port does. */
enum { MSBOT_SUBSCRIBES, MSBOT_PUBLISHES, MSBOT_SERVES, MSBOT_CALLS };

typedef struct {
    const char *name; /* the part's own name for it, as in its type in the library */
    const char *type; /* of its messages; of requests and replies "Angle -> Text" */
    uint8_t does;     /* MSBOT_SUBSCRIBES ... */
} msbot_port_type;

/* Octets of the largest request, and of the largest reply. */
#define MSBOT_PART_REQUEST (MSBOT_XRCE_MTU - 15)
#define MSBOT_PART_REPLY (MSBOT_PART_REQUEST - 25)
/* Octets of the sentence that refuses a request, at most. */
#define MSBOT_PART_SENTENCE (MSBOT_PART_REPLY > 180 ? 180 : MSBOT_PART_REPLY - 1)

/* Serves a request: writes the reply into `reply`, which has MSBOT_PART_REPLY octets, and returns its size; or refuses,
 * `return msbot_refuse(reply, "the lid is open")`: the caller gets the sentence. */
typedef int (*msbot_serve)(void *context, const uint8_t *request, size_t size, uint8_t *reply);
int msbot_refuse(uint8_t *reply, const char *why);

/* A call has ended: with its reply and `why` NULL, or with `reply` NULL and a sentence. */
typedef void (*msbot_replied)(void *context, const uint8_t *reply, size_t size, const char *why);

#define MSBOT_ALL_PORTS (-1)

/* What is behind a part's ports; the robot shows it. */
enum { MSBOT_NATURE_UNKNOWN, MSBOT_NATURE_REAL, MSBOT_NATURE_SIMULATED };

typedef struct {
    msbot_can_config can;
    const char *part_number;
    const char *local_name;
    const char *robot[4]; /* name, version, serial number, manufacturer of the robot it is made for; NULL = any */
    const uint8_t *key;   /* 16 to 64 octets, or NULL */
    size_t key_size;
    uint8_t nature; /* MSBOT_NATURE_... */
    const char *software; /* version of the program, at most 12 octets in UTF-8; NULL: it says none */
    uint32_t random; /* not 0; drawn anew at every start: two devices with one UID must differ */
    const msbot_port_type *ports;
    unsigned port_count;
    void *context; /* passed to the functions */
    /* A message has come in at a port. */
    void (*received)(void *context, unsigned port, const uint8_t *message, size_t size);
    /* A setting has a value, or another one. `PORT.safe.FIELD` is a field of a port's safe value, `PORT.range.FIELD` has
     * the least and the greatest value of one (msbot_ranges.h). */
    void (*setting)(void *context, const char *name, const char *value);
    /* A port, or every port, is no longer controlled: go to the safe value now. Called at power-up, too. */
    void (*safe)(void *context, int port);
    void (*changed)(void *context, msbot_part_state state); /* may be NULL */
    void (*identify)(void *context);                        /* somebody asks which part this is; may be NULL */
} msbot_part_config;

/* What is wrong with a configuration. */
typedef enum {
    MSBOT_CONFIG_OK,
    MSBOT_CONFIG_UID,            /* can.uid is all zero */
    MSBOT_CONFIG_FD,             /* can.fd needs MSBOT_CAN_DATA 64 */
    MSBOT_CONFIG_NAMES,          /* part_number or local_name is missing, or both are too long for MSBOT_XRCE_MTU */
    MSBOT_CONFIG_KEY,            /* key_size is not 16 to 64 */
    MSBOT_CONFIG_RANDOM,         /* random is 0 */
    MSBOT_CONFIG_TOO_MANY_PORTS, /* port_count is more than MSBOT_PART_PORTS */
    MSBOT_CONFIG_PORT,           /* a port without name or type, one that does nothing known, or two of one name */
    MSBOT_CONFIG_FUNCTIONS       /* safe is missing, or received although a port subscribes */
} msbot_config_error;

typedef enum { MSBOT_UNBOUND, MSBOT_HAS_TOPIC, MSBOT_HAS_ENDPOINT, MSBOT_BOUND, MSBOT_CLOSING } msbot_port_step;

typedef struct {
    msbot_part_config config;
    msbot_part_state state;
    msbot_can link;
    msbot_xrce client;
    uint32_t random, nonce, lease, version, beat_us;
    uint32_t retry_us, beat_at_us, waiting_us, heard_us; /* valid while: */
    bool has_retry, has_beat, waiting;
    bool claim_due, proof_due, fetch_due, has_publisher;
    uint8_t to_tell; /* what it says of itself once it is active, bit by bit */
    uint8_t set_up; /* objects that this session has, of those that every part needs */
    uint8_t profile_read, profile_wanted, reply_stream, reply_wanted;
    uint8_t proof[16];
    struct {
        uint32_t want, have; /* hashes of bindings, 0 = none */
        uint16_t topic_at;   /* in the configuration */
        bool reliable;
        msbot_port_step step;
        msbot_serve serve;
        void *serve_context;
    } ports[MSBOT_PART_PORTS];
    struct {
        msbot_replied replied; /* NULL: free */
        void *context;
        uint32_t until_us;
        uint16_t request; /* its id */
        uint8_t port;
    } calls[MSBOT_PART_CALLS];
    uint8_t configuration[MSBOT_PART_CONFIGURATION];
    uint16_t configuration_size;
    uint32_t told[MSBOT_PART_SETTINGS];
    bool stopped; /* STOP came and GO did not: no incoming message reaches `received` */
    bool stop_is_masters; /* this master knows of that STOP */
    bool stop_is_asked;   /* the configuration that was asked for says whether it still holds */
    bool stop_held;       /* a STOP button is pressed */
    uint32_t stop_told;   /* its number; 0 = none, or it was only said on the bus or here */
    uint32_t stop_heard, stop_over, stop_ends_with;
    uint32_t robot_seen, robot_known; /* hashes of profiles: of the last one, and of the robot last joined */
    bool (*book_log)(void *log); /* of msbot_log.h, if the program has a log: sends what waits, as far as there is room */
    void *log;
    void (*look)(void *ranges, unsigned port, const uint8_t *message, size_t size); /* of msbot_ranges.h, likewise */
    void *ranges;
    uint32_t beats, missed_beats;
    uint16_t dropped; /* messages that could not be used, and replies for which there was no room */
} msbot_part;

/* What the configuration names must stay where it is. After an error the part must not be used. */
msbot_config_error msbot_part_init(msbot_part *part, const msbot_part_config *config);
const char *msbot_config_words(msbot_config_error error); /* a sentence */
void msbot_part_start(msbot_part *part); /* the controller is on the bus */
void msbot_part_stop(msbot_part *part, uint32_t now_us); /* the controller has left the bus */
void msbot_part_receive(msbot_part *part, const msbot_frame *frame, uint32_t now_us);
void msbot_part_tick(msbot_part *part, uint32_t now_us);
bool msbot_part_timer(const msbot_part *part, uint32_t *at);
/* The next frame for the controller, which already holds `pending` frames; false: none for now. */
bool msbot_part_next(msbot_part *part, unsigned pending, msbot_frame *frame, uint32_t now_us);
void msbot_part_drained(msbot_part *part, uint32_t now_us); /* all frames have left the controller */

bool msbot_part_is_bound(const msbot_part *part, unsigned port); /* the robot uses the port now */
/* Sends a message out of a port; false when the part is not active, the port not bound, or there is no room. */
bool msbot_part_publish(msbot_part *part, unsigned port, const uint8_t *message, size_t size);
/* Calls `serve` with the requests at a port, from `msbot_part_init` on; while STOP holds, none is served. False: no such
 * port, or it does not serve. */
bool msbot_part_serve(msbot_part *part, unsigned port, msbot_serve serve, void *context);
/* Sends a request out of a port. NULL: it is sent, and `replied` will be called once, within `timeout_us` (at most half
 * an hour). Otherwise a sentence that says why it is not sent. */
const char *msbot_part_call(msbot_part *part, unsigned port, const uint8_t *request, size_t size, uint32_t timeout_us,
                            msbot_replied replied, void *context, uint32_t now_us);
void msbot_part_say_stop(msbot_part *part, uint8_t reason); /* to every node on the bus, and the part itself */
/* How a STOP button stands: pressed, it says STOP, and the robot refuses GO until it is released, which is no GO. Call it
 * as often as you like. */
void msbot_part_hold_stop(msbot_part *part, bool pressed, uint32_t now_us);

/* What the configuration sets, one after the other; `at` begins with 0. False: there is no more. */
bool msbot_part_next_setting(const msbot_part *part, size_t *at, const char **name, const char **value);
/* Tells the inventory something, reliably; false when there is no room: msbot_log.c calls it. */
bool msbot_part_tell(msbot_part *part, const uint8_t *told, size_t size);
/* The answer to a challenge; the tests call it. */
void msbot_part_prove(const msbot_part_config *config, const uint8_t nonce[16], uint32_t session_key, uint8_t proof[16]);

#ifdef __cplusplus
}
#endif

#endif
