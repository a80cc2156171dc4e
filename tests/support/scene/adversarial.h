/* SPDX-License-Identifier: Apache-2.0 */
/* adversarial.h - small meshes on which builders and traversals fail, each in one way. */
#ifndef BVHD_ADVERSARIAL_H
#define BVHD_ADVERSARIAL_H

#include "tests/support/scene/mesh.h"
#include "tests/support/random.h"

struct adversarial {
    const char *name;
    const char *shows; /* what goes wrong with it, in a few words */
    /* Adds about `size` triangles (at least 1) to an empty mesh. */
    void (*make)(struct mesh *mesh, uint32_t size, struct random *random);
};

/* Returns all of them; their number is *ret_count. */
const struct adversarial *adversarial_scenes(uint32_t *ret_count);

/* Returns NULL when there is none of that name. */
const struct adversarial *adversarial_find(const char *name);

#endif
