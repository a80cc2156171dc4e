/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_control.c - fuzzes control messages, and what a daemon does with a BUILD: it unpacks the message, reads the rows
 * of each payload, validates the input, makes the canonical copy and opens it.
 *
 * The input is a byte for the kind, two bytes for the control message's size, the message, and the bytes that contain
 * the payloads. A message that is unpacked, packed and unpacked again has to stay the same. Payloads are copied to
 * blocks of their exact size, so that a sanitizer detects a read beyond them.
 */
#include "tests/fuzz/fuzz.h"

#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/proto/messages.h"
#include "builder/input/prepare.h"
#include "proto/wire/rows.h"
#include "builder/input/validate.h"
#include "proto/base/validate_shape.h"

enum { HEAD = 3, MOST_ITEMS = 8, BUDGET = 64 << 20 };

static struct memory memory = {.limit = BUDGET, .fail_after = -1};

/* The limits of a small service, so that inputs within them are quick. */
static struct limits small_limits(void)
{
    return (struct limits){
        .max_geometries = 100, .max_instances = 1000, .max_primitives = 1000, .max_canonical_bytes = 1 << 20};
}

static void try_prepare(const struct build_input *input, uint32_t index)
{
    struct limits limits = small_limits();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct canonical canonical, view;
    struct bvhd_error error;
    if (prepare(input, index, &limits, &context, &canonical, &error) != BVHD_OK)
        return;
    enum bvhd_status status = prepare_open((struct bytes){canonical.bytes, canonical.size}, &memory, &view, &error);
    FUZZ_CHECK(status == BVHD_OK);
    prepare_finish(&view, &memory);
    prepare_finish(&canonical, &memory);
}

static void try_payload(const struct control_item *item, uint32_t index, struct bytes payload)
{
    struct build_input input = {
        .type = item->type,
        .flags = item->flags,
        .mode = item->mode,
        .destination = item->destination,
        .source = item->source,
        .options = {.quality = (enum build_quality)item->quality,
                    .target = (enum target)item->target,
                    .layout_flags = item->layout_flags,
                    .device = item->device,
                    .rays_per_primitive = item->rays_per_primitive},
    };
    struct rows_shape shape = {item->geometry_count, item->geometry_size, item->reference_count, item->reference_size,
                               NULL};
    struct limits limits = small_limits();
    struct bvhd_error error;
    if (rows_read(payload, &shape, index, &memory, &input, &error) != BVHD_OK)
        return;
    if (validate_input(&input, index, &limits, &error) == BVHD_OK)
        try_prepare(&input, index);
    rows_finish(&input, &memory);
}

static void try_build(const struct control_build *build, struct bytes bytes)
{
    for (uint32_t i = 0; i < build->item_count && i < MOST_ITEMS; i++) {
        const struct control_item *item = &build->items[i];
        if (!bytes_reach(bytes.size, item->payload_offset, 0, 0, item->payload_size))
            continue;
        unsigned char *copy = malloc(item->payload_size ? item->payload_size : 1);
        FUZZ_CHECK(copy);
        if (item->payload_size > 0)
            memcpy(copy, bytes.data + item->payload_offset, item->payload_size);
        try_payload(item, i, (struct bytes){copy, item->payload_size});
        free(copy);
    }
}

/* Packing, unpacking and packing once more must give the same bytes. */
static void try_again(const struct messages_kind *kind, const void *message)
{
    struct bytes first, second;
    struct bvhd_error error;
    void *back;
    FUZZ_CHECK(kind->pack(message, &memory, &first, &error) == BVHD_OK);
    enum bvhd_status status = kind->unpack(first, &memory, &back, &error);
    FUZZ_CHECK(status == BVHD_OK);
    FUZZ_CHECK(kind->pack(back, &memory, &second, &error) == BVHD_OK);
    FUZZ_CHECK(first.size == second.size && (first.size == 0 || memcmp(first.data, second.data, first.size) == 0));
    memory_free(&memory, back);
    messages_free(first, &memory);
    messages_free(second, &memory);
}

static const struct messages_kind *kind_of(uint8_t byte)
{
    return &messages_kinds[byte % MESSAGES_KINDS];
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    validate_micromaps = true;
    if (size < HEAD)
        return 0;
    const struct messages_kind *kind = kind_of(data[0]);
    uint64_t control_size = bytes_get16(data + 1), rest = size - HEAD;
    struct bytes control = {data + HEAD, control_size < rest ? control_size : rest};
    struct bvhd_error error;
    void *message;
    atomic_store(&memory.peak, 0);
    enum bvhd_status status = kind->unpack(control, &memory, &message, &error);
    FUZZ_CHECK(memory.peak <= CONTROL_HEAP_RATIO * control.size + CONTROL_HEAP_FIXED);
    FUZZ_CHECK(status == BVHD_OK || status == BVHD_CORRUPT || status == BVHD_TOO_LARGE || status == BVHD_UNSUPPORTED);
    if (status == BVHD_OK) {
        try_again(kind, message);
        if (kind->member == offsetof(struct messages, build))
            try_build(message, (struct bytes){data + HEAD + control.size, rest - control.size});
        memory_free(&memory, message);
    }
    FUZZ_CHECK(memory.live == 0);
    return 0;
}

/* Makes a BUILD of all of `inputs`, with their payloads one after another. */
static size_t build_sample(uint8_t kind, const struct build_input *const *inputs, uint32_t count, uint8_t *ret_bytes)
{
    static unsigned char payloads[FUZZ_ROOM];
    struct control_item items[16] = {0};
    struct control_build build = {.item_count = count, .items = items};
    uint64_t end = 0, size;
    for (uint32_t i = 0; i < count; i++) {
        FUZZ_CHECK(rows_payload_size(inputs[i], &size) && end + size <= sizeof payloads);
        rows_write(inputs[i], payloads + end);
        items[i] = (struct control_item){.type = inputs[i]->type, .flags = inputs[i]->flags, .target = TARGET_PORTABLE};
        items[i].geometry_count = inputs[i]->geometry_count;
        items[i].geometry_size = rows_geometry_size(inputs[i]);
        items[i].reference_count = inputs[i]->reference_count;
        items[i].reference_size = ROWS_REFERENCE_SIZE;
        items[i].payload_offset = end;
        items[i].payload_size = size;
        end += size;
    }
    struct bytes control;
    FUZZ_CHECK(control_pack_build(&build, &memory, &control, NULL) == BVHD_OK &&
               HEAD + control.size + end <= FUZZ_ROOM);
    uint16_t control_size = (uint16_t)control.size;
    ret_bytes[0] = kind;
    memcpy(ret_bytes + 1, &control_size, sizeof control_size);
    memcpy(ret_bytes + HEAD, control.data, control.size);
    memcpy(ret_bytes + HEAD + control.size, payloads, end);
    size = HEAD + control.size + end;
    messages_free(control, &memory);
    return size;
}

static size_t message_sample(uint8_t kind, uint8_t *ret_bytes)
{
    struct bytes control = messages_sample(kind_of(kind), &memory);
    uint16_t size = (uint16_t)control.size;
    ret_bytes[0] = kind;
    memcpy(ret_bytes + 1, &size, sizeof size);
    memcpy(ret_bytes + HEAD, control.data, control.size);
    messages_free(control, &memory);
    return HEAD + (size_t)size;
}

static uint8_t build_kind(void)
{
    uint8_t kind = 0;
    while (kind_of(kind)->member != offsetof(struct messages, build))
        kind++;
    return kind;
}

/*
 * Samples are one message of each kind, and 48 builds: four of each kind of geometry, and of triangles with micromaps,
 * and four of all. Most mutations should be of builds, because most can go wrong there.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    enum { KINDS = 11 };
    static struct test_input triangles, boxes, instances, spheres, swept_spheres, moving_triangles, moving_instances;
    static struct test_input micromap, baked, alpha_triangles, moving_alpha_triangles;
    static const struct build_input *const all[KINDS] = {&triangles.input,
                                                         &boxes.input,
                                                         &instances.input,
                                                         &spheres.input,
                                                         &swept_spheres.input,
                                                         &moving_triangles.input,
                                                         &moving_instances.input,
                                                         &micromap.input,
                                                         &baked.input,
                                                         &alpha_triangles.input,
                                                         &moving_alpha_triangles.input};
    inputs_triangles(&triangles);
    inputs_aabbs(&boxes);
    inputs_instances(&instances);
    inputs_spheres(&spheres);
    inputs_swept_spheres(&swept_spheres);
    inputs_mixed_triangles(&moving_triangles);
    inputs_motion_instances(&moving_instances);
    inputs_micromap(&micromap);
    inputs_baked_micromap(&baked);
    inputs_triangles_with_micromap(&alpha_triangles);
    inputs_motion_triangles_with_micromap(&moving_alpha_triangles);
    if (index < MESSAGES_KINDS)
        return message_sample((uint8_t)index, ret_bytes);
    index -= MESSAGES_KINDS;
    if (index >= 4 * (KINDS + 1))
        return 0;
    uint32_t which = index % (KINDS + 1);
    return which < KINDS ? build_sample(build_kind(), &all[which], 1, ret_bytes)
                         : build_sample(build_kind(), all, KINDS, ret_bytes);
}
