/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_protocol.c - tests PROTOCOL.md against the code: the bytes of its examples are those that are sent, and its
 * numbers are those of the headers.
 */
#include "tests/support/unit.h"

#include <ctype.h>

#include "proto/wire/control.h"
#include "proto/wire/frame.h"
#include "proto/wire/rows.h"

enum { MOST = 4096 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static char *text; /* the text of PROTOCOL.md */

static int load(void **state)
{
    (void)state;
    const char *path = getenv("BVHD_PROTOCOL");
    FILE *file = path ? fopen(path, "rb") : NULL;
    if (!file)
        return -1;
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    text = calloc(1, (size_t)size + 1);
    size_t got = fread(text, 1, (size_t)size, file);
    fclose(file);
    return got == (size_t)size ? 0 : -1;
}

static int unload(void **state)
{
    (void)state;
    free(text);
    return 0;
}

static void contain(const char *line)
{
    if (!strstr(text, line))
        fail_msg("not in PROTOCOL.md: %s", line);
}

static int nibble(char digit)
{
    return isdigit((unsigned char)digit) ? digit - '0' : digit - 'a' + 10;
}

/*
 * Reads the bytes of the lines "    00 01 fe  comment" that follow `title`, up to the first line that is not indented.
 */
static size_t example(const char *title, unsigned char ret_bytes[MOST])
{
    size_t count = 0;
    const char *at = strstr(text, title);
    if (!at)
        fail_msg("no example: %s", title);
    while (at && strncmp(at, "\n    ", 5) != 0)
        at = strchr(at + 1, '\n');
    for (; at && strncmp(at, "\n    ", 5) == 0; at = strchr(at + 1, '\n'))
        for (const char *pair = at + 5;
             isxdigit((unsigned char)pair[0]) && isxdigit((unsigned char)pair[1]) && pair[2] == ' '; pair += 3) {
            assert_true(count < MOST);
            ret_bytes[count++] = (unsigned char)(nibble(pair[0]) << 4 | nibble(pair[1]));
        }
    return count;
}

/* Makes a frame in its wire format; returns its size. */
static size_t make_frame(enum frame_type type, uint64_t request, struct bytes control, struct bytes inline_bytes,
                         unsigned char ret_bytes[MOST])
{
    struct frame_header header = {.type = (uint16_t)type,
                                  .control_size = (uint32_t)control.size,
                                  .inline_size = (uint32_t)inline_bytes.size,
                                  .request = request};
    frame_header_write(&header, ret_bytes);
    memcpy(ret_bytes + FRAME_HEADER_SIZE, control.data, control.size);
    if (inline_bytes.size > 0)
        memcpy(ret_bytes + FRAME_HEADER_SIZE + control.size, inline_bytes.data, inline_bytes.size);
    return FRAME_HEADER_SIZE + control.size + inline_bytes.size;
}

static void compare(const char *title, const unsigned char *bytes, size_t size)
{
    unsigned char written[MOST];
    size_t count = example(title, written);
    for (size_t i = 0; i < size || i < count; i++)
        if (i >= size || i >= count || written[i] != bytes[i])
            fail_msg("%s: %zu bytes are written, %zu are sent, byte %zu is the first that differs: %02x is sent", title,
                     count, size, i, i < size ? bytes[i] : 0);
}

static void the_hello_is_what_is_sent(void **state)
{
    (void)state;
    struct control_hello hello = {CONTROL_VERSION, CONTROL_VERSION, "demo 1", 0, false};
    struct bytes control;
    unsigned char frame[MOST];
    assert_int_equal(control_pack_hello(&hello, &memory, &control, NULL), BVHD_OK);
    compare("### HELLO, in bytes", frame, make_frame(FRAME_HELLO, 0, control, (struct bytes){NULL, 0}, frame));
    memory_free(&memory, (void *)(uintptr_t)control.data);
}

static void the_build_is_what_is_sent(void **state)
{
    (void)state;
    static const float vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 2,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)vertices, sizeof vertices}},
        .range = {.primitive_count = 1},
    };
    struct build_input input = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry};
    unsigned char payload[MOST], frame[MOST];
    uint64_t size;
    assert_true(rows_payload_size(&input, &size) && size <= sizeof payload);
    rows_write(&input, payload);
    struct control_item item = {.type = STRUCTURE_BOTTOM,
                                .target = TARGET_PORTABLE,
                                .geometry_count = 1,
                                .geometry_size = ROWS_GEOMETRY_LEAST,
                                .payload_source = SOURCE_INLINE,
                                .payload_size = size};
    struct control_build build = {.priority = PRIORITY_HIGH, .item_count = 1, .items = &item};
    struct bytes control;
    assert_int_equal(control_pack_build(&build, &memory, &control, NULL), BVHD_OK);
    compare("### BUILD, in bytes", frame, make_frame(FRAME_BUILD, 1, control, (struct bytes){payload, size}, frame));
    memory_free(&memory, (void *)(uintptr_t)control.data);
    assert_int_equal(memory.live, 0);
}

static void numbers_are_those_of_the_headers(void **state)
{
    (void)state;
    static const struct {
        int number;
        const char *name;
    } types[] = {{FRAME_HELLO, "HELLO"},
                 {FRAME_POOL, "POOL"},
                 {FRAME_BUILD, "BUILD"},
                 {FRAME_GET, "GET"},
                 {FRAME_CANCEL, "CANCEL"},
                 {FRAME_STATS, "STATS"},
                 {FRAME_PING, "PING"},
                 {FRAME_WELCOME, "WELCOME"},
                 {FRAME_DONE, "DONE"},
                 {FRAME_ERROR, "ERROR"},
                 {FRAME_BUSY, "BUSY"},
                 {FRAME_PREPARED, "PREPARED"},
                 {FRAME_RESULT, "RESULT"},
                 {FRAME_COUNTERS, "COUNTERS"},
                 {FRAME_PONG, "PONG"},
                 {FRAME_GOODBYE, "GOODBYE"},
                 {FRAME_PROGRESS, "PROGRESS"},
                 {FRAME_CLIENTS, "CLIENTS"},
                 {FRAME_CLIENT_LIST, "CLIENT_LIST"},
                 {FRAME_RELEASED, "RELEASED"},
                 {FRAME_CACHE, "CACHE"},
                 {FRAME_CACHE_STATE, "CACHE_STATE"}};
    char line[100];
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        snprintf(line, sizeof line, "\n| %d | %s |", types[i].number, types[i].name);
        contain(line);
    }
    for (int status = 0; status < BVHD_STATUS_COUNT; status++) {
        snprintf(line, sizeof line, "\n| %d | %s |", status, bvhd_status_name((enum bvhd_status)status));
        if (status != BVHD_PENDING) /* is never sent */
            contain(line);
    }
    snprintf(line, sizeof line, "%d bytes of control message", FRAME_MAX_CONTROL);
    contain(line);
    snprintf(line, sizeof line, "%d inline bytes", FRAME_MAX_INLINE);
    contain(line);
    snprintf(line, sizeof line, "%d descriptors", FRAME_MAX_DESCRIPTORS);
    contain(line);
    snprintf(line, sizeof line, "at most %d items", CONTROL_MAX_ITEMS);
    contain(line);
}

/* Expects a row in a table of fields: "| 40 | 8 | `stride`"... */
static void field(size_t offset, size_t size, const char *name)
{
    char line[100];
    snprintf(line, sizeof line, "\n| %zu | %zu | `%s`", offset, size, name);
    contain(line);
}

#define FIELD(type, member) field(offsetof(struct type, member), sizeof((struct type){0}.member), #member)

static void tables_are_the_structs(void **state)
{
    (void)state;
    FIELD(geometry_row, type);
    FIELD(geometry_row, flags);
    FIELD(geometry_row, primitive_count);
    FIELD(geometry_row, primitive_offset);
    FIELD(geometry_row, first_vertex);
    FIELD(geometry_row, transform_offset);
    FIELD(geometry_row, vertex_format);
    FIELD(geometry_row, max_vertex);
    FIELD(geometry_row, index_type);
    FIELD(geometry_row, reserved);
    FIELD(geometry_row, stride);
    FIELD(geometry_row, data);
    FIELD(geometry_row, indices);
    FIELD(geometry_row, transform);
    FIELD(geometry_row, radius_format);
    FIELD(geometry_row, indexing_mode);
    FIELD(geometry_row, end_caps_mode);
    FIELD(geometry_row, reserved_round);
    FIELD(geometry_row, index_stride);
    FIELD(geometry_row, radius_stride);
    FIELD(geometry_row, radii);
    FIELD(geometry_row, end_positions);
    FIELD(geometry_row, has_micromap);
    FIELD(geometry_row, has_usages);
    FIELD(geometry_row, micromap_index_type);
    FIELD(geometry_row, base_triangle);
    FIELD(geometry_row, micromap);
    FIELD(geometry_row, micromap_stride);
    FIELD(geometry_row, usages);
    FIELD(geometry_row, micromap_indices);
    FIELD(geometry_row, micromap_triangles);
    FIELD(geometry_row, alpha_width);
    FIELD(geometry_row, alpha_height);
    FIELD(geometry_row, wrap_u);
    FIELD(geometry_row, wrap_v);
    FIELD(geometry_row, is_nearest);
    FIELD(geometry_row, bake_mode);
    FIELD(geometry_row, micromap_format);
    FIELD(geometry_row, micromap_level);
    FIELD(geometry_row, alpha_cutoff);
    FIELD(geometry_row, vertex_count);
    FIELD(geometry_row, coordinate_stride);
    FIELD(geometry_row, coordinates);
    FIELD(reference_row, handle);
    FIELD(reference_row, kind);
    FIELD(reference_row, has_key);
    FIELD(reference_row, key);
    FIELD(reference_row, bounds);
    FIELD(reference_row, moves);
    FIELD(reference_row, reserved);
    FIELD(reference_row, slabs);
}

/*
 * Item rows have no struct outside of the codec. Therefore each field gets a unique value, which is expected at its
 * place.
 */
static void item_rows_are_the_table(void **state)
{
    (void)state;
    struct control_item item = {
        .type = 1, .flags = 2, .mode = 3, .quality = 4, .target = 5, .layout_flags = 6, .geometry_count = 7};
    item.geometry_size = 8;
    item.reference_count = 9;
    item.reference_size = 10;
    item.payload_source = 11;
    item.memfd = 12;
    item.destination = 13;
    item.source = 14;
    item.payload_offset = 15;
    item.payload_size = 16;
    memset(item.device.driver_uuid, 17, sizeof item.device.driver_uuid);
    memset(item.device.compatibility_uuid, 18, sizeof item.device.compatibility_uuid);
    item.device.variant = 19;
    item.rays_per_primitive = 0.25f;
    static const char *const names[] = {
        "type",           "flags",          "mode",          "quality",         "target",
        "layout_flags",   "geometry_count", "geometry_size", "reference_count", "reference_size",
        "payload_source", "memfd",          "destination",   "source",          "payload_offset",
        "payload_size"};
    struct control_build build = {.item_count = 1, .items = &item};
    struct bytes control;
    assert_int_equal(control_pack_build(&build, &memory, &control, NULL), BVHD_OK);
    assert_int_equal(control.size, 4 + 120);
    for (size_t i = 0, offset = 0; i < 16; i++) {
        size_t size = i < 12 ? 4 : 8;
        field(offset, size, names[i]);
        const unsigned char *at = control.data + 4 + offset;
        assert_int_equal(size == 4 ? bytes_get32(at) : bytes_get64(at), i + 1);
        offset += size;
    }
    field(80, 16, "driver_uuid");
    field(96, 16, "compatibility_uuid");
    field(112, 4, "variant");
    field(116, 4, "rays_per_primitive");
    float rays;
    memcpy(&rays, control.data + 4 + 116, sizeof rays);
    assert_true(rays == 0.25f);
    for (int i = 0; i < 36; i++)
        assert_int_equal(control.data[4 + 80 + i], i < 16 ? 17 : i < 32 ? 18 : i == 32 ? 19 : 0);
    memory_free(&memory, (void *)(uintptr_t)control.data);
    item.builder = 20;
    assert_int_equal(control_pack_build(&build, &memory, &control, NULL), BVHD_OK);
    assert_int_equal(control.size, 6 + 128); /* each of the two sizes takes a byte more */
    field(120, 4, "builder");
    field(124, 4, "reserved");
    assert_int_equal(bytes_get32(control.data + 6 + 120), 20);
    assert_int_equal(bytes_get32(control.data + 6 + 124), 0);
    memory_free(&memory, (void *)(uintptr_t)control.data);
    memset(&item.source_key, 21, sizeof item.source_key);
    assert_int_equal(control_pack_build(&build, &memory, &control, NULL), BVHD_OK);
    assert_int_equal(control.size, 6 + 160);
    field(128, 32, "source_key");
    assert_memory_equal(control.data + 6 + 128, &item.source_key, sizeof item.source_key);
    memory_free(&memory, (void *)(uintptr_t)control.data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_hello_is_what_is_sent),        cmocka_unit_test(the_build_is_what_is_sent),
        cmocka_unit_test(numbers_are_those_of_the_headers), cmocka_unit_test(tables_are_the_structs),
        cmocka_unit_test(item_rows_are_the_table),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
