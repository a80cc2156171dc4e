/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_names.h"

#include <string.h>

static bool grow(struct import_names *names, uint64_t size, struct memory *memory)
{
    if (names->capacity - names->size >= size)
        return true;
    uint64_t capacity = names->capacity * 2 + size + 256;
    char *texts = memory_resize(memory, names->texts, capacity);
    if (!texts)
        return false;
    names->texts = texts;
    names->capacity = capacity;
    return true;
}

bool import_names_add(struct import_names *names, const char *name, struct memory *memory, uint32_t *ret_offset)
{
    *ret_offset = 0;
    if (!name || !*name)
        return true;
    uint64_t size = strlen(name) + 1;
    if (!grow(names, size + 1, memory))
        return false;
    if (names->size == 0)
        names->texts[names->size++] = '\0';
    if (names->size > UINT32_MAX)
        return false;
    *ret_offset = (uint32_t)names->size;
    memcpy(names->texts + names->size, name, size);
    names->size += size;
    return true;
}

const char *import_names_get(const struct import_names *names, uint32_t offset)
{
    return offset < names->size ? names->texts + offset : "";
}
