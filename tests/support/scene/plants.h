/* SPDX-License-Identifier: Apache-2.0 */
/* plants.h - trees, rocks and grass of a generated park, each a mesh of about 1 to 8 m that stands on y = 0. */
#ifndef BVHD_PLANTS_H
#define BVHD_PLANTS_H

#include "tests/support/scene/gltf.h"
#include "tests/support/random.h"

/* Each of these adds a mesh to the scene and returns its index. Trees have two parts: wood and leaves. */
int plants_add_conifer(struct gltf *gltf, const char *name, int wood, int needles, struct random *random);
int plants_add_broadleaf(struct gltf *gltf, const char *name, int wood, int leaves, struct random *random);
int plants_add_rock(struct gltf *gltf, const char *name, int stone, struct random *random);
int plants_add_grass(struct gltf *gltf, const char *name, int green, struct random *random);

#endif
