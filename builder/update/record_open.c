/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "builder/format/layout.h"
#include "builder/input/canonical_form.h"
#include "builder/update/activity.h"
#include "builder/update/record_internal.h"
#include "builder/update/update_kind.h"
#include "proto/base/kind.h"

static enum bvhd_status corrupt(struct bvhd_error *error, const char *where, const char *reason)
{
    return bvhd_error_set(error, BVHD_CORRUPT, where, "%s", reason);
}

/* Checks what the header says about the record itself. */
static enum bvhd_status check_form(struct bytes bytes, const struct record_header *header, struct bvhd_error *error)
{
    if (bytes.size < sizeof *header)
        return corrupt(error, "record", "too short");
    if (memcmp(header->magic, record_magic, sizeof record_magic) != 0)
        return corrupt(error, "record.magic", "this is no record of an updatable structure");
    if (header->version == 0 || header->version > RECORD_NEWEST)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "record.version", "version %u, known are 1 to %d",
                              header->version, RECORD_NEWEST);
    if (header->version != 1 && header->geometry_count == 0)
        return corrupt(error, "record.version", "not that of a record without rows");
    if (header->size != bytes.size ||
        header->size != record_size(header->geometry_count, header->primitive_count, header->inactive_count,
                                    header->version == RECORD_MICROMAPS))
        return corrupt(error, "record.size", "not what its parts take");
    if (header->reserved[0] != 0 || header->reserved[1] != 0)
        return corrupt(error, "record.reserved", "not zero");
    return BVHD_OK;
}

/* Checks what the header says about the structure. */
static enum bvhd_status check_structure(const struct record_header *header, struct bvhd_error *error)
{
    static const struct device_format none;
    const struct layout *layout = layout_find((enum target)header->target);
    if (header->type != STRUCTURE_TOP && header->type != STRUCTURE_BOTTOM)
        return corrupt(error, "record.type", "neither a top nor a bottom level");
    if (!(header->flags & BUILD_ALLOW_UPDATE))
        return corrupt(error, "record.flags", "without ALLOW_UPDATE, which makes a record");
    if (header->inactive_count > header->primitive_count)
        return corrupt(error, "record.inactiveCount", "more than there are primitives");
    if (!layout)
        return corrupt(error, "record.target", "there is no such target");
    if (header->layout_flags & ~layout->flags)
        return corrupt(error, "record.layoutFlags", "unknown to the target");
    if (header->device.variant > layout->variants || (header->device.variant == 0) != (layout->variants == 0))
        return corrupt(error, "record.device", "the target has no such variant");
    if (layout->variants == 0 && memcmp(&header->device, &none, sizeof none) != 0)
        return corrupt(error, "record.device", "the target is that of no device");
    if (header->quality < QUALITY_FAST || header->quality > QUALITY_HIGH)
        return corrupt(error, "record.quality", "the record is not complete");
    if (!(header->cost >= 0 && isfinite(header->cost)))
        return corrupt(error, "record.cost", "no cost of a tree");
    return BVHD_OK;
}

/* A top level has the flag MOTION exactly if its instances move; a bottom level with it may stand still. */
static bool flags_allow(uint32_t flags, const struct kind *kind)
{
    const bool may_move = flags & BUILD_MOTION;
    return kind->is_top ? kind->moves == may_move : !kind->moves || may_move;
}

static bool row_is_sound(const struct record_header *header, const struct record_geometry *row)
{
    const struct update_kind *update_kind = update_kind_of(row->type);
    const struct kind *kind = kind_find(row->type);
    if (!update_kind || layout_find((enum target)header->target)->version(row->type) == 0)
        return false;
    return (header->type == STRUCTURE_TOP) == kind->is_top && flags_allow(header->flags, kind) &&
           update_kind->row_is_sound(row);
}

/* Returns the first of the rows that is not one of such a structure, or the number of rows. */
static uint32_t find_unsound(const struct record *record)
{
    const struct record_header *header = record->header;
    uint32_t g = 0;
    while (g < header->geometry_count && row_is_sound(header, &record->geometries[g]))
        g++;
    return g;
}

/* Returns the same for rows that are sound by themselves: all are of one type of Vulkan's, and the version has them. */
static uint32_t find_stranger(const struct record *record)
{
    const uint32_t type = record_type_of(record), count = record->header->geometry_count;
    const bool is_version =
        update_kind_of(type)->version == record->header->version || (record->micromaps && form_may_have_micromap(type));
    uint32_t g = 0;
    while (g < count && is_version &&
           kind_find(record->geometries[g].type)->vulkan_type == kind_find(type)->vulkan_type)
        g++;
    return g;
}

static bool micromap_is_sound(const struct record_micromap *row)
{
    static const struct record_micromap none;
    return row->attachment == RECORD_NO_MICROMAP ? memcmp(row, &none, sizeof none) == 0
                                                 : row->attachment <= RECORD_MICROMAP && row->reserved == 0;
}

/* Checks the micromaps of the rows, of which there is one at least. */
static enum bvhd_status check_micromaps(const struct record *record, struct bvhd_error *error)
{
    uint32_t given = 0;
    if (!record->micromaps)
        return BVHD_OK;
    for (uint32_t g = 0; g < record->header->geometry_count; g++) {
        if (!micromap_is_sound(&record->micromaps[g]))
            return corrupt(error, place("record.micromaps[%u]", g).text, "nothing that a geometry has");
        given |= record->micromaps[g].attachment;
    }
    return given ? BVHD_OK : corrupt(error, "record.version", "not that of a record without micromaps");
}

static enum bvhd_status check_rows(const struct record *record, struct bvhd_error *error)
{
    const uint32_t count = record->header->geometry_count;
    uint64_t primitives = 0;
    uint32_t wrong = find_unsound(record);
    wrong = wrong < count ? wrong : find_stranger(record);
    if (wrong < count)
        return corrupt(error, place("record.geometries[%u]", wrong).text, "no geometry of such a structure");
    for (uint32_t g = 0; g < count; g++)
        primitives += record->geometries[g].primitive_count;
    if (primitives != record->header->primitive_count)
        return corrupt(error, "record.primitiveCount", "not the sum over the geometries");
    return BVHD_OK;
}

static enum bvhd_status check_activity(const struct record *record, struct bvhd_error *error)
{
    const uint32_t primitives = record->header->primitive_count, rest = primitives % 64;
    const uint64_t words = record->active ? activity_words(primitives) : 0;
    uint64_t active = record->active ? 0 : primitives;
    for (uint64_t i = 0; i < words; i++)
        active += (unsigned)__builtin_popcountll(record->active[i]);
    if (words > 0 && rest > 0 && record->active[words - 1] >> rest != 0)
        return corrupt(error, "record.active", "bits of more primitives than there are");
    if (active != primitives - record->header->inactive_count)
        return corrupt(error, "record.active", "not as many as the header says");
    return BVHD_OK;
}

enum bvhd_status record_open(struct bytes bytes, struct record *ret_record, struct bvhd_error *error)
{
    const struct record_header *header = (const void *)bytes.data;
    enum bvhd_status status = check_form(bytes, header, error);
    if (status == BVHD_OK)
        status = check_structure(header, error);
    if (status != BVHD_OK)
        return status;
    struct record record;
    record_view(header, &record);
    status = check_rows(&record, error);
    if (status == BVHD_OK)
        status = check_micromaps(&record, error);
    if (status == BVHD_OK)
        status = check_activity(&record, error);
    if (status == BVHD_OK)
        *ret_record = record;
    return status;
}
