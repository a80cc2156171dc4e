/* SPDX-License-Identifier: Apache-2.0 */
/*
 * build_library.h - the builder as a shared library, libbvhd_build, which libbvhd loads when it has to build in the
 * program's own process.
 *
 * The library exports one function, which returns a table of functions. The table is no public interface: libbvhd uses
 * the table of its own version only. Its first field is the version in all versions, so that another one can be
 * recognised and refused by name.
 */
#ifndef BVHD_BUILD_LIBRARY_H
#define BVHD_BUILD_LIBRARY_H

#include <bvhd/status.h>

#include "builder/update/build_entry.h"

struct workers;

/* The file that is loaded, and the name of the function in it. */
#define BUILD_LIBRARY_FILE "libbvhd_build.so.0"
#define BUILD_LIBRARY_ENTRY "bvhd_build_library"

/* The functions of the library. Each may be called from any thread. */
struct build_library {
    const char *version; /* of bvhd: "0.1.0" */

    /* As workers.h describes them. */
    enum bvhd_status (*workers_create)(unsigned threads, struct workers **ret_workers, struct bvhd_error *error);
    void (*workers_destroy)(struct workers *workers);
    const struct parallel *(*workers_parallel)(const struct workers *workers);

    /* As build_entry.h describes them; the limits are those of limits_default(). */
    enum bvhd_status (*entry_prepare)(const struct build_input *input, uint32_t index,
                                      const struct build_entry_source *source, const struct build_context *context,
                                      struct build_entry *ret_entry, struct bvhd_error *error);
    void (*entry_finish)(struct build_entry *entry, struct memory *memory);

    /* As build_entry.h describes it; context->output provides the blob's bytes. */
    enum bvhd_status (*entry_make)(struct build_entry *entry, const struct build_entry_source *source,
                                   const struct build_context *context, struct build_made *ret_made,
                                   struct bvhd_error *error);
};

/* Returns the table, which is constant. The only name that the library exports. */
BVHD_API const struct build_library *bvhd_build_library(void);

#endif
