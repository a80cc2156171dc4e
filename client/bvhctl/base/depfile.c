/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/depfile.h"

#include <string.h>

#include "client/bvhctl/base/files.h"

static void append(struct depfile *depfile, const char *text, size_t size)
{
    if (depfile->failed)
        return;
    if (depfile->capacity - depfile->size <= size) {
        uint64_t capacity = depfile->capacity * 2 + size + 256;
        char *grown = memory_resize(depfile->memory, depfile->text, capacity);
        depfile->failed = !grown;
        if (!grown)
            return;
        depfile->text = grown;
        depfile->capacity = capacity;
    }
    memcpy(depfile->text + depfile->size, text, size);
    depfile->size += size;
    depfile->text[depfile->size] = '\0';
}

/* In make, a backslash is special only before a blank or '#', and is doubled there. */
static void append_quoted(struct depfile *depfile, const char *path)
{
    size_t backslashes = 0;
    for (; *path; path++) {
        if (*path == ' ' || *path == '\t' || *path == '#') {
            for (size_t i = 0; i <= backslashes; i++)
                append(depfile, "\\", 1);
        } else if (*path == '$') {
            append(depfile, "$", 1);
        }
        backslashes = *path == '\\' ? backslashes + 1 : 0;
        append(depfile, path, 1);
    }
}

void depfile_init(struct depfile *depfile, struct memory *memory, const char *target)
{
    *depfile = (struct depfile){.memory = memory};
    append_quoted(depfile, target);
    append(depfile, ":", 1);
}

void depfile_add(struct depfile *depfile, const char *path)
{
    append(depfile, " \\\n  ", 5);
    append_quoted(depfile, path);
}

enum bvhd_status depfile_write(struct depfile *depfile, const char *path, struct bvhd_error *error)
{
    append(depfile, "\n", 1);
    if (depfile->failed)
        return bvhd_error_no_memory(error, path, "no memory for the list of files");
    return files_write(path, (struct bytes){(const unsigned char *)depfile->text, depfile->size}, depfile->memory, NULL,
                       error);
}

void depfile_finish(struct depfile *depfile)
{
    if (!depfile)
        return;
    memory_free(depfile->memory, depfile->text);
    depfile->text = NULL;
    depfile->size = depfile->capacity = 0;
}
