/* SPDX-License-Identifier: Apache-2.0 */
#include "client/cpu/cpu_scene.h"

#include <inttypes.h>
#include <string.h>

#include "builder/format/serialized.h"
#include "client/argument.h"
#include "client/library.h"
#include "proto/base/handle_table.h"
#include "proto/base/place.h"

/* The creation of a scene: its arguments, for the helpers. */
struct opening {
    const struct bvhd_cpu_scene_options *options;
    struct bvhd_cpu_scene *scene;
    struct handle_entry *entries; /* two for each blob: the second half is scratch */
    struct bvhd_error *error;
};

static enum bvhd_status no_memory(const struct opening *opening)
{
    return bvhd_error_no_memory(opening->error, "blobs", "no memory for a scene of %" PRIu32 " structures",
                                opening->options->blob_count);
}

static enum bvhd_status refuse(const struct opening *opening, const char *where, const char *text)
{
    return bvhd_error_set(opening->error, BVHD_INVALID, where, "%s", text);
}

static enum bvhd_status check_options(const struct bvhd_cpu_scene_options *options, struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(options, sizeof *options, sizeof *options, "options", "bvhd_cpu_scene_options", error);
    if (status != BVHD_OK)
        return status;
    if (options->blob_count == 0)
        return bvhd_error_set(error, BVHD_INVALID, "options.blob_count", "0: there is no structure");
    if (!options->blobs)
        return bvhd_error_set(error, BVHD_INVALID, "options.blobs", "options.blobs is NULL, but blob_count is %" PRIu32,
                              options->blob_count);
    if (options->flags != 0)
        return bvhd_error_set(error, BVHD_INVALID, "options.flags", "0x%" PRIx32 " is not known", options->flags);
    return BVHD_OK;
}

/* ---- Opening the blobs ---- */

static const struct cpu_target *target_of(struct bytes blob)
{
    bool is_portable =
        blob.size >= SERIALIZED_UUID_SIZE && !memcmp(blob.data, portable_driver_uuid, SERIALIZED_UUID_SIZE);
    return is_portable ? &cpu_portable : &cpu_lavapipe;
}

/* Opens a blob, which has to be of the scene's target, and a bottom level unless it is the last one. */
static enum bvhd_status open_blob(const struct opening *opening, uint32_t index)
{
    struct bvhd_cpu_scene *scene = opening->scene;
    struct cpu_structure *structure = &scene->structures[index];
    const struct cpu_target *target = target_of(structure->blob);
    bool is_last = index + 1 == scene->structure_count;
    struct bvhd_error inner = {0};
    enum bvhd_status status = target->open(structure, &inner);
    if (status == BVHD_OK && target != scene->target)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "not of the target of the last blob");
    if (status == BVHD_OK && !is_last && target->level(structure) == CPU_TOP)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "a top level, but only the last blob may be one");
    if (status == BVHD_OK && is_last && index > 0 && target->level(structure) == CPU_BOTTOM)
        status = bvhd_error_set(&inner, BVHD_INVALID, "data", "a bottom level, but the last of several is a top level");
    if (status != BVHD_OK)
        return bvhd_error_set(opening->error, status, place("blobs[%" PRIu32 "]: %.80s", index, inner.where).text, "%s",
                              inner.text);
    return BVHD_OK;
}

/* Opens the bottom levels in the order of their addresses, so that those with the same data are checked once. */
static enum bvhd_status open_bottoms(const struct opening *opening)
{
    struct cpu_structure *structures = opening->scene->structures;
    uint32_t count = opening->scene->structure_count - 1;
    struct handle_entry *entries = opening->entries;
    for (uint32_t i = 0; i < count; i++)
        entries[i] = (struct handle_entry){(uintptr_t)structures[i].blob.data, i};
    handle_sort(entries, entries + count, count);
    for (uint32_t i = 0; i < count; i++) {
        struct cpu_structure *structure = &structures[entries[i].number];
        const struct cpu_structure *before = i > 0 ? &structures[entries[i - 1].number] : NULL;
        enum bvhd_status status = BVHD_OK;
        if (!structure->blob.data)
            continue;
        if (!before || before->blob.data != structure->blob.data)
            status = open_blob(opening, entries[i].number);
        else if (before->blob.size != structure->blob.size)
            return refuse(opening, place("blobs[%" PRIu32 "]: size", entries[i].number).text,
                          "not that of an earlier blob with the same data");
        else
            *structure = (struct cpu_structure){structure->blob,   before->view,      before->unpacked,
                                                before->triangles, before->positions, true};
        if (status != BVHD_OK)
            return status;
    }
    return BVHD_OK;
}

static enum bvhd_status list_blobs(struct opening *opening)
{
    const struct bvhd_cpu_scene_options *options = opening->options;
    struct bvhd_cpu_scene *scene = opening->scene;
    uint32_t count = options->blob_count;
    opening->entries = memory_array(&library_memory, 2 * (uint64_t)count, sizeof *opening->entries);
    scene->structures = memory_array(&library_memory, count, sizeof *scene->structures);
    if (!opening->entries || !scene->structures)
        return no_memory(opening);
    memset(scene->structures, 0, count * sizeof *scene->structures);
    scene->structure_count = count;
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_cpu_blob *blob = &options->blobs[i];
        struct place where = place("blobs[%" PRIu32 "]: data", i);
        if (!blob->data && blob->size > 0)
            return bvhd_error_set(opening->error, BVHD_INVALID, where.text, "NULL, but size is %" PRIu64, blob->size);
        if (!blob->data && i + 1 == count)
            return refuse(opening, where.text, "NULL, but the last blob is the structure that rays enter");
        scene->structures[i].blob = (struct bytes){blob->data, blob->size};
    }
    scene->target = target_of(scene->structures[count - 1].blob);
    return BVHD_OK;
}

/* ---- Which bottom levels the instances name ---- */

static enum bvhd_status sort_handles(const struct opening *opening)
{
    const struct bvhd_cpu_scene *scene = opening->scene;
    uint32_t count = scene->bottom_count;
    struct handle_entry *entries = opening->entries;
    for (uint32_t i = 0; i < count; i++) {
        entries[i] = (struct handle_entry){opening->options->handles[i], i};
        if (entries[i].handle == 0 && scene->structures[i].blob.data)
            return refuse(opening, place("options.handles[%" PRIu32 "]", i).text, "0, which is no handle");
    }
    handle_sort(entries, entries + count, count);
    for (uint32_t i = 1; i < count; i++)
        if (entries[i].handle != 0 && entries[i].handle == entries[i - 1].handle)
            return bvhd_error_set(opening->error, BVHD_INVALID,
                                  place("options.handles[%" PRIu32 "]", entries[i].number).text,
                                  "the same handle as handles[%" PRIu32 "]", entries[i - 1].number);
    return BVHD_OK;
}

/* Finds the bottom level of each of the top level's handles by the numbers that the caller gave them. */
static enum bvhd_status find_rows(const struct opening *opening)
{
    struct bvhd_cpu_scene *scene = opening->scene;
    const struct cpu_structure *top = cpu_scene_top(scene);
    uint64_t count = scene->target->handle_count(top);
    enum bvhd_status status = sort_handles(opening);
    if (status != BVHD_OK)
        return status;
    scene->rows = memory_array(&library_memory, count + 1, sizeof *scene->rows);
    if (!scene->rows)
        return no_memory(opening);
    for (uint64_t i = 0; i < count; i++) {
        uint64_t handle = scene->target->handle(top, i);
        uint32_t at = handle ? handle_find(opening->entries, scene->bottom_count, handle) : HANDLE_NONE;
        scene->rows[i] = at == HANDLE_NONE ? HANDLE_NONE : opening->entries[at].number;
    }
    return BVHD_OK;
}

/* Checks that the bottom levels that instances name are there. */
static enum bvhd_status check_instances(const struct opening *opening)
{
    const struct bvhd_cpu_scene *scene = opening->scene;
    const struct cpu_structure *top = cpu_scene_top(scene);
    for (uint32_t i = 0; i < scene->target->instance_count(top); i++) {
        uint32_t instance;
        uint64_t bottom = scene->target->bottom(scene, i, &instance);
        struct place where = place("instances[%" PRIu32 "]", instance);
        if (scene->rows && bottom == HANDLE_NONE)
            return refuse(opening, where.text, "names a handle that is not among options.handles");
        if (bottom >= scene->bottom_count || !scene->structures[bottom].blob.data)
            return bvhd_error_set(opening->error, BVHD_INVALID, where.text,
                                  "names the bottom level in row %" PRIu64 ", but there is no such blob", bottom);
    }
    return BVHD_OK;
}

static enum bvhd_status join_blobs(const struct opening *opening)
{
    struct bvhd_cpu_scene *scene = opening->scene;
    uint32_t count = scene->structure_count;
    bool has_top = count > 1 || scene->target->level(&scene->structures[0]) == CPU_TOP;
    scene->bottom_count = count - has_top;
    enum bvhd_status status = has_top && opening->options->handles ? find_rows(opening) : BVHD_OK;
    if (status == BVHD_OK && !scene->target->make_walk(scene))
        status = no_memory(opening);
    return status == BVHD_OK && has_top ? check_instances(opening) : status;
}

static enum bvhd_status open_scene(struct opening *opening)
{
    enum bvhd_status status = list_blobs(opening);
    if (status == BVHD_OK)
        status = open_blob(opening, opening->scene->structure_count - 1);
    if (status == BVHD_OK)
        status = open_bottoms(opening);
    return status == BVHD_OK ? join_blobs(opening) : status;
}

enum bvhd_status bvhd_cpu_scene_create(const struct bvhd_cpu_scene_options *options, struct bvhd_cpu_scene **ret_scene,
                                       struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {options, "options"}, {ret_scene, "ret_scene"});
    if (status == BVHD_OK)
        status = check_options(options, ret_error);
    if (status != BVHD_OK)
        return status;
    struct opening opening = {
        .options = options, .scene = memory_alloc(&library_memory, sizeof *opening.scene), .error = ret_error};
    if (!opening.scene)
        return no_memory(&opening);
    *opening.scene = (struct bvhd_cpu_scene){.structures = NULL};
    status = open_scene(&opening);
    memory_free(&library_memory, opening.entries);
    if (status == BVHD_OK)
        *ret_scene = opening.scene;
    else
        bvhd_cpu_scene_destroy(opening.scene);
    return status;
}

void bvhd_cpu_scene_destroy(struct bvhd_cpu_scene *scene)
{
    if (!scene)
        return;
    for (uint32_t i = 0; scene->structures && i < scene->structure_count; i++) {
        if (scene->structures[i].is_shared)
            continue;
        memory_free(&library_memory, scene->structures[i].unpacked);
        memory_free(&library_memory, scene->structures[i].triangles);
        positions_unref(scene->structures[i].positions);
    }
    memory_free(&library_memory, scene->unpacked);
    memory_free(&library_memory, scene->views);
    memory_free(&library_memory, scene->rows);
    memory_free(&library_memory, scene->structures);
    memory_free(&library_memory, scene);
}

void bvhd_cpu_scene_bounds(const struct bvhd_cpu_scene *scene, float ret_bounds[6])
{
    if (!scene || !ret_bounds)
        return;
    scene->target->bounds(&scene->structures[scene->structure_count - 1], ret_bounds);
    if (!(ret_bounds[0] <= ret_bounds[3]))
        memset(ret_bounds, 0, 6 * sizeof *ret_bounds);
}

/* ---- What belongs to a hit ---- */

/* Checks that the hit names an instance of the top level, if there is one, and a bottom level. */
static enum bvhd_status check_hit(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                  struct bvhd_error *error)
{
    const struct cpu_structure *top = scene ? cpu_scene_top(scene) : NULL;
    if (!scene || !hit)
        return ARGUMENTS_CHECK(error, {scene, "scene"}, {hit, "hit"});
    if (hit->blob == BVHD_CPU_NO_BLOB)
        return bvhd_error_set(error, BVHD_INVALID, "hit.blob", "none: the ray has hit nothing");
    if (hit->blob >= scene->bottom_count || !scene->structures[hit->blob].blob.data)
        return bvhd_error_set(error, BVHD_INVALID, "hit.blob", "%" PRIu32 " is no bottom level of this scene",
                              hit->blob);
    if (hit->instance_record >= (top ? scene->target->instance_count(top) : 1))
        return bvhd_error_set(error, BVHD_INVALID, "hit.instance_record", "%" PRIu32 " is no instance of this scene",
                              hit->instance_record);
    return BVHD_OK;
}

/* `time` is NULL if the caller has not said one. */
static enum bvhd_status get_corners(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                    const float *time, float ret_corners[3][3], struct bvhd_error *error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(error, {ret_corners, "ret_corners"});
    if (status == BVHD_OK)
        status = check_hit(scene, hit, error);
    if (status == BVHD_OK && time)
        status = argument_check_time(*time, error);
    if (status != BVHD_OK)
        return status;
    const struct ray_hit inner = {.handle = hit->blob, .record = hit->record};
    if (hit->flags & BVHD_CPU_HIT_AABB || !scene->target->corners(scene, &inner, time, ret_corners))
        return bvhd_error_set(error, BVHD_INVALID, "hit.record", "no triangle of this scene%s",
                              time ? "" : ", or one that moves: bvhd_cpu_scene_corners_at has its corners");
    return BVHD_OK;
}

enum bvhd_status bvhd_cpu_scene_corners(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                        float ret_corners[3][3], struct bvhd_error *ret_error)
{
    return get_corners(scene, hit, NULL, ret_corners, ret_error);
}

enum bvhd_status bvhd_cpu_scene_corners_at(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                           float time, float ret_corners[3][3], struct bvhd_error *ret_error)
{
    return get_corners(scene, hit, &time, ret_corners, ret_error);
}

enum bvhd_status bvhd_cpu_scene_ends(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                     float ret_ends[2][4], struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {ret_ends, "ret_ends"});
    if (status == BVHD_OK)
        status = check_hit(scene, hit, ret_error);
    if (status != BVHD_OK)
        return status;
    const struct ray_hit inner = {.handle = hit->blob, .record = hit->record};
    if (!scene->target->ends || !scene->target->ends(scene, &inner, ret_ends))
        return bvhd_error_set(ret_error, BVHD_INVALID, "hit.record", "no sphere of this scene");
    return BVHD_OK;
}

/* `time` is NULL if the caller has not said one. */
static enum bvhd_status get_positions(const struct bvhd_cpu_scene *scene, uint32_t blob, uint32_t geometry,
                                      uint32_t primitive, const float *time, float ret_positions[3][3],
                                      struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {scene, "scene"}, {ret_positions, "ret_positions"});
    if (status == BVHD_OK && time)
        status = argument_check_time(*time, ret_error);
    if (status != BVHD_OK)
        return status;
    const struct cpu_structure *structure = blob < scene->bottom_count ? &scene->structures[blob] : NULL;
    if (!structure || !structure->blob.data)
        return bvhd_error_set(ret_error, BVHD_INVALID, "blob", "%" PRIu32 " is no bottom level of this scene", blob);
    if (!structure->positions)
        return bvhd_error_set(ret_error, BVHD_INVALID, "blob", "it was built without ALLOW_DATA_ACCESS");
    return positions_get(structure->positions, structure->blob.data, geometry, primitive, time, ret_positions,
                         ret_error);
}

enum bvhd_status bvhd_cpu_scene_positions(const struct bvhd_cpu_scene *scene, uint32_t blob, uint32_t geometry,
                                          uint32_t primitive, float ret_positions[3][3], struct bvhd_error *ret_error)
{
    return get_positions(scene, blob, geometry, primitive, NULL, ret_positions, ret_error);
}

enum bvhd_status bvhd_cpu_scene_positions_at(const struct bvhd_cpu_scene *scene, uint32_t blob, uint32_t geometry,
                                             uint32_t primitive, float time, float ret_positions[3][3],
                                             struct bvhd_error *ret_error)
{
    return get_positions(scene, blob, geometry, primitive, &time, ret_positions, ret_error);
}

static enum bvhd_status get_matrix(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                   const float *time, float ret_matrix[12], struct bvhd_error *error)
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    enum bvhd_status status = ARGUMENTS_CHECK(error, {ret_matrix, "ret_matrix"});
    if (status == BVHD_OK)
        status = check_hit(scene, hit, error);
    if (status == BVHD_OK && time)
        status = argument_check_time(*time, error);
    if (status != BVHD_OK)
        return status;
    const struct cpu_structure *top = cpu_scene_top(scene);
    if (!top)
        memcpy(ret_matrix, identity, sizeof identity);
    else if (!scene->target->object_to_world(top, hit->instance_record, time, ret_matrix))
        return bvhd_error_set(error, BVHD_INVALID, "hit.instance_record", "%s",
                              time ? "it has no transform at that time"
                                   : "it moves: bvhd_cpu_scene_object_to_world_at has its transform");
    return BVHD_OK;
}

enum bvhd_status bvhd_cpu_scene_object_to_world(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                                float ret_matrix[12], struct bvhd_error *ret_error)
{
    return get_matrix(scene, hit, NULL, ret_matrix, ret_error);
}

enum bvhd_status bvhd_cpu_scene_object_to_world_at(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                                   float time, float ret_matrix[12], struct bvhd_error *ret_error)
{
    return get_matrix(scene, hit, &time, ret_matrix, ret_error);
}
