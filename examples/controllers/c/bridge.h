/* The messages of stepbus' bridge: a length, then as much MessagePack as a controller needs.
 *
 * A value is a pointer to its bytes, which are taken to be well-formed: they come from the bridge.
 * https://github.com/msgpack/msgpack/blob/master/spec.md */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef const unsigned char *value;

static uint64_t mp_big(value at, int bytes) {
    uint64_t n = 0;
    while (bytes--) n = n << 8 | *at++;
    return n;
}

/* Return where the content of a value starts; count: its entries (m: map, a: array) or its length
 * (s: text or binary, x: anything else). */
static value mp_open(value v, char *type, uint64_t *count) {
    unsigned char c = *v++;
    *type = 'x', *count = 0;
    if (c <= 0x7f || c >= 0xe0 || (c >= 0xc0 && c <= 0xc3)) return v;
    if (c <= 0x8f) return *type = 'm', *count = c & 15, v;
    if (c <= 0x9f) return *type = 'a', *count = c & 15, v;
    if (c <= 0xbf) return *type = 's', *count = c & 31, v;
    if (c >= 0xca && c <= 0xd3) return *count = "\4\10\1\2\4\10\1\2\4\10"[c - 0xca], v;
    if (c >= 0xd4 && c <= 0xd8) return *count = 1 + (1u << (c - 0xd4)), v;
    int ext = c >= 0xc7 && c <= 0xc9;
    int width = c >= 0xdc ? 2 << (c & 1) : 1 << (ext ? c - 0xc7 : c >= 0xd9 ? c - 0xd9 : c - 0xc4);
    *type = c >= 0xde ? 'm' : c >= 0xdc ? 'a' : ext ? 'x' : 's';
    *count = mp_big(v, width) + ext;
    return v + width;
}

/* Return the value after this one. */
static value mp_next(value v) {
    char type;
    uint64_t count;
    v = mp_open(v, &type, &count);
    if (type == 's' || type == 'x') return v + count;
    for (count *= type == 'm' ? 2 : 1; count; count--) v = mp_next(v);
    return v;
}

static uint64_t mp_size(value v) {
    char type;
    uint64_t count;
    mp_open(v, &type, &count);
    return count;
}

/* Return an entry of an array. */
static value mp_at(value v, uint64_t index) {
    char type;
    uint64_t count;
    for (v = mp_open(v, &type, &count); index; index--) v = mp_next(v);
    return v;
}

static int mp_is(value v, const char *text) {
    char type;
    uint64_t count;
    v = mp_open(v, &type, &count);
    return type == 's' && count == strlen(text) && !memcmp(v, text, count);
}

/* Return an entry of a map; NULL: no such entry, nil, or not a map. */
static value mp_get(value v, const char *key) {
    char type;
    uint64_t count;
    if (!v) return NULL;
    for (v = mp_open(v, &type, &count); type == 'm' && count; count--) {
        value entry = mp_next(v);
        if (mp_is(v, key)) return *entry == 0xc0 ? NULL : entry;
        v = mp_next(entry);
    }
    return NULL;
}

static double mp_number(value v) {
    unsigned char c = *v;
    if (c == 0xcb) {
        uint64_t bits = mp_big(v + 1, 8);
        double number;
        return memcpy(&number, &bits, 8), number;
    }
    if (c == 0xca) {
        uint32_t bits = (uint32_t)mp_big(v + 1, 4);
        float number;
        return memcpy(&number, &bits, 4), number;
    }
    if (c >= 0xcc && c <= 0xcf) return (double)mp_big(v + 1, 1 << (c - 0xcc));
    if (c >= 0xd0 && c <= 0xd3) {
        int unused = 64 - (8 << (c - 0xd0));
        return (double)((int64_t)(mp_big(v + 1, 1 << (c - 0xd0)) << unused) >> unused);
    }
    return (double)(signed char)c;
}

/* Writers: each returns where the next one continues. Maps have up to 15 entries, texts up to 31 bytes. */
static unsigned char *mp_map(unsigned char *to, int entries) {
    return *to = (unsigned char)(0x80 | entries), to + 1;
}

static unsigned char *mp_text(unsigned char *to, const char *text) {
    size_t length = strlen(text);
    *to = (unsigned char)(0xa0 | length);
    return memcpy(to + 1, text, length), to + 1 + length;
}

static unsigned char *mp_numbers(unsigned char *to, const double *numbers, int count) {
    *to++ = 0xdc, *to++ = (unsigned char)(count >> 8), *to++ = (unsigned char)count;
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], 8);
        *to++ = 0xcb;
        for (int shift = 56; shift >= 0; shift -= 8) *to++ = (unsigned char)(bits >> shift);
    }
    return to;
}

static unsigned char in[1 << 20], out[1 << 16]; /* the message received; the answer behind byte 4 */

static void fail(const char *why) {
    fprintf(stderr, "error: %s\n", why);
    exit(1);
}

/* Read so many bytes; return 0 when the run has ended. */
static int receive(void *to, size_t size) {
    for (size_t got = 0; got < size;) {
        ssize_t n = read(3, (char *)to + got, size - got);
        if (n < 0) perror("descriptor 3"), exit(1);
        if (n == 0) return 0;
        got += (size_t)n;
    }
    return 1;
}

/* Return the next message; NULL: the run has ended. */
static value next_message(void) {
    unsigned char size[4];
    if (!receive(size, 4)) return NULL;
    uint32_t length = size[0] | size[1] << 8 | size[2] << 16 | (uint32_t)size[3] << 24;
    if (length > sizeof in) fail("a message of over 1 MiB");
    return receive(in, length) ? in : NULL;
}

/* Send the answer that ends at `end`. */
static void answer(const unsigned char *end) {
    uint32_t size = (uint32_t)(end - out - 4);
    for (int i = 0; i < 4; i++) out[i] = (unsigned char)(size >> 8 * i);
    if (write(4, out, size + 4) != (ssize_t)size + 4) fail("descriptor 4 takes no answer");
}
