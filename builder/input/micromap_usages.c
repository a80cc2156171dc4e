/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/micromap_usages.h"

#include <inttypes.h>

/* The rules about 4-state triangles tell lossy micromaps from others. */
static enum bvhd_status refuse(const struct micromap_usage *usage, uint32_t flags, struct place where,
                               struct bvhd_error *error)
{
    const bool is_lossy = flags & BUILD_MICROMAP_LOSSY;
    if (usage->format != MICRO_2_STATE && usage->format != MICRO_4_STATE)
        return bvhd_error_rule(error, BVHD_VUID_07519, where.text, "format %" PRIu32 ", which is none of micromaps",
                               usage->format);
    if (is_lossy && usage->format != MICRO_4_STATE)
        return bvhd_error_rule(error, BVHD_VUID_11712, where.text, "a lossy micromap has 4 states");
    return bvhd_error_rule(error,
                           usage->format == MICRO_2_STATE ? BVHD_VUID_11645
                           : is_lossy                     ? BVHD_VUID_11565
                                                          : BVHD_VUID_11564,
                           where.text, "level %" PRIu32 ", at most %d", usage->level, MICRO_LEVEL_MAX);
}

enum bvhd_status micromap_usages_read(const struct bytes *usages, uint32_t flags, struct place where,
                                      struct micromap_usages *ret_usages, struct bvhd_error *error)
{
    const uint64_t count = usages->size / sizeof(struct micromap_usage);
    *ret_usages = (struct micromap_usages){{{0}}};
    if (usages->size % sizeof(struct micromap_usage) != 0 || (count > 0 && !usages->data))
        return bvhd_error_set(error, BVHD_INVALID, where.text, "%" PRIu64 " bytes are no usages", usages->size);
    for (uint64_t i = 0; i < count; i++) {
        struct micromap_usage usage;
        memcpy(&usage, usages->data + i * sizeof usage, sizeof usage);
        if (!micromap_usage_is_valid(usage.format, usage.level) ||
            ((flags & BUILD_MICROMAP_LOSSY) && usage.format != MICRO_4_STATE))
            return refuse(&usage, flags, place("%s[%llu]", where.text, (unsigned long long)i), error);
        ret_usages->counts[usage.format - 1][usage.level] += usage.count;
    }
    return BVHD_OK;
}

uint64_t micromap_usages_total(const struct micromap_usages *usages)
{
    uint64_t total = 0;
    for (int format = 0; format < MICROMAP_FORMATS; format++)
        for (int level = 0; level <= MICRO_LEVEL_MAX; level++)
            total += usages->counts[format][level];
    return total;
}

enum bvhd_status micromap_usages_compare(const struct micromap_usages *said, const struct micromap_usages *found,
                                         struct place where, struct bvhd_error *error)
{
    for (int format = 0; format < MICROMAP_FORMATS; format++)
        for (int level = 0; level <= MICRO_LEVEL_MAX; level++)
            if (said->counts[format][level] != found->counts[format][level])
                return bvhd_error_set(error, BVHD_INVALID, where.text,
                                      "%" PRIu64 " triangles of format %d and level %d, but there are %" PRIu64,
                                      said->counts[format][level], format + 1, level, found->counts[format][level]);
    return BVHD_OK;
}
