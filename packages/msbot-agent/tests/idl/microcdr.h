/* The calls of Micro-CDR that generated code uses, written for these tests from the rules of classic CDR. */
#ifndef TESTS_MICROCDR_H_
#define TESTS_MICROCDR_H_

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

typedef struct ucdrBuffer {
    uint8_t* init;
    uint8_t* end;
    uint8_t* at;
    bool error;
} ucdrBuffer;

static inline void ucdr_init_buffer(ucdrBuffer* b, uint8_t* data, uint32_t size)
{
    b->init = b->at = data;
    b->end = data + size;
    b->error = false;
}

static inline bool place(ucdrBuffer* b, uint32_t size, bool writing)
{
    uint32_t padding = (uint32_t)(-(intptr_t)(b->at - b->init)) & (size - 1);
    if (b->error || (uint32_t)(b->end - b->at) < padding + size) {
        b->error = true;
        return false;
    }
    if (writing) memset(b->at, 0, padding);
    b->at += padding;
    return true;
}

#define NUMBER(NAME, TYPE)                                                                        \
    static inline bool ucdr_serialize_##NAME(ucdrBuffer* b, TYPE value)                            \
    {                                                                                              \
        if (!place(b, sizeof(TYPE), true)) return false;                                           \
        memcpy(b->at, &value, sizeof(TYPE));                                                       \
        b->at += sizeof(TYPE);                                                                     \
        return true;                                                                               \
    }                                                                                              \
    static inline bool ucdr_deserialize_##NAME(ucdrBuffer* b, TYPE* value)                         \
    {                                                                                              \
        if (!place(b, sizeof(TYPE), false)) return false;                                          \
        memcpy(value, b->at, sizeof(TYPE));                                                        \
        b->at += sizeof(TYPE);                                                                     \
        return true;                                                                               \
    }                                                                                              \
    static inline bool ucdr_serialize_array_##NAME(ucdrBuffer* b, const TYPE* values, uint32_t n)  \
    {                                                                                              \
        for (uint32_t i = 0; i < n; ++i)                                                           \
            if (!ucdr_serialize_##NAME(b, values[i])) return false;                                \
        return true;                                                                               \
    }                                                                                              \
    static inline bool ucdr_deserialize_array_##NAME(ucdrBuffer* b, TYPE* values, uint32_t n)      \
    {                                                                                              \
        for (uint32_t i = 0; i < n; ++i)                                                           \
            if (!ucdr_deserialize_##NAME(b, &values[i])) return false;                             \
        return true;                                                                               \
    }

NUMBER(uint32_t, uint32_t)

#define SEQUENCE(NAME, TYPE)                                                                       \
    static inline bool ucdr_serialize_sequence_##NAME(ucdrBuffer* b, const TYPE* values, uint32_t n)\
    {                                                                                              \
        return ucdr_serialize_uint32_t(b, n) && ucdr_serialize_array_##NAME(b, values, n);         \
    }                                                                                              \
    static inline bool ucdr_deserialize_sequence_##NAME(ucdrBuffer* b, TYPE* values, uint32_t most, uint32_t* n) \
    {                                                                                              \
        if (!ucdr_deserialize_uint32_t(b, n)) return false;                                        \
        if (*n > most) {                                                                           \
            b->error = true;                                                                       \
            return false;                                                                          \
        }                                                                                          \
        return ucdr_deserialize_array_##NAME(b, values, *n);                                       \
    }

SEQUENCE(uint32_t, uint32_t)
NUMBER(bool, bool) SEQUENCE(bool, bool)
NUMBER(uint8_t, uint8_t) SEQUENCE(uint8_t, uint8_t)
NUMBER(int8_t, int8_t) SEQUENCE(int8_t, int8_t)
NUMBER(uint16_t, uint16_t) SEQUENCE(uint16_t, uint16_t)
NUMBER(int16_t, int16_t) SEQUENCE(int16_t, int16_t)
NUMBER(int32_t, int32_t) SEQUENCE(int32_t, int32_t)
NUMBER(uint64_t, uint64_t) SEQUENCE(uint64_t, uint64_t)
NUMBER(int64_t, int64_t) SEQUENCE(int64_t, int64_t)
NUMBER(float, float) SEQUENCE(float, float)
NUMBER(double, double) SEQUENCE(double, double)

static inline bool ucdr_serialize_string(ucdrBuffer* b, const char* text)
{
    uint32_t length = (uint32_t)strlen(text) + 1;
    if (!ucdr_serialize_uint32_t(b, length) || (uint32_t)(b->end - b->at) < length) return false;
    memcpy(b->at, text, length);
    b->at += length;
    return true;
}

static inline bool ucdr_deserialize_string(ucdrBuffer* b, char* text, uint32_t capacity)
{
    uint32_t length = 0;
    if (!ucdr_deserialize_uint32_t(b, &length)) return false;
    if (length > capacity || (uint32_t)(b->end - b->at) < length) {
        b->error = true;
        return false;
    }
    memcpy(text, b->at, length);
    b->at += length;
    return true;
}

#endif
