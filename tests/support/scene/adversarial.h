/* SPDX-License-Identifier: Apache-2.0 */
/* adversarial.h - small meshes at which builders and traversals fail: one a failure. */
#ifndef BVHD_ADVERSARIAL_H
#define BVHD_ADVERSARIAL_H

#include "tests/support/scene/mesh.h"
#include "tests/support/random.h"

struct adversarial {
    const char *name;
    const char *shows; /* what goes wrong with it, a few words */
    /* Adds about `size` triangles (at least 1) to an empty mesh. */
    void (*make)(struct mesh *mesh, uint32_t size, struct random *random);
};

/* All of them, *ret_count of them. */
const struct adversarial *adversarial_scenes(uint32_t *ret_count);

/* NULL when there is none of that name. */
const struct adversarial *adversarial_find(const char *name);

#endif
