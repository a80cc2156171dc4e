/* SPDX-License-Identifier: Apache-2.0 */
/*
 * appearance.h - what the surfaces of a scene look like: base colours with textures, smooth normals, holes by alpha.
 * They are not in built structures, but are read again from the scene's file.
 *
 * Hits find their meshes by the numbers of instance, geometry and primitive, which are those of the file.
 */
#ifndef BVHCTL_APPEARANCE_H
#define BVHCTL_APPEARANCE_H

#include "client/bvhctl/picture/stage.h"
#include "client/bvhctl/picture/texture.h"
#include "client/bvhctl/scene/import.h"

struct appearance {
    struct import import;
    struct texture *textures; /* one for each image of the import; without levels if the image could not be read */
    bool has_looks; /* some mesh has more than one colour */
    bool has_holes; /* some mesh has places where there is no surface */
    bool has_top;
    struct memory *memory;
};

/*
 * Reads the file from which the structures were built; `wish` is what was read of it. Everything
 * else of the file is compared with the structures as far as it takes no time. BVHD_INCOMPATIBLE if they were built
 * from something else; else the errors of import_scene. End with appearance_close.
 */
enum bvhd_status appearance_open(struct appearance *appearance, const struct structures *structures, const char *path,
                                 const struct import_wish *wish, struct memory *memory, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void appearance_close(struct appearance *appearance);

/* The look of the surface at a hit. */
struct appearance_point {
    bool is_coloured, is_textured;
    struct vector albedo; /* linear, 0 to 1, if it is coloured */
    struct vector normal; /* unit, smooth if the mesh has normals, on the side of hit->normal */
    struct vector position; /* of the smooth surface, which may be a little above that of the triangle */
};

/*
 * Describes a hit. `spread` is the width of what the ray stands for at distance 1: textures are averaged over it. Any
 * thread.
 */
void appearance_describe(const struct appearance *appearance, const struct stage_hit *hit, double spread,
                         struct appearance_point *ret_point);

/* Returns whether there is no surface where a ray hit. Any thread. */
bool appearance_is_hole(const struct appearance *appearance, const struct stage_hit *hit, double spread);

#endif
