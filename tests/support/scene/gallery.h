/* SPDX-License-Identifier: Apache-2.0 */
/* gallery.h - small scenes that everybody recognises, as glTF: for the contact sheet, and to look at pictures. */
#ifndef BVHD_GALLERY_H
#define BVHD_GALLERY_H

#include "tests/support/random.h"
#include "tests/support/scene/gltf.h"

struct gallery_scene {
    const char *name;
    void (*make)(struct gltf *gltf, struct random *random); /* fills an empty scene; y is up, the front is at +z */
};

/* All scenes: *ret_count of them. */
const struct gallery_scene *gallery_scenes(uint32_t *ret_count);

/* NULL: there is none of that name. */
const struct gallery_scene *gallery_find(const char *name);

/* The scenes of one kind. Internal to gallery.c. */
enum { GALLERY_BODIES = 14, GALLERY_BUILDINGS = 13, GALLERY_NATURE = 13 };
extern const struct gallery_scene gallery_bodies[GALLERY_BODIES], gallery_buildings[GALLERY_BUILDINGS],
    gallery_nature[GALLERY_NATURE];

#endif
