/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_refit.c - fuzzes updates: a structure and its record from untrusted bytes are refused with a place, or updated
 * with trusted geometry, of the same shape or of another one.
 *
 * The input is a byte for the kind of the geometry, a byte of choices (bit 0: the record is that of the kind, rather
 * than the one in the input; bit 1: sizes are repaired), two bytes for the record's size, the record, and the
 * structure. An update that succeeds is made three times: with the output's bytes all 0 before, all 0xff before, and
 * from its own result. All three must give the same bytes.
 */
#include "tests/fuzz/fuzz.h"

#include <math.h>

#include "builder/format/portable.h"
#include "builder/input/prepare.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"
#include "tests/fuzz/repair.h"
#include "tests/support/builder/inputs.h"

enum { HEAD = 4, CHOICE_RECORD = 1, CHOICE_REPAIR = 2, BUDGET = 64 << 20 };
enum { SIDE = 6, GRID_VERTICES = SIDE * SIDE, GRID_TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

enum shape {
    TRIANGLES,
    GRID,
    BOXES,
    INSTANCES,
    SPHERES,
    SWEPT_SPHERES,
    EMPTY,
    MOVING_TRIANGLES,
    MIXED_TRIANGLES,
    MOVING_GRID,
    MOVING_INSTANCES
};

static const struct {
    enum shape shape;
    enum target target;
    uint32_t layout_flags, variant;
} kinds[] = {
    {TRIANGLES, TARGET_PORTABLE, 0, 0},
    {TRIANGLES, TARGET_PORTABLE, PORTABLE_FAST_TRIANGLES, 0},
    {GRID, TARGET_PORTABLE, 0, 0},
    {BOXES, TARGET_PORTABLE, 0, 0},
    {INSTANCES, TARGET_PORTABLE, 0, 0},
    {EMPTY, TARGET_PORTABLE, 0, 0},
    {TRIANGLES, TARGET_LAVAPIPE, 0, LAVAPIPE_PLAIN},
    {TRIANGLES, TARGET_LAVAPIPE, 0, LAVAPIPE_COMPACTED},
    {GRID, TARGET_LAVAPIPE, 0, LAVAPIPE_COMPACTED},
    {BOXES, TARGET_LAVAPIPE, 0, LAVAPIPE_PLAIN},
    {INSTANCES, TARGET_LAVAPIPE, 0, LAVAPIPE_PLAIN},
    {INSTANCES, TARGET_LAVAPIPE, 0, LAVAPIPE_COMPACTED},
    {EMPTY, TARGET_LAVAPIPE, 0, LAVAPIPE_PLAIN},
    {SPHERES, TARGET_PORTABLE, 0, 0},
    {SWEPT_SPHERES, TARGET_PORTABLE, 0, 0},
    {MOVING_TRIANGLES, TARGET_PORTABLE, 0, 0},
    {MIXED_TRIANGLES, TARGET_PORTABLE, 0, 0},
    {MOVING_GRID, TARGET_PORTABLE, 0, 0},
    {MOVING_INSTANCES, TARGET_PORTABLE, 0, 0},
};

enum { KINDS = sizeof kinds / sizeof kinds[0], INDEXED_KIND = 0, BOXES_KIND = 3, MOVING_KIND = 15 };

/* A kind's own structure and record, which are made before the first input and are kept. */
struct sound {
    struct build_options options;
    struct canonical moved; /* the geometry of updates */
    struct record record; /* of the structure below, complete */
    struct bytes blob; /* built from the geometry before it was moved */
};

static struct memory memory = {.limit = BUDGET, .fail_after = -1}, sound_memory = {.limit = BUDGET, .fail_after = -1};
static struct sound sounds[KINDS];

/* ---- sound structures ---- */

/* A request, and the data of those shapes that inputs.h does not have. */
struct request {
    struct test_input test;
    float vertices[GRID_VERTICES][3], end_vertices[GRID_VERTICES][3];
    uint16_t indices[GRID_TRIANGLES][3];
};

static void make_grid(struct request *request)
{
    inputs_triangles(&request->test);
    for (int i = 0; i < GRID_VERTICES; i++) {
        request->vertices[i][0] = (float)(i % SIDE);
        request->vertices[i][1] = (float)(i / SIDE);
        request->vertices[i][2] = (float)(i * i % 5);
        for (int k = 0; k < 3; k++)
            request->end_vertices[i][k] = request->vertices[i][k] + (float)(i * (k + 1) % 7);
    }
    for (int i = 0; i < GRID_TRIANGLES; i++) {
        const uint16_t quad = (uint16_t)(i / 2), corner = (uint16_t)(quad / (SIDE - 1) * SIDE + quad % (SIDE - 1));
        request->indices[i][0] = (uint16_t)(corner + i % 2);
        request->indices[i][1] = (uint16_t)(corner + 1 + i % 2 * SIDE);
        request->indices[i][2] = (uint16_t)(corner + SIDE);
    }
    request->test.input.geometry_count = 1;
    request->test.geometries[0] = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = GRID_VERTICES - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT16,
                      .vertices = {(const unsigned char *)request->vertices, sizeof request->vertices},
                      .indices = {(const unsigned char *)request->indices, sizeof request->indices}},
        .range = {.primitive_count = GRID_TRIANGLES},
    };
}

static void make_moving_grid(struct request *request)
{
    struct geometry *grid = &request->test.geometries[0];
    make_grid(request);
    request->test.input.flags = BUILD_MOTION;
    grid->type = GEOMETRY_MOVING_TRIANGLES;
    grid->triangles.end_vertices =
        (struct bytes){(const unsigned char *)request->end_vertices, sizeof request->end_vertices};
}

static void make_shape(enum shape shape, struct request *request)
{
    static void (*const makers[])(struct test_input * test) = {
        [TRIANGLES] = inputs_triangles,
        [BOXES] = inputs_aabbs,
        [INSTANCES] = inputs_instances,
        [SPHERES] = inputs_spheres,
        [SWEPT_SPHERES] = inputs_swept_spheres,
        [EMPTY] = inputs_triangles,
        [MOVING_TRIANGLES] = inputs_motion_triangles,
        [MIXED_TRIANGLES] = inputs_mixed_triangles,
        [MOVING_INSTANCES] = inputs_motion_instances,
    };
    if (shape == GRID)
        make_grid(request);
    else if (shape == MOVING_GRID)
        make_moving_grid(request);
    else
        makers[shape](&request->test);
}

static void make_request(uint32_t kind, struct request *request)
{
    const enum shape shape = kinds[kind].shape;
    make_shape(shape, request);
    struct build_input *input = &request->test.input;
    input->geometry_count = shape == EMPTY ? 0 : input->geometry_count;
    input->flags |= BUILD_ALLOW_UPDATE;
    input->options = (struct build_options){.quality = QUALITY_BALANCED,
                                            .target = kinds[kind].target,
                                            .layout_flags = kinds[kind].layout_flags,
                                            .device.variant = kinds[kind].variant};
}

static void move(struct request *request)
{
    struct test_input *test = &request->test;
    for (int i = 0; i < INPUTS_VERTICES; i++) {
        test->vertices[i][i % 3] += 0.5f;
        test->end_vertices[i][(i + 1) % 3] -= 2;
    }
    for (int i = 0; i < GRID_VERTICES; i++) {
        request->vertices[i][2] *= -3;
        request->end_vertices[i][1] *= 2;
    }
    for (int i = 0; i < INPUTS_BOXES; i++)
        test->boxes[i][3] += 2;
    inputs_set_record(test, 0, 55, 0);
    inputs_set_motion_record(test, 0, MOTION_MATRIX, 55, 0);
}

static const struct build_context sound_context = {.memory = &sound_memory, .parallel = &parallel_serial};

static struct canonical make_canonical(const struct build_input *input)
{
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct bvhd_error error;
    FUZZ_CHECK(prepare(input, 0, &limits, &sound_context, &canonical, &error) == BVHD_OK);
    return canonical;
}

static void make_sound(uint32_t kind, struct sound *sound)
{
    static struct request request;
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob;
    make_request(kind, &request);
    sound->options = request.test.input.options;
    struct canonical canonical = make_canonical(&request.test.input);
    FUZZ_CHECK(record_make(&canonical, &sound->options, &sound_context, &sound->record, &error) == BVHD_OK);
    FUZZ_CHECK(build(&canonical, &sound->options, &sound_context, &blob, &stats, &error) == BVHD_OK);
    sound->blob = (struct bytes){blob, stats.sizes.total};
    FUZZ_CHECK(refit_measure(sound->blob, &stats, &sound_context, &sound->record, &error) == BVHD_OK);
    prepare_finish(&canonical, &sound_memory);
    move(&request);
    sound->moved = make_canonical(&request.test.input);
}

static const struct sound *sound_of(uint32_t kind)
{
    if (!sounds[kind].blob.data)
        make_sound(kind, &sounds[kind]);
    return &sounds[kind];
}

/* ---- updates ---- */

/* Provides blobs of their exact size, with bytes that show which of them the refit leaves as they were. */
struct output {
    struct build_output output;
    int fill;
};

static unsigned char *allocate(struct build_output *self, uint64_t size)
{
    void *bytes;
    FUZZ_CHECK(posix_memalign(&bytes, 64, size) == 0);
    memset(bytes, ((struct output *)(void *)self)->fill, size);
    return bytes;
}

static void discard(struct build_output *self, unsigned char *bytes)
{
    (void)self;
    free(bytes);
}

struct updated {
    struct record record;
    unsigned char *blob;
    uint64_t size;
};

static void finish_updated(struct updated *updated)
{
    free(updated->blob);
    record_finish(&updated->record, &memory);
}

static void check_refusal(enum bvhd_status status, const struct bvhd_error *error)
{
    FUZZ_CHECK(error->status == status && error->where[0] && error->text[0]);
}

static bool update(const struct sound *sound, const struct record *source_record, struct bytes source, int fill,
                   struct updated *ret_updated)
{
    struct output output = {{allocate, discard}, fill};
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial, .output = &output.output};
    struct updated updated = {.blob = NULL};
    struct refit_result result;
    struct build_stats stats;
    struct bvhd_error error;
    FUZZ_CHECK(record_make(&sound->moved, &sound->options, &context, &updated.record, &error) == BVHD_OK);
    enum bvhd_status status = update_rules_check(source_record, &updated.record, 0, &error);
    const bool fits = status == BVHD_OK;
    FUZZ_CHECK(fits || status == BVHD_INVALID || status == BVHD_UNSUPPORTED);
    const struct refit_request request = {source, source_record, &sound->moved, &updated.record};
    if (fits)
        status = refit(&request, &context, &updated.blob, &stats, &result, &error);
    if (status != BVHD_OK) {
        FUZZ_CHECK(!fits || status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE || status == BVHD_UNSUPPORTED);
        check_refusal(status, &error);
        finish_updated(&updated);
        return false;
    }
    FUZZ_CHECK(result.decay >= 0 && result.refits == updated.record.header->refits && result.refits > 0);
    updated.size = stats.sizes.total;
    *ret_updated = updated;
    return true;
}

static void check_same(const struct updated *a, const struct updated *b)
{
    FUZZ_CHECK(a->size == b->size && memcmp(a->blob, b->blob, a->size) == 0);
}

static void try_update(const struct sound *sound, const struct record *record, struct bytes source)
{
    struct updated first, second, third;
    if (!update(sound, record, source, 0, &first))
        return;
    FUZZ_CHECK(update(sound, record, source, 0xff, &second));
    check_same(&first, &second);
    FUZZ_CHECK(update(sound, &first.record, (struct bytes){first.blob, first.size}, 0xff, &third));
    check_same(&first, &third);
    finish_updated(&first);
    finish_updated(&second);
    finish_updated(&third);
}

/* The same bytes as the result of a build, whose tree is measured. */
static void try_measure(const struct sound *sound, struct bytes source)
{
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const struct build_stats stats = {.quality = QUALITY_FAST};
    struct record record;
    struct bvhd_error error;
    FUZZ_CHECK(record_make(&sound->moved, &sound->options, &context, &record, &error) == BVHD_OK);
    const enum bvhd_status status = refit_measure(source, &stats, &context, &record, &error);
    FUZZ_CHECK(status == BVHD_OK || status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
    if (status == BVHD_OK)
        FUZZ_CHECK(record.header->cost >= 0 && isfinite(record.header->cost));
    else
        check_refusal(status, &error);
    record_finish(&record, &memory);
}

static void try_all(uint32_t kind, uint8_t choices, struct bytes record_bytes, struct bytes source)
{
    const struct sound *sound = sound_of(kind);
    struct record record = sound->record;
    struct bvhd_error error;
    enum bvhd_status status = BVHD_OK;
    if (!(choices & CHOICE_RECORD))
        status = record_open(record_bytes, &record, &error);
    if (status == BVHD_OK)
        try_update(sound, &record, source);
    else
        check_refusal(status, &error);
    FUZZ_CHECK(status == BVHD_OK || status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
    try_measure(sound, source);
    FUZZ_CHECK(memory.live == 0);
}

/* Record and structure are in blocks of exactly their sizes. */
static void *copy_of(const uint8_t *bytes, size_t size)
{
    void *copy;
    FUZZ_CHECK(posix_memalign(&copy, 16, size ? size : 1) == 0);
    if (size > 0)
        memcpy(copy, bytes, size);
    return copy;
}

/* Makes the sizes in the headers agree with the number of bytes, so that what lies behind them is read. */
static void repair(uint32_t kind, uint8_t *blob, size_t size)
{
    const enum shape shape = kinds[kind].shape;
    const uint64_t handles = shape == INSTANCES || shape == MOVING_INSTANCES ? 3 : 0,
                   body = bytes_align(SERIALIZED_HANDLES + 8 * handles, PORTABLE_BODY_ALIGNMENT);
    if (kinds[kind].target == TARGET_LAVAPIPE) {
        repair_structure(blob, size, kinds[kind].variant);
    } else if (size >= body + sizeof(struct portable_header)) {
        bytes_put64(blob + 32, size);
        bytes_put64(blob + 40, size - body);
        bytes_put64(blob + 48, handles);
        bytes_put64(blob + body + offsetof(struct portable_header, body_size), size - body);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < HEAD)
        return 0;
    const uint32_t kind = data[0] % KINDS;
    const size_t rest = size - HEAD, wanted = bytes_get16(data + 2), record_size = wanted < rest ? wanted : rest,
                 blob_size = rest - record_size;
    void *record = copy_of(data + HEAD, record_size), *blob = copy_of(data + HEAD + record_size, blob_size);
    if (data[1] & CHOICE_REPAIR)
        repair(kind, blob, blob_size);
    try_all(kind, data[1], (struct bytes){record, record_size}, (struct bytes){blob, blob_size});
    free(record);
    free(blob);
    return 0;
}

/* Leaves the only node of a portable structure with one leaf, of the second record. */
static void skip_record(uint8_t *blob)
{
    const uint64_t body = bytes_align(SERIALIZED_HANDLES, PORTABLE_BODY_ALIGNMENT);
    struct portable_node node;
    memcpy(&node, blob + body + sizeof(struct portable_header), sizeof node);
    node.first_record = 1;
    memset(node.meta, 0, sizeof node.meta);
    node.meta[7] = 0x21;
    memcpy(blob + body + sizeof(struct portable_header), &node, sizeof node);
}

/* Takes the tree and the records of a portable structure of triangles away, and leaves its vertices. */
static void drop_tree(uint8_t *blob)
{
    const uint64_t body = bytes_align(SERIALIZED_HANDLES, PORTABLE_BODY_ALIGNMENT);
    struct portable_header header;
    memcpy(&header, blob + body, sizeof header);
    header.node_count = header.record_count = header.depth = 0;
    header.bounds[0] = 1;
    header.bounds[3] = 0;
    memcpy(blob + body, &header, sizeof header);
}

/*
 * Samples are each kind with its own record and structure: as they are, with a record that cannot be lost, and with
 * sizes that are repaired, too. In the last two, no leaf holds the first record, and there are vertices without a tree.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    static const uint8_t choices[] = {0, CHOICE_RECORD, CHOICE_RECORD | CHOICE_REPAIR};
    static const struct {
        uint32_t kind;
        void (*change)(uint8_t *blob);
    } changed[] = {{BOXES_KIND, skip_record}, {INDEXED_KIND, drop_tree}, {MOVING_KIND, drop_tree}};
    void (*change)(uint8_t * blob) = NULL;
    if (index >= sizeof choices * KINDS) {
        const size_t which = index - sizeof choices * KINDS;
        if (which >= sizeof changed / sizeof *changed)
            return 0;
        index = changed[which].kind;
        change = changed[which].change;
    }
    const struct sound *sound = sound_of(index % KINDS);
    const struct bytes record = sound->record.bytes, blob = sound->blob;
    FUZZ_CHECK(HEAD + record.size + blob.size <= FUZZ_ROOM);
    ret_bytes[0] = (uint8_t)(index % KINDS);
    ret_bytes[1] = choices[index / KINDS];
    const uint16_t record_size = (uint16_t)record.size;
    memcpy(ret_bytes + 2, &record_size, sizeof record_size);
    memcpy(ret_bytes + HEAD, record.data, record.size);
    memcpy(ret_bytes + HEAD + record.size, blob.data, blob.size);
    if (change)
        change(ret_bytes + HEAD + record.size);
    return HEAD + record.size + blob.size;
}
