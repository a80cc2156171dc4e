/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/appearance.h"

#include <string.h>

#include "client/bvhctl/scene/import_round.h"

/* ---- whether the file is the one ---- */

static enum bvhd_status is_other(const struct appearance *appearance, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INCOMPATIBLE, appearance->import.name,
                          "the file has changed since the structures were built from it");
}

/* Compares the corners of a primitive with the positions of its mesh at either end of its motion. */
static bool same_corners(const struct import_mesh *mesh, const float *positions, uint32_t primitive,
                         const float corners[3][3])
{
    uint32_t count = import_shape_kinds[mesh->shape].corners;
    for (uint32_t i = 0; i < count; i++) {
        const float *position = positions + 3 * (size_t)mesh->indices[(size_t)count * primitive + i];
        for (int k = 0; k < 3; k++)
            if (position[k] != corners[i][k])
                return false;
    }
    return true;
}

/* Returns the flat number of a primitive, and the positions of its corners: one of a sphere, two of a swept one. */
static uint32_t take_corners(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3])
{
    uint32_t flat;
    if (structure_round_count(structure)) {
        struct structure_round round = structure_round(structure, row);
        for (int end = 0; end < 2; end++)
            memcpy(ret_corners[end], round.ends[end], sizeof ret_corners[end]);
        return round.primitive;
    }
    structure_triangle(structure, row, time, ret_corners, &flat);
    return flat;
}

/* Compares some primitives of a structure with those of the file. */
static bool same_primitives(const struct import *import, const struct import_bottom *bottom,
                            const struct structure *structure)
{
    enum { COMPARED = 16 };
    uint32_t rows = structure_triangle_count(structure) + structure_round_count(structure), step = rows / COMPARED + 1;
    for (uint32_t row = 0; row < rows; row += step) {
        float corners[3][3], end_corners[3][3];
        uint32_t flat = take_corners(structure, row, 0, corners);
        take_corners(structure, row, 1, end_corners);
        for (uint32_t i = 0; i < structure->geometry_count; i++) {
            const struct structure_geometry *geometry = &structure->geometries[i];
            if (flat - geometry->first_primitive >= geometry->primitive_count)
                continue;
            const struct import_mesh *mesh = &import->meshes[bottom->meshes[geometry->geometry]];
            const float *end = mesh->end_positions ? mesh->end_positions : mesh->positions;
            const uint32_t primitive = flat - geometry->first_primitive;
            if (!same_corners(mesh, mesh->positions, primitive, (const float(*)[3])corners) ||
                !same_corners(mesh, end, primitive, (const float(*)[3])end_corners))
                return false;
        }
    }
    return true;
}

static bool same_bottom(const struct import *import, uint32_t index, const struct structure *structure)
{
    if (index >= import->bottom_count)
        return false;
    const struct import_bottom *bottom = &import->bottoms[index];
    for (uint32_t i = 0; i < structure->geometry_count; i++) {
        const struct structure_geometry *geometry = &structure->geometries[i];
        if (geometry->geometry >= bottom->mesh_count ||
            geometry->primitive_count > import->meshes[bottom->meshes[geometry->geometry]].primitive_count)
            return false;
    }
    return same_primitives(import, bottom, structure);
}

static bool same_numbers(const float *a, const float *b, int count)
{
    for (int i = 0; i < count; i++)
        if (a[i] != b[i])
            return false;
    return true;
}

static bool same_place(const struct import *import, const struct import_instance *other,
                       const struct structure_instance *instance)
{
    const struct import_motion *motion = other->motion ? &import->motions[other->motion - 1] : NULL;
    if (!motion)
        return instance->motion == MOTION_STATIC && same_numbers(other->transform, instance->start, PORTABLE_MATRIX);
    const bool is_srt = motion->kind == ORACLE_SRT;
    const int count = is_srt ? PORTABLE_SRT : PORTABLE_MATRIX;
    return instance->motion == (is_srt ? MOTION_SRT : MOTION_MATRIX) &&
           same_numbers(motion->start, instance->start, count) && same_numbers(motion->end, instance->end, count);
}

static bool same_instances(const struct import *import, const struct structures *structures)
{
    enum { COMPARED = 256 };
    const struct structure *top = structures_top(structures);
    uint32_t rows = structure_instance_count(top), step = rows / COMPARED + 1;
    for (uint32_t row = 0; row < rows; row += step) {
        struct structure_instance instance = structure_instance(top, row);
        if (instance.instance >= import->instance_count)
            return false;
        const struct import_instance *other = &import->instances[instance.instance];
        if (!same_place(import, other, &instance) ||
            !same_bottom(import, other->bottom, &structures->files[instance.bottom].structure))
            return false;
    }
    return true;
}

/* ---- opening ---- */

static bool make_textures(struct appearance *appearance)
{
    const struct import *import = &appearance->import;
    appearance->textures =
        memory_array(appearance->memory, (uint64_t)import->image_count + 1, sizeof *appearance->textures);
    if (!appearance->textures)
        return false;
    memset(appearance->textures, 0, import->image_count * sizeof *appearance->textures);
    for (uint32_t i = 0; i < import->image_count; i++)
        if (import->images[i].rgba && !texture_init(&appearance->textures[i], &import->images[i], appearance->memory))
            return false;
    return true;
}

static void sum_up(struct appearance *appearance)
{
    for (uint32_t i = 0; i < appearance->import.mesh_count; i++) {
        const struct import_look *look = &appearance->import.meshes[i].look;
        appearance->has_looks |= look->has_image || look->normals || look->colours;
        appearance->has_holes |= look->cutoff > 0;
    }
}

enum bvhd_status appearance_open(struct appearance *appearance, const struct structures *structures, const char *path,
                                 const struct import_wish *wish, struct memory *memory, struct bvhd_error *error)
{
    const struct structure *top = structures_top(structures);
    struct import_wish with_looks = *wish;
    with_looks.wants_looks = true;
    *appearance = (struct appearance){.memory = memory, .has_top = top != NULL};
    enum bvhd_status status = import_scene_as(path, &with_looks, memory, &appearance->import, error);
    if (status != BVHD_OK) {
        *appearance = (struct appearance){0};
        return status;
    }
    bool is_same = top ? same_instances(&appearance->import, structures)
                       : same_bottom(&appearance->import, 0, &structures->files[0].structure);
    if (!is_same)
        status = is_other(appearance, error);
    else if (!make_textures(appearance))
        status = bvhd_error_no_memory(error, path, "no memory for the textures");
    sum_up(appearance);
    if (status != BVHD_OK)
        appearance_close(appearance);
    return status;
}

void appearance_close(struct appearance *appearance)
{
    if (!appearance || !appearance->memory)
        return;
    for (uint32_t i = 0; i < appearance->import.image_count && appearance->textures; i++)
        texture_finish(&appearance->textures[i]);
    memory_free(appearance->memory, appearance->textures);
    import_finish(&appearance->import);
    *appearance = (struct appearance){0};
}

/* ---- looking at a hit ---- */

/* A hit in its mesh. */
struct spot {
    const struct import_look *look;
    uint32_t corners[3]; /* the vertices of the primitive, of which a round one repeats some */
    const float *transform; /* of the instance, when it was hit; NULL: none */
    double weights[3]; /* of the corners; those that repeat another have 0 */
};

static bool find_spot(const struct appearance *appearance, const struct stage_hit *hit, struct spot *ret_spot)
{
    const struct import *import = &appearance->import;
    if (hit->is_box || (appearance->has_top && hit->instance >= import->instance_count))
        return false;
    const struct import_instance *instance = appearance->has_top ? &import->instances[hit->instance] : NULL;
    const struct import_bottom *bottom = &import->bottoms[instance ? instance->bottom : 0];
    if (hit->geometry >= bottom->mesh_count)
        return false;
    const struct import_mesh *mesh = &import->meshes[bottom->meshes[hit->geometry]];
    if (hit->primitive >= mesh->primitive_count)
        return false;
    *ret_spot = (struct spot){.look = &mesh->look,
                              .transform = instance ? hit->object_to_world : NULL,
                              .weights = {1 - hit->u - hit->v, hit->u, hit->v}};
    uint32_t corners = import_shape_kinds[mesh->shape].corners;
    for (uint32_t i = 0; i < 3; i++)
        ret_spot->corners[i] = mesh->indices[(size_t)hit->primitive * corners + i % corners];
    return true;
}

/* Returns how many pixels of a texture there are on a square of side 1 of the surface. */
static double pixel_density(const struct texture *texture, const struct stage_hit *hit, const float *const uv[3])
{
    double du1 = (double)uv[1][0] - (double)uv[0][0], dv1 = (double)uv[1][1] - (double)uv[0][1],
           du2 = (double)uv[2][0] - (double)uv[0][0], dv2 = (double)uv[2][1] - (double)uv[0][1];
    double pixels = fabs(du1 * dv2 - du2 * dv1) * texture->levels[0].width * texture->levels[0].height;
    double area = vector_length(
        vector_cross(vector_sub(hit->corners[1], hit->corners[0]), vector_sub(hit->corners[2], hit->corners[0])));
    return pixels / fmax(area, 1e-300);
}

static struct texture_colour look_up(const struct appearance *appearance, const struct stage_hit *hit,
                                     const struct spot *spot, double spread, double sharpness)
{
    const struct import_look *look = spot->look;
    const struct texture *texture = &appearance->textures[look->image];
    const float *uv[3];
    double u = 0, v = 0, width = hit->distance * spread;
    for (int i = 0; i < 3; i++) {
        uv[i] = look->texcoords + 2 * (size_t)spot->corners[i];
        u += spot->weights[i] * (double)uv[i][0];
        v += spot->weights[i] * (double)uv[i][1];
    }
    double pixels = pixel_density(texture, hit, uv) * width * width;
    const struct texture_filter filter = {.wrap = {look->wrap[0], look->wrap[1]},
                                          .is_pixelated = look->is_pixelated,
                                          .level = pixels > 1e-30 ? 0.5 * log2(pixels) - sharpness : 0};
    return texture_sample(texture, u, v, &filter);
}

/* Returns the colour of a spot, with its alpha. */
static struct texture_colour find_colour(const struct appearance *appearance, const struct stage_hit *hit,
                                         const struct spot *spot, double spread, double sharpness)
{
    const struct import_look *look = spot->look;
    struct texture_colour colour = {vector_from_floats(look->factor), (double)look->factor[3]};
    if (look->colours) {
        struct texture_colour mixed = {{0, 0, 0}, 0};
        for (int i = 0; i < 3; i++) {
            const float *rgba = look->colours + 4 * (size_t)spot->corners[i];
            mixed.rgb = vector_mad(mixed.rgb, vector_from_floats(rgba), spot->weights[i]);
            mixed.alpha += spot->weights[i] * (double)rgba[3];
        }
        colour = (struct texture_colour){vector_mul(colour.rgb, mixed.rgb), colour.alpha * mixed.alpha};
    }
    if (look->has_image) {
        struct texture_colour texel = look_up(appearance, hit, spot, spread, sharpness);
        colour = (struct texture_colour){vector_mul(colour.rgb, texel.rgb), colour.alpha * texel.alpha};
    }
    return colour;
}

/* Returns the normal of a corner in world space: transformed by the cofactors of the matrix, which keep it upright. */
static struct vector corner_normal(const struct spot *spot, int corner)
{
    struct vector n = vector_from_floats(spot->look->normals + 3 * (size_t)spot->corners[corner]);
    const float *m = spot->transform;
    if (!m)
        return n;
    struct vector x = {(double)m[0], (double)m[4], (double)m[8]}, y = {(double)m[1], (double)m[5], (double)m[9]},
                  z = {(double)m[2], (double)m[6], (double)m[10]};
    return vector_unit(vector_mad(vector_mad(vector_scale(vector_cross(y, z), n.x), vector_cross(z, x), n.y),
                                  vector_cross(x, y), n.z));
}

/*
 * Sets the smooth normal, and moves the position to where a smooth surface would be (Hanika 2021), so that the
 * triangles of a coarse mesh cast no shadows on each other near the border of light and shadow.
 */
static void smooth(const struct stage_hit *hit, const struct spot *spot, struct appearance_point *point)
{
    struct vector normals[3], sum = {0, 0, 0}, lift = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        normals[i] = corner_normal(spot, i);
        sum = vector_mad(sum, normals[i], spot->weights[i]);
    }
    double side = vector_dot(sum, hit->normal) < 0 ? -1 : 1;
    if (vector_length(sum) < 1e-3)
        return;
    point->normal = vector_scale(vector_unit(sum), side);
    for (int i = 0; i < 3; i++) {
        struct vector away = vector_sub(hit->position, hit->corners[i]), normal = vector_scale(normals[i], side);
        double depth = fmin(vector_dot(away, normal), 0);
        lift = vector_mad(lift, normal, -depth * spot->weights[i]);
    }
    if (vector_dot(lift, hit->normal) > 0)
        point->position = vector_add(point->position, lift);
}

void appearance_describe(const struct appearance *appearance, const struct stage_hit *hit, double spread,
                         struct appearance_point *ret_point)
{
    struct spot spot;
    *ret_point = (struct appearance_point){.normal = hit->normal, .position = hit->position};
    if (!find_spot(appearance, hit, &spot))
        return;
    ret_point->is_coloured = spot.look->is_coloured;
    ret_point->is_textured = spot.look->has_image;
    if (spot.look->is_coloured)
        ret_point->albedo = find_colour(appearance, hit, &spot, spread, 0).rgb;
    if (spot.look->normals)
        smooth(hit, &spot, ret_point);
}

bool appearance_is_hole(const struct appearance *appearance, const struct stage_hit *hit, double spread)
{
    static const double sharpness = 1; /* averages of alpha would close small holes, or dissolve thin leaves */
    struct spot spot;
    return find_spot(appearance, hit, &spot) && spot.look->cutoff > 0 &&
           find_colour(appearance, hit, &spot, spread, sharpness).alpha < (double)spot.look->cutoff;
}
