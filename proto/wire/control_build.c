/* SPDX-License-Identifier: Apache-2.0 */
/* The control messages that request or name items: BUILD, GET, CANCEL, PREPARED, PROGRESS. */
#include <inttypes.h>

#include "proto/wire/control_codec.h"

#include "proto/wire/bvhd.pb-c.h"
#include "proto/base/place.h"
#include "proto/wire/rows.h"

/*
 * An item in its wire format. Rows can grow, as the rows of payloads can: fields that a version does not know must be
 * 0, and fields that an older client's shorter row lacks count as 0. PROTOCOL.md has the table.
 */
struct item_row {
    uint32_t type, flags, mode;
    uint32_t quality, target, layout_flags;
    uint32_t geometry_count, geometry_size;
    uint32_t reference_count, reference_size;
    uint32_t payload_source, memfd;
    uint64_t destination, source;
    uint64_t payload_offset, payload_size;
    uint8_t driver_uuid[16], compatibility_uuid[16]; /* from here on missing in clients older than native targets */
    uint32_t variant;
    float rays_per_primitive; /* missing in clients older than this field */
    uint32_t builder, reserved; /* from here on left out of a request in which these are 0, for older daemons */
    struct key source_key; /* left out of a request without updates, for the same reason */
};

enum {
    ITEM_ROW_SHORTEST = offsetof(struct item_row, driver_uuid),
    ITEM_ROW_BUILDERLESS = offsetof(struct item_row, builder),
    ITEM_ROW_SOURCELESS = offsetof(struct item_row, source_key)
};

_Static_assert(ITEM_ROW_SHORTEST == 80 && ITEM_ROW_BUILDERLESS == 120 && ITEM_ROW_SOURCELESS == 128 &&
                   sizeof(struct item_row) == 160,
               "wire format");
_Static_assert(sizeof(struct control_item) <= 2 * ITEM_ROW_SHORTEST,
               "the plain items of a message take at most twice its bytes (control.h)");

struct build_input control_item_input(const struct control_item *item)
{
    return (struct build_input){
        .type = item->type,
        .flags = item->flags,
        .mode = item->mode,
        .destination = item->destination,
        .source = item->source,
        .source_key = item->source_key,
        .options = {.quality = (enum build_quality)item->quality,
                    .target = (enum target)item->target,
                    .layout_flags = item->layout_flags,
                    .device = item->device,
                    .rays_per_primitive = item->rays_per_primitive,
                    .builder = (enum build_builder)item->builder},
    };
}

static struct item_row item_to_row(const struct control_item *item)
{
    struct item_row row = {
        .type = item->type,
        .flags = item->flags,
        .mode = item->mode,
        .quality = item->quality,
        .target = item->target,
        .layout_flags = item->layout_flags,
        .geometry_count = item->geometry_count,
        .geometry_size = item->geometry_size,
        .reference_count = item->reference_count,
        .reference_size = item->reference_size,
        .payload_source = item->payload_source,
        .memfd = item->memfd,
        .destination = item->destination,
        .source = item->source,
        .payload_offset = item->payload_offset,
        .payload_size = item->payload_size,
        .variant = item->device.variant,
        .rays_per_primitive = item->rays_per_primitive,
        .builder = item->builder,
        .source_key = item->source_key,
    };
    memcpy(row.driver_uuid, item->device.driver_uuid, sizeof row.driver_uuid);
    memcpy(row.compatibility_uuid, item->device.compatibility_uuid, sizeof row.compatibility_uuid);
    return row;
}

static struct control_item row_to_item(const struct item_row *row)
{
    struct control_item item = {
        .type = row->type,
        .flags = row->flags,
        .mode = row->mode,
        .destination = row->destination,
        .source = row->source,
        .quality = row->quality,
        .target = row->target,
        .layout_flags = row->layout_flags,
        .geometry_count = row->geometry_count,
        .geometry_size = row->geometry_size,
        .reference_count = row->reference_count,
        .reference_size = row->reference_size,
        .payload_source = row->payload_source,
        .memfd = row->memfd,
        .payload_offset = row->payload_offset,
        .payload_size = row->payload_size,
        .device = {.variant = row->variant},
        .rays_per_primitive = row->rays_per_primitive,
        .builder = row->builder,
        .source_key = row->source_key,
    };
    memcpy(item.device.driver_uuid, row->driver_uuid, sizeof item.device.driver_uuid);
    memcpy(item.device.compatibility_uuid, row->compatibility_uuid, sizeof item.device.compatibility_uuid);
    return item;
}

static enum bvhd_status too_many(const char *where, uint64_t count, uint64_t most, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_TOO_LARGE, where, "%llu, over %llu", (unsigned long long)count,
                          (unsigned long long)most);
}

/* The rows of a request are as short as its items allow. */
static uint32_t row_size(const struct control_build *build)
{
    uint32_t size = build->item_count > 0 ? ITEM_ROW_BUILDERLESS : 0;
    for (uint32_t i = 0; i < build->item_count; i++) {
        if (!key_is_zero(&build->items[i].source_key))
            return sizeof(struct item_row);
        if (build->items[i].builder != 0)
            size = ITEM_ROW_SOURCELESS;
    }
    return size;
}

enum bvhd_status control_pack_build(const struct control_build *build, struct memory *memory, struct bytes *ret_bytes,
                                    struct bvhd_error *error)
{
    if (build->item_count > CONTROL_MAX_ITEMS)
        return too_many("build.items", build->item_count, CONTROL_MAX_ITEMS, error);
    if (build->memfd_count > CONTROL_MAX_MEMFDS)
        return too_many("build.memfds", build->memfd_count, CONTROL_MAX_MEMFDS, error);
    const uint32_t size = row_size(build);
    unsigned char *rows = memory_array(memory, build->item_count, size);
    if (build->item_count > 0 && !rows)
        return bvhd_error_no_memory(error, "build.items", "%u items", build->item_count);
    for (uint32_t i = 0; i < build->item_count; i++) {
        const struct item_row row = item_to_row(&build->items[i]);
        memcpy(rows + (uint64_t)i * size, &row, size);
    }
    Bvhd__Build message;
    bvhd__build__init(&message);
    message.priority = build->priority;
    message.deadline_ms = build->deadline_ms;
    message.n_memfd_sizes = build->memfd_count;
    message.memfd_sizes = control_constant(build->memfd_sizes);
    message.item_size = size;
    message.items = (ProtobufCBinaryData){(size_t)build->item_count * size, rows};
    enum bvhd_status status = control_encode(&message.base, memory, ret_bytes, error);
    memory_free(memory, rows);
    return status;
}

static enum bvhd_status check_rest(const unsigned char *row, uint32_t size, uint32_t item, struct bvhd_error *error)
{
    unsigned char unknown = 0;
    for (uint32_t at = offsetof(struct item_row, reserved); at < size && at < ITEM_ROW_SOURCELESS; at++)
        unknown |= row[at];
    for (uint32_t at = sizeof(struct item_row); at < size; at++)
        unknown |= row[at];
    if (unknown != 0)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, place("infos[%u]", item).text, "fields of a newer version");
    return BVHD_OK;
}

static enum bvhd_status check_items(const Bvhd__Build *message, struct bvhd_error *error)
{
    uint32_t size = message->item_size;
    if (size < ITEM_ROW_SHORTEST || message->items.len % size != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "build.items", "%zu bytes in rows of %u", message->items.len, size);
    if (size > ROWS_MAX_SIZE)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "build.items", "rows of %u bytes", size);
    uint64_t count = message->items.len / size;
    if (count > CONTROL_MAX_ITEMS)
        return too_many("build.items", count, CONTROL_MAX_ITEMS, error);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++)
        status = check_rest(message->items.data + (uint64_t)i * size, size, i, error);
    return status;
}

static enum bvhd_status check_build(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Build *message = from;
    if (message->n_memfd_sizes > CONTROL_MAX_MEMFDS)
        return too_many("build.memfds", message->n_memfd_sizes, CONTROL_MAX_MEMFDS, error);
    enum bvhd_status status = message->items.len > 0 ? check_items(message, error) : BVHD_OK;
    if (status == BVHD_OK)
        *ret_extra = message->items.len > 0 ? message->items.len / message->item_size * sizeof(struct control_item) : 0;
    return status;
}

static void fill_build(const void *from, void *ret_plain)
{
    const Bvhd__Build *message = from;
    struct control_build *build = ret_plain;
    build->priority = message->priority;
    build->deadline_ms = message->deadline_ms;
    build->memfd_count = (uint32_t)message->n_memfd_sizes;
    for (uint32_t i = 0; i < build->memfd_count; i++)
        build->memfd_sizes[i] = message->memfd_sizes[i];
    build->items = (struct control_item *)(build + 1);
    if (message->items.len == 0)
        return;
    build->item_count = (uint32_t)(message->items.len / message->item_size);
    uint32_t known = message->item_size < sizeof(struct item_row) ? message->item_size : sizeof(struct item_row);
    for (uint32_t i = 0; i < build->item_count; i++) {
        struct item_row row = {0};
        memcpy(&row, message->items.data + (uint64_t)i * message->item_size, known);
        build->items[i] = row_to_item(&row);
    }
}

static const struct control_kind build_kind = {"build", &bvhd__build__descriptor, sizeof(struct control_build),
                                               check_build, fill_build};
CONTROL_UNPACK(build, struct control_build)

_Static_assert(sizeof(struct key) == KEY_SIZE, "keys lie end to end");

enum bvhd_status control_pack_get(const struct control_get *get, struct memory *memory, struct bytes *ret_bytes,
                                  struct bvhd_error *error)
{
    if (get->key_count > CONTROL_MAX_ITEMS)
        return too_many("get.keys", get->key_count, CONTROL_MAX_ITEMS, error);
    Bvhd__Get message;
    bvhd__get__init(&message);
    message.keys = (ProtobufCBinaryData){get->key_count * sizeof *get->keys, (uint8_t *)get->keys};
    return control_encode(&message.base, memory, ret_bytes, error);
}

static enum bvhd_status check_get(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Get *message = from;
    if (message->keys.len % KEY_SIZE != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "get.keys", "%zu bytes", message->keys.len);
    if (message->keys.len / KEY_SIZE > CONTROL_MAX_ITEMS)
        return too_many("get.keys", message->keys.len / KEY_SIZE, CONTROL_MAX_ITEMS, error);
    *ret_extra = message->keys.len;
    return BVHD_OK;
}

static void fill_get(const void *from, void *ret_plain)
{
    const Bvhd__Get *message = from;
    struct control_get *get = ret_plain;
    get->key_count = (uint32_t)(message->keys.len / KEY_SIZE);
    get->keys = (struct key *)(get + 1);
    if (get->key_count > 0)
        memcpy(get->keys, message->keys.data, message->keys.len);
}

static const struct control_kind get_kind = {"get", &bvhd__get__descriptor, sizeof(struct control_get), check_get,
                                             fill_get};
CONTROL_UNPACK(get, struct control_get)

enum bvhd_status control_pack_items(const struct control_items *items, struct memory *memory, struct bytes *ret_bytes,
                                    struct bvhd_error *error)
{
    if (items->count > CONTROL_MAX_ITEMS)
        return too_many("items", items->count, CONTROL_MAX_ITEMS, error);
    Bvhd__Items message;
    bvhd__items__init(&message);
    message.n_items = items->count;
    message.items = items->items;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static enum bvhd_status check_list(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Items *message = from;
    if (message->n_items > CONTROL_MAX_ITEMS)
        return too_many("items", message->n_items, CONTROL_MAX_ITEMS, error);
    *ret_extra = message->n_items * sizeof *message->items;
    return BVHD_OK;
}

static void fill_list(const void *from, void *ret_plain)
{
    const Bvhd__Items *message = from;
    struct control_items *items = ret_plain;
    items->count = (uint32_t)message->n_items;
    items->items = (uint32_t *)(items + 1);
    if (items->count > 0)
        memcpy(items->items, message->items, items->count * sizeof *items->items);
}

static const struct control_kind items_kind = {"items", &bvhd__items__descriptor, sizeof(struct control_items),
                                               check_list, fill_list};
CONTROL_UNPACK(items, struct control_items)

enum bvhd_status control_pack_progress(const struct control_progress *progress, struct memory *memory,
                                       struct bytes *ret_bytes, struct bvhd_error *error)
{
    if (progress->count > CONTROL_MAX_ITEMS)
        return too_many("progress.items", progress->count, CONTROL_MAX_ITEMS, error);
    Bvhd__Progress message;
    bvhd__progress__init(&message);
    message.n_items = message.n_thousandths = progress->count;
    message.items = progress->items;
    message.thousandths = progress->thousandths;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static enum bvhd_status check_progress(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Progress *message = from;
    if (message->n_items > CONTROL_MAX_ITEMS)
        return too_many("progress.items", message->n_items, CONTROL_MAX_ITEMS, error);
    if (message->n_thousandths != message->n_items)
        return bvhd_error_set(error, BVHD_CORRUPT, "progress.thousandths", "%zu numbers for %zu items",
                              message->n_thousandths, message->n_items);
    for (size_t i = 0; i < message->n_thousandths; i++)
        if (message->thousandths[i] > CONTROL_DONE)
            return bvhd_error_set(error, BVHD_CORRUPT, "progress.thousandths", "%" PRIu32 " of %d",
                                  message->thousandths[i], CONTROL_DONE);
    *ret_extra = 2 * message->n_items * sizeof *message->items;
    return BVHD_OK;
}

static void fill_progress(const void *from, void *ret_plain)
{
    const Bvhd__Progress *message = from;
    struct control_progress *progress = ret_plain;
    progress->count = (uint32_t)message->n_items;
    progress->items = (uint32_t *)(progress + 1);
    progress->thousandths = progress->items + progress->count;
    if (progress->count == 0)
        return;
    memcpy(progress->items, message->items, progress->count * sizeof *progress->items);
    memcpy(progress->thousandths, message->thousandths, progress->count * sizeof *progress->thousandths);
}

static const struct control_kind progress_kind = {"progress", &bvhd__progress__descriptor,
                                                  sizeof(struct control_progress), check_progress, fill_progress};
CONTROL_UNPACK(progress, struct control_progress)
