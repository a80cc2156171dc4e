/* SPDX-License-Identifier: Apache-2.0 */
#include "client/placement.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "proto/wire/frame.h"
#include "client/memfd.h"
#include "proto/wire/rows.h"

enum { WRITE_FROM = 128 * 1024 };

/* Where a payload is copied from. */
struct source {
    const struct build_input *input; /* NULL: the source is `bytes` */
    const unsigned char *bytes;
};

void placement_init(struct placement *placement, struct memory *memory, uint64_t pool_size)
{
    *placement =
        (struct placement){.memory = memory, .wanted_size = pool_size, .pool_size = pool_size, .descriptor = -1};
}

static void close_pool(struct placement *placement)
{
    if (placement->descriptor < 0)
        return;
    munmap(placement->bytes, placement->pool_size);
    close(placement->descriptor);
    arena_finish(&placement->arena);
    placement->descriptor = -1;
    placement->bytes = NULL;
}

void placement_finish(struct placement *placement)
{
    close_pool(placement);
}

bool placement_limit(struct placement *placement, uint64_t size)
{
    uint64_t allowed = placement->wanted_size < size ? placement->wanted_size : size;
    if (placement->descriptor >= 0) {
        if (placement->pool_size <= allowed)
            return true;
        if (placement->arena.taken > 0)
            return false;
        close_pool(placement);
    }
    placement->pool_size = allowed;
    return true;
}

void placement_refuse(struct placement *placement, bool is_refused)
{
    placement->is_refused = is_refused;
}

static enum bvhd_status map_pool(struct placement *placement)
{
    int descriptor;
    unsigned char *bytes;
    enum bvhd_status status = memfd_create_mapped("bvhd-pool", placement->pool_size, &descriptor, &bytes, NULL);
    if (status != BVHD_OK)
        return status;
    status = memfd_seal(descriptor, F_SEAL_SHRINK | F_SEAL_GROW, NULL);
    if (status == BVHD_OK && !arena_init(&placement->arena, placement->memory, placement->pool_size))
        status = BVHD_NO_MEMORY;
    if (status != BVHD_OK) {
        munmap(bytes, placement->pool_size);
        close(descriptor);
        return status;
    }
    placement->descriptor = descriptor;
    placement->touched = 0;
    placement->bytes = bytes;
    return BVHD_OK;
}

/* Returns whether a payload may use the pool: it fits and, if the daemon refuses the pool, also fits into a frame. */
static bool is_welcome(const struct placement *placement, uint64_t size)
{
    return size <= placement->pool_size && (!placement->is_refused || size <= FRAME_MAX_INLINE);
}

static bool take_from_pool(struct placement *placement, uint64_t size, uint64_t *ret_offset)
{
    if (!is_welcome(placement, size) || (placement->descriptor < 0 && map_pool(placement) != BVHD_OK))
        return false;
    return arena_take(&placement->arena, size, ret_offset);
}

static enum bvhd_status put(void *context, struct bytes piece)
{
    return memfd_writer_put(context, piece);
}

static enum bvhd_status stream(struct memfd_writer *writer, const struct source *source, uint64_t size)
{
    if (!source->input)
        return memfd_writer_put(writer, (struct bytes){source->bytes, size});
    enum bvhd_status status = rows_stream(source->input, writer->memory, put, writer);
    return status == BVHD_NO_MEMORY ? bvhd_error_set(writer->error, status, "memfd", "no memory for it") : status;
}

/* Writes every byte, zeros too, because the daemon takes no memfd with holes. */
static enum bvhd_status write_source(int descriptor, uint64_t offset, const struct source *source, uint64_t size,
                                     struct memory *memory, struct bvhd_error *error)
{
    struct memfd_writer writer;
    enum bvhd_status status = memfd_writer_init(&writer, descriptor, offset, memory, error);
    return status == BVHD_OK ? memfd_writer_finish(&writer, stream(&writer, source, size)) : status;
}

static enum bvhd_status make_memfd(const struct source *source, uint64_t size, struct memory *memory,
                                   int *ret_descriptor, struct bvhd_error *error)
{
    int descriptor;
    enum bvhd_status status = memfd_open("bvhd-payload", &descriptor, error);
    if (status != BVHD_OK)
        return status;
    status = write_source(descriptor, 0, source, size, memory, error);
    if (status == BVHD_OK)
        status = memfd_seal(descriptor, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL, error);
    if (status != BVHD_OK)
        close(descriptor);
    else
        *ret_descriptor = descriptor;
    return status;
}

bool placement_reserve(struct placement *placement)
{
    if (placement->memfds == PLACEMENT_MAX_MEMFDS)
        return false;
    placement->memfds++;
    return true;
}

void placement_unreserve(struct placement *placement)
{
    placement->memfds--;
}

static enum bvhd_status fill_reserved(struct memory *memory, const struct source *source, uint64_t size,
                                      struct held *ret_held, struct bvhd_error *error)
{
    int descriptor;
    enum bvhd_status status = make_memfd(source, size, memory, &descriptor, error);
    if (status == BVHD_OK)
        *ret_held = (struct held){.kind = HELD_MEMFD, .descriptor = descriptor, .size = size};
    return status;
}

enum bvhd_status placement_fill(struct memory *memory, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error)
{
    struct source source = {.input = input};
    return fill_reserved(memory, &source, size, ret_held, error);
}

/* If other memfds exist, a failure is only a temporary shortage, because they will be released. */
static enum bvhd_status take_memfd(struct placement *placement, const struct source *source, uint64_t size,
                                   struct held *ret_held, struct bvhd_error *error)
{
    if (!placement_reserve(placement))
        return BVHD_BUSY;
    enum bvhd_status status = fill_reserved(placement->memory, source, size, ret_held, error);
    if (status == BVHD_OK)
        return BVHD_OK;
    placement_unreserve(placement);
    return placement->memfds > 0 ? BVHD_BUSY : status;
}

/* Fills a place in the pool. Large payloads are written where the pool has no pages yet, and copied where it has. */
static void fill_pool(struct placement *placement, const struct build_input *input, uint64_t offset, uint64_t size)
{
    struct source source = {.input = input};
    uint64_t end = offset + size;
    bool fresh = end > placement->touched && size >= WRITE_FROM;
    if (!fresh || write_source(placement->descriptor, offset, &source, size, placement->memory, NULL) != BVHD_OK)
        rows_write(input, placement->bytes + offset);
    if (end > placement->touched)
        placement->touched = end;
}

/* A payload of up to half of the pool waits for room in it; a larger one would have to wait for too many others. */
enum bvhd_status placement_take(struct placement *placement, const struct build_input *input, uint64_t size,
                                struct held *ret_held, struct bvhd_error *error)
{
    uint64_t offset;
    if (take_from_pool(placement, size, &offset)) {
        fill_pool(placement, input, offset, size);
        *ret_held = (struct held){.kind = HELD_POOL, .descriptor = -1, .offset = offset, .size = size};
        return BVHD_OK;
    }
    bool may_wait = is_welcome(placement, size) && size <= placement->pool_size / 2;
    if (may_wait && placement->descriptor >= 0 && placement->arena.taken > 0)
        return BVHD_BUSY;
    struct source source = {.input = input};
    return take_memfd(placement, &source, size, ret_held, error);
}

const unsigned char *placement_bytes(const struct placement *placement, const struct held *held)
{
    return placement->bytes + held->offset;
}

enum bvhd_status placement_move_out(struct placement *placement, struct held *held, struct bvhd_error *error)
{
    struct source source = {.bytes = placement_bytes(placement, held)};
    struct held moved;
    enum bvhd_status status = take_memfd(placement, &source, held->size, &moved, error);
    if (status != BVHD_OK)
        return status;
    placement_release(placement, held);
    *held = moved;
    return BVHD_OK;
}

void placement_release(struct placement *placement, struct held *held)
{
    if (held->kind == HELD_POOL)
        arena_give(&placement->arena, held->offset, held->size);
    if (held->kind == HELD_MEMFD) {
        close(held->descriptor);
        placement->memfds--;
    }
    *held = (struct held){.kind = HELD_NOTHING, .descriptor = -1};
}
