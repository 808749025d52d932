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

#ifndef MSBOT_PART_PORTS
#define MSBOT_PART_PORTS 7 /* ports of the part, at most */
#endif
#ifndef MSBOT_PART_SETTINGS
#define MSBOT_PART_SETTINGS 16 /* settings whose values the part remembers; any beyond are reported again */
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

typedef struct {
    const char *name; /* the part's own name for it, as in its type in the library */
    const char *type; /* of its messages */
    bool publishes;
} msbot_port_type;

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
    uint32_t random; /* not 0; drawn anew at every start: two devices with one UID must differ */
    const msbot_port_type *ports;
    unsigned port_count;
    void *context; /* passed to the functions */
    /* A message has come in at a port. */
    void (*received)(void *context, unsigned port, const uint8_t *message, size_t size);
    /* A setting has a value, or another one. `PORT.safe.FIELD` is a field of a port's safe value. */
    void (*setting)(void *context, const char *name, const char *value);
    /* A port, or every port, is no longer controlled: go to the safe value now. Called at power-up, too. */
    void (*safe)(void *context, int port);
    void (*changed)(void *context, msbot_part_state state); /* may be NULL */
    void (*identify)(void *context);                        /* somebody asks which part this is; may be NULL */
} msbot_part_config;

typedef enum { MSBOT_UNBOUND, MSBOT_HAS_TOPIC, MSBOT_HAS_ENDPOINT, MSBOT_BOUND, MSBOT_CLOSING } msbot_port_step;

typedef struct {
    msbot_part_config config;
    msbot_part_state state;
    msbot_can link;
    msbot_xrce client;
    uint32_t random, nonce, lease, version, beat_us;
    uint32_t retry_us, beat_at_us, waiting_us, heard_us; /* valid while: */
    bool has_retry, has_beat, waiting;
    bool claim_due, proof_due, fetch_due, nature_due, has_publisher;
    uint8_t set_up; /* objects that this session has, of those that every part needs */
    uint8_t profile_read, profile_wanted, reply_stream, reply_wanted;
    uint8_t proof[16];
    struct {
        uint32_t want, have; /* hashes of bindings, 0 = none */
        uint16_t topic_at;   /* in the configuration */
        bool reliable;
        msbot_port_step step;
    } ports[MSBOT_PART_PORTS];
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
    uint32_t beats, missed_beats;
    uint16_t dropped; /* messages that could not be used */
} msbot_part;

void msbot_part_init(msbot_part *part, const msbot_part_config *config);
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
void msbot_part_say_stop(msbot_part *part, uint8_t reason); /* to every node on the bus, and the part itself */
/* How a STOP button stands: pressed, it says STOP, and the robot refuses GO until it is released, which is no GO. Call it
 * as often as you like. */
void msbot_part_hold_stop(msbot_part *part, bool pressed, uint32_t now_us);

/* The answer to a challenge; the tests call it. */
void msbot_part_prove(const msbot_part_config *config, const uint8_t nonce[16], uint32_t session_key, uint8_t proof[16]);

#endif
